# SPDX-License-Identifier: Apache-2.0
"""Simulate the contact force of a device along a path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.device import Device, simulate_motion
from cfd_pneumatic.identification import exact_motion
from cfd_pneumatic.model import PRESSURE_PARTS, Effect
from cfd_pneumatic.path.motion import PathMotion
from cfd_pneumatic.recording import Signal, sampled

Setpoints = Mapping[str, float | Signal]
"""Gauge set-points by cylinder [Pa]: constant, or levels that act from their times on."""


class PathResponse(NamedTuple):
    """Response of a device along a path, on the grid of the path."""

    pressures: Mapping[str, Array]
    """Absolute pressures in the chambers by cylinder, each (n,) [Pa]."""

    force: Array
    """Contact force, shape (n,) [N]."""


class PathSimulator:
    """
    Simulate devices along one path.

    The response is that of the device and not of its sensors: effects that only change a sensor's reading are left
    out.

    Parameters
    ----------
    path
        Motion of the piston.
    deviation
        Deviation of the piston from this motion on the grid of the path, shape (n,) [m]; None for none.

    """

    def __init__(self, path: PathMotion, deviation: Array | None = None) -> None:
        times = path.grid
        displacement, speed = path.displacement_at(times), path.speed_at(times)
        if deviation is not None:
            displacement, speed = displacement + deviation, speed + np.gradient(deviation, times)
        self.path = path
        self._recording = sampled(times, displacement, {}, name='path')
        self._motion = exact_motion(times, displacement, speed)

    def simulate(self, device: Device, setpoints: Setpoints) -> PathResponse:
        """Return the response of a device at set-points; the device rests at the begin of the grid."""
        model = without_sensor_effects(device).model
        begin, ambient = self.path.grid[:1], model.geometry.ambient_pressure
        levels = {
            name: Signal(level.times, level.values + ambient)
            if isinstance(level, Signal)
            else Signal(begin, np.array([level + ambient]))
            for name, level in setpoints.items()
        }
        simulated = simulate_motion(model, self._recording, self._motion, levels)
        assert simulated.force is not None
        pressures = {name: cylinder.pressure.values for name, cylinder in simulated.cylinders.items()}
        return PathResponse(pressures, simulated.force.values)


def without_sensor_effects(device: Device) -> Device:
    """Return a device without the effects that only change the reading of a sensor."""
    return device.with_values(
        {
            f'{cylinder}.{name}.enabled': False
            for cylinder, parts in device.model.cylinders.items()
            for name in parts.effects
            if _is_of_sensor(PRESSURE_PARTS[name])
        }
    )


def _is_of_sensor(effect: Effect) -> bool:
    """Return whether an effect delays the reading of the pressure or of the displacement."""
    return effect.follows == 'signal' or effect.late in ('reading', 'displacement') or effect.looks_ahead


def delayed(setpoints: Setpoints, delay: float) -> Setpoints:
    """Return set-points that act later by a delay [s]; a negative delay is earlier."""
    return {
        name: Signal(level.times + delay, level.values) if isinstance(level, Signal) else level
        for name, level in setpoints.items()
    }


def acting_at(level: float | Signal, times: Array) -> Array:
    """Return the set-point that acts at some times, shape (n,) [Pa]."""
    if not isinstance(level, Signal):
        return np.full(times.size, level)
    return level.values[np.maximum(np.searchsorted(level.times, times, side='right') - 1, 0)]
