"""What a model usually leaves of a signal, learned from a stretch in which the device is as it should be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.colour import autoregression, whitened
from cfd_pneumatic.monitoring.chart import Series, usual

Array = NDArray[np.float64]

_FAST = 0.1  # share of the samples, those where the signal changes fastest, that tell what its timing is worth
_SLOW = 25  # blocks over which a mean is slow
_CHANCE = 3.0  # standard deviations that such a mean may stray by chance
_LONGEST_SERIES = 20_000  # samples: enough for the colour of a sensor's noise
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

    """

    noise: float
    timing: float

    def weighed(self, residuals: Array, rates: Array) -> Array:
        """Return residuals that spread alike at any rate of the signal, of the given shape, in its unit."""
        weighed: Array = residuals / np.sqrt(1.0 + (self.timing * rates / self.noise) ** 2)
        return weighed

    def features(self, residuals: Array, rates: Array) -> tuple[Array, Array]:
        """
        Return mean and energy of blocks, each of shape (blocks,).

        The energy is the cube root of the mean square over the noise's: nearly normal (Wilson and Hilferty, 1931).

        Parameters
        ----------
        residuals, rates
            Residuals [signal's unit] and rates of the signal [unit/s], shape (blocks, samples).

        """
        weighed = self.weighed(residuals, rates)
        return np.mean(weighed, axis=1), np.cbrt(np.mean(weighed**2, axis=1) / self.noise**2)

    def root_mean_square(self, energy: float) -> float:
        """Return the root mean square that an energy stands for [signal's unit]."""
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
    weighing = _weighing(np.concatenate(residuals), np.abs(np.concatenate(rates)))
    blocks = [weighing.features(one[None], rate[None]) for one, rate in zip(residuals, rates)]
    means, energies = (np.array([float(block[index][0]) for block in blocks]) for index in (0, 1))
    if tolerance is None:
        weighed = weighing.weighed(np.concatenate(residuals), np.concatenate(rates))
        tolerance = _wandering(means, _long_run_std(weighed) / math.sqrt(weighed.size / means.size))
    return Baseline(weighing, usual(means, tolerance), usual(energies))


def _weighing(residuals: Array, rates: Array) -> Weighing:
    """Return noise at rest and timing from samples of different rates."""
    order = np.argsort(rates, kind='stable')
    squares, rates = (residuals[order] - np.median(residuals)) ** 2, rates[order]
    noise = max(float(np.mean(squares[: squares.size // 2])), np.finfo(float).tiny)
    fast = slice(squares.size - max(int(_FAST * squares.size), 1), None)
    moved = float(np.sum(rates[fast] ** 2))
    excess = float(np.sum(squares[fast] - noise))
    return Weighing(math.sqrt(noise), math.sqrt(max(excess, 0.0) / moved) if moved > 0.0 else 0.0)


def _long_run_std(residuals: Array) -> float:
    """Return the standard deviation of a mean of residuals times the root of their number, by their quick part."""
    series = residuals[:_LONGEST_SERIES] - np.mean(residuals[:_LONGEST_SERIES])
    colour = autoregression([series])
    return float(np.std(whitened(series, colour)[colour.size :])) / max(1.0 - float(np.sum(colour)), 0.05)


def _wandering(means: Array, by_chance: float) -> float:
    """Return how far slow means stray from their mean beyond chance, which is the standard deviation of a block's."""
    groups = means.size // _SLOW
    slow = np.mean(means[: groups * _SLOW].reshape(groups, _SLOW), axis=1) - np.mean(means)
    return max(0.0, float(np.max(np.abs(slow))) - _CHANCE * by_chance / math.sqrt(_SLOW))
