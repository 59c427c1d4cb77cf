# SPDX-License-Identifier: Apache-2.0
"""Prepare a device for planning: its home set-points, and the noise of its sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device, report_in
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.planning.limits import Sensing
from cfd_pneumatic.units import PSI

_RANGE = 5.0 * PSI  # above the set-point of a file with a single set-point [Pa]


def usual_pressures(device: Device) -> tuple[float, float]:
    """Return the range of a device's set-points, 5 psi above a single set-point, gauge [Pa]."""
    points = np.concatenate([cylinder.parameters.setpoints for cylinder in device.model.cylinders.values()])
    points = np.append(points, list(_homes(device).values()))
    low, high = float(points.min()), float(points.max())
    return low, high if high > low else low + _RANGE


def device_at_home(device: Device, pressures: tuple[float, float]) -> Device:
    """
    Return a device that starts at its home set-points, within a range of gauge pressures [Pa].

    The home set-point is the initial set-point if given, or the first set-point at which gains are given.
    """
    low, high = pressures
    return device.with_values(
        {f'{name}.initial_setpoint': min(max(home, low), high) for name, home in _homes(device).items()}
    )


def _homes(device: Device) -> dict[str, float]:
    return {
        name: level if f'{name}.initial_setpoint' in device.given else float(cylinder.parameters.setpoints[0])
        for (name, cylinder), level in zip(device.model.cylinders.items(), device.initial_setpoints.values())
    }


def home_setpoints(device: Device) -> tuple[float, float]:
    """Return the gauge home set-points of A and B [Pa]; a missing cylinder has that of the present cylinder."""
    homes = device.initial_setpoints
    present = next(iter(homes.values()))
    first, second = (homes.get(name, present) for name in CYLINDERS)
    return first, second


def home_gains(device: Device, cylinder: str) -> Array:
    """Return a cylinder's gains at home, in the order of `SPECS`, shape (gains,) [SI]."""
    points = device.model.cylinders[cylinder].parameters
    return points.interpolate(device.initial_setpoints[cylinder]).table[0, 1:]


def read_report(path: Path) -> tuple[Sensing, float]:
    """
    Return the noise and sampling in a report of `identify_bag`, and the farthest displacement [m].

    Raises
    ------
    InputError
        If the file is not a report of `identify_bag`.

    """
    try:
        report = report_in(path)
        cylinders = report['cylinders'].values()
        noise = max(float(cylinder['noise_floor_pa']) for cylinder in cylinders)
        recordings = report['recordings']
        rates = [
            (int(recording['displacement_samples']) - 1) / float(recording['duration_s']) for recording in recordings
        ]
        rate = float(round(min(rates)))
        farthest = max((float(end) for recording in recordings for end in recording['travel_m']), key=abs)
        if not np.isfinite([noise, *rates, farthest]).all():
            raise ValueError('is not finite')
    except InputError as error:
        raise InputError(f'{path} {error}: give the report.json of identify_bag') from error
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(f'{path} is not a report of identify_bag: give the report.json of identify_bag') from error
    # The noise floor is that of the residual, which includes the displacement's noise.
    return Sensing(pressure_noise=noise, displacement_noise=0.0, sample_rate=rate), farthest
