# SPDX-License-Identifier: Apache-2.0
"""The device to plan for: its usual set-points, and what its sensors see."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device, report_in
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.planning.limits import Sensing
from cfd_pneumatic.units import PSI

_RANGE = 5.0 * PSI  # above a single set-point, where the file has no other [Pa]


def usual_pressures(device: Device) -> tuple[float, float]:
    """Return the range of a device's set-points, 5 psi from the only one on where there is no other, gauge [Pa]."""
    points = np.concatenate([one.parameters.setpoints for one in device.model.cylinders.values()])
    points = np.append(points, list(_homes(device).values()))
    low, high = float(points.min()), float(points.max())
    return low, high if high > low else low + _RANGE


def at_home(device: Device, pressures: tuple[float, float]) -> Device:
    """
    Return a device that starts at home, within a range of gauge pressures [Pa].

    Home is its initial set-point, or the first of those at which gains are given.
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
    """Return the gauge set-points of the cylinders A and B at home; a missing one's is the other's [Pa]."""
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
    Return what sensors see as a report of `identify_bag` found it, and how far the piston went [m].

    Raises
    ------
    InputError
        If the file is no such report.

    """
    try:
        report = report_in(path)
        cylinders = report['cylinders'].values()
        noise = max(float(one['noise_floor_pa']) for one in cylinders)
        rates = [(int(one['displacement_samples']) - 1) / float(one['duration_s']) for one in report['recordings']]
        rate = float(round(min(rates)))
        farthest = max((float(end) for one in report['recordings'] for end in one['travel_m']), key=abs)
        if not np.isfinite([noise, *rates, farthest]).all():
            raise ValueError('is not finite')
    except InputError as error:
        raise InputError(f'{path} {error}: give the report.json of identify_bag') from error
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(f'{path} is no report of identify_bag: give its report.json') from error
    # the floor is that of the residual: what the displacement's noise adds to it is in there
    return Sensing(pressure_noise=noise, displacement_noise=0.0, sample_rate=rate), farthest
