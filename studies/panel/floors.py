# SPDX-License-Identifier: Apache-2.0
"""
Compute the error floor of a recording: the oracle is the true device, the baseline the device without its effects.

Both are driven by the measured displacement, interpolated linearly between the true times of the samples. Stamps give
these times only roughly. The oracle's error is therefore the floor of every identification. An effect is not visible
in a recording if the errors of baseline and oracle are equal.
"""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.rig import Cylinder, Readings, Schedule, read_force
from studies.panel.drawing import Draw, motion_of, pressures_at
from studies.panel.specimen import Specimen
from studies.panel.textbook import Gains, pressure_along


def oracle_rmse(draw: Draw) -> float:
    """Return the RMSE of the oracle in cylinder A's pressure [Pa]."""
    return rms(oracle_residual(draw))


def oracle_residual(draw: Draw) -> Array:
    """Return the residual of the oracle in cylinder A's pressure [Pa], (n,)."""
    return _pressure_residual(draw, draw.truth.device)


def baseline_rmse(draw: Draw) -> float:
    """Return the RMSE of the baseline in cylinder A's pressure [Pa]."""
    return rms(_pressure_residual(draw, draw.truth.healthy))


def force_oracle_rmse(draw: Draw) -> float:
    """Return the RMSE of the true device's force at the measured pressures [N]."""
    return rms(force_oracle_residual(draw))


def force_oracle_residual(draw: Draw) -> Array:
    """Return measured force minus the true device's force at the measured pressures [N], (n,)."""
    device, force = draw.truth.device, draw.truth.samples.force
    thrust = _thrust(draw.recording.pressures) - _thrust(draw.truth.samples.pressures)
    if isinstance(device, Specimen):
        return draw.recording.force - read_force(force + thrust, device.rig.pickup, device.rig.odd_force)
    return draw.recording.force - force - thrust


def force_baseline_rmse(draw: Draw) -> float:
    """Return the RMSE of the thrust of the measured pressures against the measured force [N]."""
    return rms(draw.recording.force - _thrust(draw.recording.pressures))


def predict(device: Specimen | Gains, recording: Readings, schedule: Schedule) -> Array:
    """Return the reading of cylinder A's sensor if a device follows a recording's displacement [Pa], (n,)."""
    motion = motion_of(schedule)
    times = motion.start + motion.period * np.arange(1.0, len(motion.positions) + 1.0)
    sample_times = schedule.sampling_period * np.arange(float(schedule.samples))
    delay = device.rig.pickup.displacement_delay if isinstance(device, Specimen) else 0.0
    displacement = np.interp(times + delay, sample_times, recording.displacement)
    if isinstance(device, Gains):
        levels = motion.setpoints[:, 0] + AMBIENT_PRESSURE
        return np.interp(sample_times, times, pressure_along(displacement, levels, motion.period, device))
    lag = device.rig.pickup.displacement_lag
    if lag:
        displacement = displacement + lag * np.gradient(displacement, motion.period)
    driven = motion._replace(positions=displacement, velocities=np.gradient(displacement, motion.period))
    _, arrived = device.simulate(driven)
    return pressures_at(device.clock.sampled(sample_times), arrived)[:, 0]


def _pressure_residual(draw: Draw, device: Specimen | Gains) -> Array:
    return draw.recording.pressures[:, 0] - predict(device, draw.recording, draw.truth.schedule)


def _thrust(pressures: Array) -> Array:
    """Return the force of the air at pressures of A and B [N]."""
    area = Cylinder().area
    return area * (pressures[:, 0] - pressures[:, 1])
