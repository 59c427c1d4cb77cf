# SPDX-License-Identifier: Apache-2.0
"""The rig's sensors: noise, a 12-bit converter, and a clock that stamps a little early or late."""

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
    What stands between the rig and its record.

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
    """Resolution of the converters; 0 leaves readings unrounded and unclipped."""

    def __post_init__(self) -> None:
        """Refuse sensors that can't be built."""
        for name in ('pressure_noise', 'displacement_noise', 'force_noise', 'stamp_jitter', 'bits'):
            if not getattr(self, name) >= 0:
                raise InputError(f'sensor {name} = {getattr(self, name)}: give zero or more')
        for name in ('pressure_range', 'displacement_range', 'force_range'):
            low, high = getattr(self, name)
            if not low < high:
                raise InputError(f'sensor {name} from {low:g} to {high:g}: give the lower end first')

    def measure_pressure(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return what a pressure sensor reads at some absolute pressures [Pa]."""
        return self._read(values, self.pressure_noise, self.pressure_range, rng)

    def measure_displacement(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return what the displacement sensor reads at some positions [m]."""
        return self._read(values, self.displacement_noise, self.displacement_range, rng)

    def measure_force(self, values: ArrayLike, rng: np.random.Generator) -> Array:
        """Return what the load cell reads at some forces [N]."""
        return self._read(values, self.force_noise, self.force_range, rng)

    def stamp(self, times: ArrayLike, period: float, rng: np.random.Generator) -> Array:
        """
        Return the stamps [s] of samples taken at some times, one period [s] apart.

        A stamp strays by less than half a period, so that stamps never go back.
        """
        sampled = np.asarray(times, dtype=float)
        strayed = self.stamp_jitter * rng.standard_normal(sampled.shape)
        return sampled + np.clip(strayed, -0.45 * period, 0.45 * period)

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
    """What the sensors make of a number of samples, and what the regulators were set to."""

    times: Array
    """Stamps of the samples [s], (n,)."""

    displacement: Array
    """Measured position of the piston [m], (n,)."""

    pressures: Array
    """Measured absolute pressures of the cylinders A and B [Pa], (n, 2)."""

    setpoints: Array
    """Absolute set pressures up to each sample, since the one before, as they were set [Pa], (n, 2)."""

    force: Array
    """Measured contact force along +x [N], (n,)."""


class Instruments:
    """
    The sensors of one run.

    Each has a noise of its own, drawn from one seed, so that a run read in pieces gives the same as one read whole.
    """

    def __init__(self, sensors: Sensors, period: float, seed: int) -> None:
        self._sensors = sensors
        self._period = period
        children = np.random.SeedSequence(seed).spawn(5)
        self._clock, self._displacement, self._force, *self._pressures = map(np.random.default_rng, children)

    def read(self, truth: Truth) -> Readings:
        """Return what the sensors read of the next samples."""
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
