# SPDX-License-Identifier: Apache-2.0
"""Devices with two cylinders and a force sensor, of the panel's makes, and the recording that identifies each."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cfd_pneumatic.path import Regulators, SetpointRange
from cfd_pneumatic.rig import RigParameters, Schedule, surface_following
from cfd_pneumatic.units import PSI
from studies.panel.makes import MAKES, OWN_WAYS, draw_make
from studies.panel.situation import Situation
from studies.panel.strengths import install

RECORDING = 60.0
"""Duration of the recording that identifies a device [s]."""

WITH_FRICTION, WITH_LEAK, WITH_COMMAND_PATH = 0.8, 1.0 / 3.0, 2.0 / 3.0
"""Shares of devices with friction, with a leak, and with dead time and lag of the command."""

FRICTION = (0.1, 2.0)
"""Range of the Coulomb friction [N], logarithmic."""

MASS = (0.05, 0.4)
"""Range of the moving mass [kg], logarithmic."""

SLOWEST_COMMAND = 0.06
"""Largest sum of dead time and lag of the command [s]."""


RANGE, RATE = SetpointRange(0.0, 30.0 * PSI), 100.0
"""Range of the regulators [Pa], and the rate of the set-points that hold the force [Hz]."""


class HoldDevice(NamedTuple):
    """
    A device of the study.

    Attributes
    ----------
    rig
        Parameters of the rig.
    facts
        `make`; `is_exact`, whether the make has only orifices and chambers as in ISO 6358; Coulomb `friction` [N];
        `leak`, the cylinder with a leak, or empty; `dead_time` and `lag` of the command [s].

    """

    rig: RigParameters
    facts: dict[str, Any]


def regulators(rate: float = RATE) -> Regulators:
    """Return the limits of the regulators at a rate of the set-points [Hz]."""
    return Regulators(RANGE, rate=rate)


def draw_device(seed: int) -> HoldDevice:
    """Return the device of a seed: even seeds have an exact make, odd seeds an inexact make."""
    rng = np.random.default_rng([seed, 53])
    makes = [name for name in MAKES if (name in OWN_WAYS) == bool(seed % 2)]
    make = str(rng.choice(makes))
    specimen, gains = draw_make(make, rng)
    situation = Situation(specimen, gains, draw_recording(seed), rng)
    changes = {'piston.mass': _between(MASS, rng)}
    second = MAKES[make](specimen.rig.cylinder_b, lambda low, high: float(rng.uniform(low, high)))
    changes |= {_of_b(name): value for name, value in second.items()}
    friction = _between(FRICTION, rng) if rng.random() < WITH_FRICTION else 0.0
    if friction:
        changes |= install('seal_friction', situation, friction)[1]
    leak = str(rng.choice(['a', 'b'])) if rng.random() < WITH_LEAK else ''
    if leak:
        found = install('leakage', situation)[1]
        changes |= {name if leak == 'a' else _of_b(name): value for name, value in found.items()}
    delay = float(rng.uniform(0.0, SLOWEST_COMMAND)) if rng.random() < WITH_COMMAND_PATH else 0.0
    dead_time = float(delay * rng.random())
    lag = delay - dead_time
    for part in ('effects_a', 'effects_b'):
        changes |= {f'{part}.command_dead_time': dead_time, f'{part}.command_lag': lag}
    facts = {'make': make, 'is_exact': make not in OWN_WAYS, 'friction': friction, 'leak': leak}
    return HoldDevice(specimen.with_changes(changes).rig, {**facts, 'dead_time': dead_time, 'lag': lag})


def draw_recording(seed: int, duration: float = RECORDING) -> Schedule:
    """Return the motion and the set-points of the recording that identifies a device."""
    rng = np.random.default_rng([seed, 54])
    return surface_following(
        rng.uniform(11.0, 13.0) * PSI,
        1.2e-3,
        setpoint_steps=rng.uniform(4.0, 6.0) * PSI,
        setpoint_b=rng.uniform(7.0, 9.0) * PSI,
        duration=duration,
        seed=seed,
    )


def _of_b(name: str) -> str:
    """Return the name of a parameter of cylinder B from that of cylinder A."""
    part, _, field = name.partition('.')
    return f'{part.removesuffix("_a")}_b.{field}' if part.endswith('_a') else name


def _between(ends: tuple[float, float], rng: np.random.Generator) -> float:
    """Return a random number between two ends, uniform on a logarithmic scale."""
    return float(ends[0] * (ends[1] / ends[0]) ** rng.random())
