# SPDX-License-Identifier: Apache-2.0
"""The rig's sensors: noise, a 12-bit converter, and jitter of the stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.rig import Truth
from cfd_pneumatic.units import INCH, PSI


@dataclass(frozen=True)
class Sensors:
    """
    The sensors that record the rig.

    A reading is the truth plus white noise, clipped to the sensor's range and rounded to the converter's nearest step.
    """

    pressure_noise: float = 7.5e-3 * PSI
    """Standard deviation of the pressures' noise [Pa]."""

    displacement_noise: float = 20e-6 * INCH
    """Standard deviation of the displacement's noise [m]."""

    force_noise: float = 0.1
    """Standard deviation of the force's noise [N]."""

    stamp_jitter: float = 5e-5
    """Standard deviation of a stamp about the time of its sample [s]."""

    pressure_range: tuple[float, float] = (AMBIENT_PRESSURE, AMBIENT_PRESSURE + 30 * PSI)
    """Full scale of the pressure sensors, absolute [Pa]."""

    displacement_range: tuple[float, float] = (-6.35e-3, 6.35e-3)
    """Full scale of the displacement sensor [m]."""

    force_range: tuple[float, float] = (-250.0, 250.0)
    """Full scale of the load cell [N]."""

    bits: int = 12
    """Resolution of the converters; 0 for readings without rounding and clipping."""

    def __post_init__(self) -> None:
        """Refuse impossible sensors."""
        for name in ('pressure_noise', 'displacement_noise', 'force_noise', 'stamp_jitter', 'bits'):
            if not getattr(self, name) >= 0:
                raise InputError(f'sensor {name} must be zero or more, is {getattr(self, name)}')
        for name in ('pressure_range', 'displacement_range', 'force_range'):
            low, high = getattr(self, name)
            if not low < high:
                raise InputError(f'sensor {name} must have the lower end first, is {low:g} to {high:g}')

    def measure_pressure(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return the readings of a pressure sensor at absolute pressures [Pa]."""
        return self._read(values, self.pressure_noise, self.pressure_range, rng)

    def measure_displacement(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return the readings of the displacement sensor at positions [m]."""
        return self._read(values, self.displacement_noise, self.displacement_range, rng)

    def measure_force(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return the readings of the load cell at forces [N]."""
        return self._read(values, self.force_noise, self.force_range, rng)

    def stamp(self, times: ArrayLike, period: float, rng: np.random.Generator) -> Array:
        """
        Return the stamps [s] of samples at times one period apart [s].

        A stamp deviates by less than half a period, so that stamps always increase.
        """
        sampled = np.asarray(times, dtype=float)
        jitter = self.stamp_jitter * rng.standard_normal(sampled.shape)
        return sampled + np.clip(jitter, -0.45 * period, 0.45 * period)

    def step(self, full_scale: tuple[float, float]) -> float:
        """Return the converter's step over a full scale, in the unit of that scale; 0 without a converter."""
        return (full_scale[1] - full_scale[0]) / (2**self.bits - 1) if self.bits else 0.0

    def _read(
        self, values: ArrayLike, noise: float, full_scale: tuple[float, float], rng: np.random.Generator
    ) -> Array:
        truth = np.asarray(values, dtype=float)
        noisy = truth + noise * rng.standard_normal(truth.shape)
        if not self.bits:
            return noisy
        low, high = full_scale
        step = self.step(full_scale)
        return low + step * np.rint((np.clip(noisy, low, high) - low) / step)


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of the sensors at a number of samples, and the set-points."""

    times: Array
    """Stamps of the samples [s], (n,)."""

    displacement: Array
    """Measured position of the piston [m], (n,)."""

    pressures: Array
    """Measured absolute pressures of the cylinders A and B [Pa], (n, 2)."""

    setpoints: Array
    """Absolute set pressures without disturbances, between the sample before and each sample [Pa], (n, 2)."""

    force: Array
    """Measured contact force along +x [N], (n,)."""


class Instruments:
    """
    The sensors of a run.

    Each sensor has a separate noise stream from the seed, so that readings do not depend on the pieces of a run.
    """

    def __init__(self, sensors: Sensors, period: float, seed: int) -> None:
        self._sensors = sensors
        self._period = period
        children = np.random.SeedSequence(seed).spawn(5)
        self._clock, self._displacement, self._force, *self._pressures = map(np.random.default_rng, children)

    def read(self, truth: Truth) -> Readings:
        """Return the readings of the sensors at the next samples."""
        sensors = self._sensors
        return Readings(
            times=sensors.stamp(truth.times, self._period, self._clock),
            displacement=sensors.measure_displacement(truth.displacement, self._displacement),
            pressures=np.column_stack(
                [
                    sensors.measure_pressure(truth.pressures[:, cylinder], rng)
                    for cylinder, rng in enumerate(self._pressures)
                ]
            ),
            setpoints=truth.setpoints,
            force=sensors.measure_force(truth.force, self._force),
        )
