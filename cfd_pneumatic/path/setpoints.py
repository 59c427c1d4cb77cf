# SPDX-License-Identifier: Apache-2.0
"""Constant set-points with which the force along a path has the wanted mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path.simulation import PathSimulator
from cfd_pneumatic.path.thresholds import CENTRED, MOST_CORRECTIONS


class SetpointRange(NamedTuple):
    """Range of the regulators, gauge [Pa]."""

    low: float
    high: float

    def check(self, levels: Mapping[str, float], force: float) -> None:
        """Refuse constant set-points outside of the range, which would give a force [N]."""
        for name, level in levels.items():
            if not self.low <= level <= self.high:
                raise InputError(
                    f'a force of {force:g} N needs a set-point of {level:.0f} Pa of {name}, but the regulators reach '
                    f'{self.low:.0f} to {self.high:.0f} Pa. Choose a smaller force, a different --bias or --range'
                )


def usual_bias(device: Device) -> float:
    """Return the mean gauge set-point of the recordings that identified the device, or of the device [Pa]."""
    spans = device.identified_range.setpoints
    middles = [0.5 * (low + high) for low, high in spans.values()]
    return float(np.mean(middles or [*device.initial_setpoints.values()]))


def check_force(device: Device, force: float) -> None:
    """
    Refuse a device without an area, and a force that a single cylinder cannot give.

    Raises
    ------
    InputError
        If the area is not known, or the force has the wrong sign for the only cylinder.

    """
    if 'area' in device.assumed:
        raise InputError(
            'the area of the pistons is not known, so that no force can be predicted. Identify with a recorded force '
            'or with --area, or write `area` into the parameter file'
        )
    if len(device.model.cylinders) == len(CYLINDERS):
        return
    (name,) = device.model.cylinders
    sign = 1.0 if name == CYLINDERS[0] else -1.0
    if sign * force * device.number('geometric_factor') <= 0.0:
        raise InputError(
            f'--force {force:g} N: the device has only {name}, which gives forces of the opposite sign. '
            f'Give a force of {-force:g} N, or a device with two cylinders'
        )


def centred_setpoints(
    simulator: PathSimulator, device: Device, force: float, bias: float, limits: SetpointRange
) -> dict[str, float]:
    """
    Return the constant set-points with which the mean force along a path is the wanted force.

    Parameters
    ----------
    simulator, device
        The path, and the device; leaks and offsets of the device are compensated.
    force
        Wanted mean force [N].
    bias
        Mean gauge set-point of two cylinders [Pa].
    limits
        Range of the regulators.

    Raises
    ------
    InputError
        If the regulators do not reach the force.

    """
    on_path = simulator.path.is_on_path
    wanted = force
    for _ in range(MOST_CORRECTIONS):
        pair = dict(zip(CYLINDERS, device.model.setpoints(wanted, bias)))
        levels = {name: pair[name] for name in device.model.cylinders}
        limits.check(levels, force)
        error = force - float(np.mean(simulator.simulate(device, levels).force[on_path]))
        if abs(error) <= CENTRED * abs(force):
            break
        wanted += error
    return levels
