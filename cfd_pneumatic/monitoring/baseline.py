# SPDX-License-Identifier: Apache-2.0
"""What a model usually leaves of a signal, learned from a stretch in which the device is as it should be."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import autoregression, whitened
from cfd_pneumatic.monitoring.chart import LEAST_SPREAD, Series, usual

_FAST = 0.1  # share of the samples, those where the signal changes fastest, that tell what its timing is worth
_SLOW = 25  # blocks over which a mean is slow
_CHANCE = 3.0  # standard deviations that such a mean may stray by chance
_LEAST_PERSISTENCE = 0.02
_FEW = 5  # blocks: longer than the memory of a sensor
_CUBE_ROOT = math.sqrt(2.0 / 9.0)  # standard deviation of a mean square's cube root, times the root of the samples
FEWEST_BLOCKS = 100


@dataclass(frozen=True)
class Weighing:
    """
    How much a residual is worth.

    Attributes
    ----------
    noise
        Standard deviation while the signal rests [signal's unit].
    timing
        How much a residual grows with the signal's rate [s]: jitter of the stamps, and what the model is late by.
    coefficients
        Memory of the weighed residuals from sample to sample, as `autoregression` has it.
    innovation
        Standard deviation of what is new in a weighed residual [signal's unit].

    """

    noise: float
    timing: float
    coefficients: Array = field(default_factory=lambda: np.empty(0))
    innovation: float = 1.0

    @property
    def persistence(self) -> float:
        """What is new in each residual of a lasting shift, over the shift [-]."""
        return max(1.0 - float(np.sum(self.coefficients)), _LEAST_PERSISTENCE)

    def weighed(self, residuals: Array, rates: Array) -> Array:
        """Return residuals that spread alike at any rate of the signal [signal's unit], shape (n,)."""
        weighed: Array = residuals / np.sqrt(1.0 + (self.timing * rates / self.noise) ** 2)
        return weighed

    def innovations(self, weighed: Array, before: Array) -> Array:
        """Return what is new in each weighed residual, shape (n,); those `before` it are zero where there are none."""
        order = self.coefficients.size
        behind = np.concatenate([np.zeros(order), before])[before.size :]
        return whitened(np.concatenate([behind, weighed]), self.coefficients)[order:]

    def features(self, innovations: Array) -> tuple[Array, Array]:
        """
        Return mean and energy of blocks, each of shape (blocks,).

        The mean is that of the residuals, but for their memory. The energy is the cube root of the innovations' mean
        square over the usual one: nearly normal (Wilson and Hilferty, 1931).

        Parameters
        ----------
        innovations
            Shape (blocks, samples) [signal's unit].

        """
        squares = np.mean(innovations**2, axis=1) / self.innovation**2
        return np.mean(innovations, axis=1) / self.persistence, np.cbrt(squares)

    def root_mean_square(self, energy: float) -> float:
        """Return the root mean square of residuals that an energy stands for [signal's unit]."""
        return self.noise * math.sqrt(max(energy, 0.0) ** 3)


@dataclass(frozen=True)
class Baseline:
    """
    What is usual for a signal's residual.

    Attributes
    ----------
    weighing
        What a residual is worth.
    mean, energy
        What is usual for the means [signal's unit] and energies [-] of blocks.

    """

    weighing: Weighing
    mean: Series
    energy: Series


def learn(residuals: list[Array], rates: list[Array], tolerance: float | None = None) -> Baseline:
    """
    Return what is usual.

    Parameters
    ----------
    residuals, rates
        Of each block, at least `FEWEST_BLOCKS` of them, each of shape (samples,) [signal's unit, unit/s].
    tolerance
        How far the mean may stray for a lasting time [signal's unit]; None: as far as it did here, beyond chance.

    """
    ends = np.cumsum([one.size for one in residuals])[:-1]
    weighing, innovations = _weighing(np.concatenate(residuals), np.concatenate(rates), ends[_FEW - 1 :: _FEW])
    blocks = [weighing.features(block[None]) for block in np.split(innovations, ends)]
    means, energies = (np.array([float(block[index][0]) for block in blocks]) for index in (0, 1))
    samples = innovations.size / means.size
    if tolerance is None:
        tolerance = _wandering(means, weighing.innovation / weighing.persistence / math.sqrt(samples))
    return Baseline(weighing, usual(means, tolerance), usual(energies, _wandering(energies, _CUBE_ROOT / samples**0.5)))


def _weighing(residuals: Array, rates: Array, ends: NDArray[np.intp]) -> tuple[Weighing, Array]:
    """
    Return what residuals are worth, from samples of different rates, and what is new in each of them.

    Their memory is that of a sensor: what lasts from one of the stretches that end at `ends` to the next is left to
    the charts.
    """
    order = np.argsort(np.abs(rates), kind='stable')
    squares, ascending = (residuals[order] - np.median(residuals)) ** 2, rates[order]
    noise = max(float(np.mean(squares[: squares.size // 2])), LEAST_SPREAD**2)
    fast = slice(squares.size - max(int(_FAST * squares.size), 1), None)
    moved = float(np.sum(ascending[fast] ** 2))
    excess = max(float(np.sum(squares[fast] - noise)), 0.0)
    plain = Weighing(math.sqrt(noise), math.sqrt(excess / moved) if moved > 0.0 else 0.0)
    weighed = plain.weighed(residuals, rates)
    coefficients = autoregression([stretch - np.mean(stretch) for stretch in np.split(weighed, ends)])
    coloured = replace(plain, coefficients=coefficients)
    innovations = coloured.innovations(weighed, np.empty(0))
    return replace(coloured, innovation=max(float(np.std(innovations)), LEAST_SPREAD)), innovations


def _wandering(means: Array, by_chance: float) -> float:
    """Return how far slow means stray from their mean beyond chance, which is the standard deviation of a block's."""
    groups = means.size // _SLOW
    slow = np.mean(means[: groups * _SLOW].reshape(groups, _SLOW), axis=1) - np.mean(means)
    return max(0.0, float(np.max(np.abs(slow))) - _CHANCE * by_chance / math.sqrt(_SLOW))
