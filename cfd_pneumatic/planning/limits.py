# SPDX-License-Identifier: Apache-2.0
"""Define the limits of a cell, and the noise and sampling of its sensors."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from cfd_pneumatic.arguments import check_number, check_numbers, check_type
from cfd_pneumatic.errors import InputError

SHORTEST_STROKE = 1e-5
"""Least stroke that the sensor resolves [m]."""

SLOWEST = 1e-4
"""Least speed limit of an informative motion [m/s]."""


@dataclass(frozen=True)
class Limits:
    """
    Limits of the cell, which a proposal keeps exactly.

    Attributes
    ----------
    pressures
        Lowest and highest set-point, gauge [Pa].
    stroke
        The piston stays between 0 and this displacement [m]; a negative stroke reverses the direction.
    speed, acceleration
        Largest speed and acceleration of the piston [m/s, m/s^2].
    duration
        Longest time from the first sample to the last [s].

    Raises
    ------
    InputError
        If a limit permits no plan.

    """

    pressures: tuple[float, float]
    stroke: float = 3e-3
    speed: float = 0.2
    acceleration: float = 10.0
    duration: float = 60.0

    def __post_init__(self) -> None:
        """Refuse limits that permit no plan."""
        check_type('pressures', self.pressures, Collection, 'the lowest and the highest set-point')
        if len(self.pressures) != 2:
            raise InputError(f'pressures has {len(self.pressures)} numbers: give the lowest and the highest set-point')
        for level in self.pressures:
            check_number('a set-point of pressures', level)
        check_numbers(stroke=self.stroke, speed=self.speed, acceleration=self.acceleration, duration=self.duration)
        if not SHORTEST_STROKE <= abs(self.stroke) < 1.0:
            raise InputError(
                f'stroke {self.stroke:g} m: give metres, {SHORTEST_STROKE:g} to below 1 m, in either direction'
            )
        if not SLOWEST <= self.speed <= 100.0:
            raise InputError(f'speed {self.speed:g} m/s: give {SLOWEST:g} to 100 m/s')
        if not 1e-3 <= self.acceleration <= 1e5:
            raise InputError(f'acceleration {self.acceleration:g} m/s^2: give 0.001 to 1e5 m/s^2')
        low, high = self.pressures
        if not (math.isfinite(low) and math.isfinite(high) and -1e5 <= low <= high <= 1e7):
            raise InputError(f'pressures {low:g} to {high:g} Pa: give the lower first, from -1e5 to 1e7 Pa gauge')
        if not 0.0 < self.duration <= 3600.0:
            raise InputError(f'duration {self.duration:g} s: give up to 3600 s')


_LARGEST_NOISE = {'pressure_noise': ('Pa', 1e5), 'displacement_noise': ('m', 1e-2), 'force_noise': ('N', 1e4)}
"""Unit and largest value of the noise of a sensor."""


@dataclass(frozen=True)
class Sensing:
    """
    Noise and sampling of the sensors.

    Attributes
    ----------
    pressure_noise
        Standard deviation of the pressures' noise, including the converter's rounding [Pa].
    displacement_noise
        Standard deviation of the displacement's noise [m]; times K_x it is a noise of the simulated pressure.
    force_noise
        Standard deviation of the force's noise [N].
    sample_rate
        Samples per second [Hz].

    Raises
    ------
    InputError
        If a value is implausible for a sensor.

    """

    pressure_noise: float = 54.0
    displacement_noise: float = 5e-7
    force_noise: float = 0.1
    sample_rate: float = 500.0

    def __post_init__(self) -> None:
        """Refuse implausible values."""
        check_numbers(**vars(self))
        for name, (unit, largest) in _LARGEST_NOISE.items():
            noise = getattr(self, name)
            if not 0.0 <= noise <= largest or (noise == 0.0 and name != 'displacement_noise'):
                least = 'zero' if name == 'displacement_noise' else 'more than zero'
                raise InputError(f'{name.replace("_", " ")} {noise:g} {unit}: give {least} to {largest:g} {unit}')
        if not 20.0 <= self.sample_rate <= 5000.0:
            raise InputError(f'sample rate {self.sample_rate:g} Hz: give 20 to 5000 Hz')

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return 1.0 / self.sample_rate
