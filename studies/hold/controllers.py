# SPDX-License-Identifier: Apache-2.0
"""Alternatives to the inversion of the model: a PI controller of the force, and the formula of the gains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.device import Device
from cfd_pneumatic.model import DIRECTIONS
from cfd_pneumatic.path import PathMotion, Prediction
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.rig import Bench, Rig, RigParameters
from studies.hold.devices import RANGE, RATE
from studies.hold.playing import PERIOD, on_path, schedule_of

DEAD_TIME = 0.02
"""Age of the force reading on which the controller acts [s]."""

CONTROL_PERIOD = 0.01
"""Time between the controller's set-points [s]."""


class ControllerGains(NamedTuple):
    """Gains of a PI controller of the force."""

    proportional: float
    """Change of the force by the set-points for a force error [-]."""

    integral: float
    """Rate of this change [1/s]."""


GRID = tuple(ControllerGains(gain, rate) for gain in (0.1, 0.4, 0.8) for rate in (2.0, 6.0, 15.0))
"""Gains from which a device's controller is chosen."""


def controlled_errors(
    constant: Prediction, rig: RigParameters, gains: ControllerGains, area: float
) -> tuple[Array, Array]:
    """
    Return the true and the measured force error on the path with a controller, each (n,) [N].

    The controller changes the constant set-points of a prediction. The area [m^2] converts a force to a pressure.
    """
    schedule = schedule_of(constant)
    levels = schedule.setpoints[0]
    bench = Bench(Rig((levels[0], levels[1]), rig, position=float(schedule.positions[0]), time=-PERIOD), PERIOD, seed=1)
    block, age, knots = round(CONTROL_PERIOD / PERIOD), round(DEAD_TIME / PERIOD), schedule.knots_per_sample
    measured, true = np.zeros((2, schedule.samples))
    integral = 0.0
    for begin in range(0, schedule.samples, block):
        part = slice(begin, min(begin + block, schedule.samples))
        error = constant.target - measured[begin - age] if begin >= age else 0.0
        integral += gains.integral * CONTROL_PERIOD * error
        change = 0.5 * (gains.proportional * error + integral) / area
        changed = np.clip(levels + change * np.array([1.0, -1.0]), *RANGE)
        motion = slice(part.start * knots, part.stop * knots)
        answer = bench.advance(
            schedule.positions[motion], schedule.velocities[motion], np.tile(changed, (part.stop - begin, 1))
        )
        measured[part], true[part] = answer.force, answer.truth.force
    times: Array = PERIOD * np.arange(float(schedule.samples))
    on_grid = [on_path(constant, times, force) - constant.target for force in (true, measured)]
    return on_grid[0], on_grid[1]


def tuned_gains(constant: Prediction, rig: RigParameters, area: float) -> ControllerGains:
    """Return the gains of `GRID` with the smallest measured force error on a path."""
    return min(GRID, key=lambda gains: rms(controlled_errors(constant, rig, gains, area)[1]))


def formula_setpoints(device: Device, path: PathMotion, levels: Mapping[str, float]) -> dict[str, Signal]:
    """
    Return gauge set-points from the gains of a device: the constant set-point plus K_x / K times the speed [Pa].

    K is the gain of the valve that acts: K_sv while the cylinder grows, K_v while it shrinks.
    """
    times = path.grid[0] + np.arange(0.0, path.grid[-1] - path.grid[0], 1.0 / RATE)
    speed = path.speed_at(times + 0.5 / RATE)
    setpoints = {}
    for name, level in levels.items():
        gains = device.model.cylinders[name].parameters.interpolate([level])
        growth = DIRECTIONS[name] * speed
        lead = np.where(growth > 0.0, gains.k_x / gains.k_sv, gains.k_x / gains.k_v) * growth
        setpoints[name] = Signal(times, np.maximum(level + lead, 0.0))
    return setpoints
