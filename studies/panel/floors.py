# SPDX-License-Identifier: Apache-2.0
"""
How well anybody could do on a recording: the oracle knows the device, and the baseline the device without its effects.

Both are given the measured displacement, straight between its samples, and when these were really taken, which the
stamps tell but roughly: so the oracle's error is the floor of every identification. A recording whose baseline is as
good as its oracle hasn't shown its effect.
"""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.rig import Cylinder, Readings, Schedule, read_force
from studies.panel.drawing import Draw, at_times, motion_of
from studies.panel.specimen import Specimen
from studies.panel.textbook import Gains, pressure_along


def oracle_rmse(draw: Draw) -> float:
    """Return the RMSE of cylinder A's pressure against the true device driven by the measured displacement [Pa]."""
    return rms(oracle_residual(draw))


def oracle_residual(draw: Draw) -> Array:
    """Return what the true device, driven by the measured displacement, leaves of cylinder A's pressure [Pa], (n,)."""
    return _pressure_residual(draw, draw.truth.device)


def baseline_rmse(draw: Draw) -> float:
    """Return the same against the device without its effects [Pa]."""
    return rms(_pressure_residual(draw, draw.truth.healthy))


def force_oracle_rmse(draw: Draw) -> float:
    """Return the RMSE of the force against the true device's, given the measured pressures [N]."""
    return rms(force_oracle_residual(draw))


def force_oracle_residual(draw: Draw) -> Array:
    """Return what the true device, given the measured pressures, leaves of the force [N], (n,)."""
    device, force = draw.truth.device, draw.truth.samples.force
    thrust = _thrust(draw.recording.pressures) - _thrust(draw.truth.samples.pressures)
    if isinstance(device, Specimen):
        return draw.recording.force - read_force(force + thrust, device.rig.pickup, device.rig.odd_force)
    return draw.recording.force - force - thrust


def force_baseline_rmse(draw: Draw) -> float:
    """Return the RMSE of the force against the measured pressures' alone [N]."""
    return rms(draw.recording.force - _thrust(draw.recording.pressures))


def predict(device: Specimen | Gains, recording: Readings, schedule: Schedule) -> Array:
    """Return what cylinder A's sensor would read of a device that is moved as a recording says [Pa], (n,)."""
    motion = motion_of(schedule)
    times = motion.start + motion.period * np.arange(1.0, len(motion.positions) + 1.0)
    taken = schedule.sampling_period * np.arange(float(schedule.samples))
    late = device.rig.pickup.displacement_delay if isinstance(device, Specimen) else 0.0
    displacement = np.interp(times + late, taken, recording.displacement)
    if isinstance(device, Gains):
        levels = motion.setpoints[:, 0] + AMBIENT_PRESSURE
        return np.interp(taken, times, pressure_along(displacement, levels, motion.period, device))
    lag = device.rig.pickup.displacement_lag
    if lag:
        displacement = displacement + lag * np.gradient(displacement, motion.period)
    driven = motion._replace(positions=displacement, velocities=np.gradient(displacement, motion.period))
    _, arrived = device.put_through(driven)
    return at_times(device.clock.sampled(taken), arrived)[:, 0]


def _pressure_residual(draw: Draw, device: Specimen | Gains) -> Array:
    return draw.recording.pressures[:, 0] - predict(device, draw.recording, draw.truth.schedule)


def _thrust(pressures: Array) -> Array:
    """Return the force of the air at some pressures of A and B [N]."""
    area = Cylinder().area
    return area * (pressures[:, 0] - pressures[:, 1])
