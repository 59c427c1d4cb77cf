# SPDX-License-Identifier: Apache-2.0
"""The usual residual of a signal, learned while the device is healthy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import autoregression, whitened
from cfd_pneumatic.monitoring.chart import LEAST_SPREAD, SeriesModel, learn_series

_FAST_SHARE = 0.1  # share of the samples with the fastest changes, from which the timing error is estimated
_DRIFT_BLOCKS = 25  # blocks over which drift is averaged
_CHANCE_LIMIT = 3.0  # standard deviations by which such an average may differ by chance
_LEAST_DC_GAIN = 0.02
_STRETCH_BLOCKS = 5  # blocks in a stretch: longer than the autocorrelation of a sensor
_CUBE_ROOT_STD = math.sqrt(2.0 / 9.0)  # of the cube root of a mean square, times the root of the samples
FEWEST_BLOCKS = 100


@dataclass(frozen=True)
class NoiseModel:
    """
    The noise of a residual: its size, its growth with the rate of the signal, and its autocorrelation.

    Attributes
    ----------
    noise
        Standard deviation while the signal rests [signal's unit].
    timing
        Growth of the residual with the signal's rate [s]: jitter of the stamps, and delay of the model.
    coefficients
        Autoregression of the weighted residuals from sample to sample, as `autoregression` returns it.
    innovation
        Standard deviation of the innovations [signal's unit].

    """

    noise: float
    timing: float
    coefficients: Array = field(default_factory=lambda: np.empty(0))
    innovation: float = 1.0

    @property
    def dc_gain(self) -> float:
        """DC gain of the whitening filter: innovation over lasting shift [-]."""
        return max(1.0 - float(np.sum(self.coefficients)), _LEAST_DC_GAIN)

    def weighted(self, residuals: Array, rates: Array) -> Array:
        """Return residuals with the same variance at any rate of the signal [signal's unit], shape (n,)."""
        weighted: Array = residuals / np.sqrt(1.0 + (self.timing * rates / self.noise) ** 2)
        return weighted

    def innovations(self, weighted: Array, before: Array) -> Array:
        """Whiten weighted residuals, shape (n,), given the residuals before them; missing ones count as zero."""
        order = self.coefficients.size
        history = np.concatenate([np.zeros(order), before])[before.size :]
        return whitened(np.concatenate([history, weighted]), self.coefficients)[order:]

    def features(self, innovations: Array) -> tuple[Array, Array]:
        """
        Return mean and energy of blocks, each of shape (blocks,).

        The mean is the mean innovation over the DC gain. The energy is the cube root of the innovations' mean square
        over the usual mean square: nearly normal (Wilson and Hilferty, 1931).

        Parameters
        ----------
        innovations
            Shape (blocks, samples) [signal's unit].

        """
        squares = np.mean(innovations**2, axis=1) / self.innovation**2
        return np.mean(innovations, axis=1) / self.dc_gain, np.cbrt(squares)

    def root_mean_square(self, energy: float) -> float:
        """Return the root mean square of the residuals from an energy [signal's unit]."""
        return self.noise * math.sqrt(max(energy, 0.0) ** 3)


@dataclass(frozen=True)
class Baseline:
    """
    The usual residual of a signal.

    Attributes
    ----------
    noise_model
        Noise of the residual.
    mean, energy
        Usual means [signal's unit] and energies [-] of blocks.

    """

    noise_model: NoiseModel
    mean: SeriesModel
    energy: SeriesModel


def learn_baseline(residuals: list[Array], rates: list[Array], tolerance: float | None = None) -> Baseline:
    """
    Learn the usual residual from blocks of a healthy device.

    Parameters
    ----------
    residuals, rates
        One array for each of at least `FEWEST_BLOCKS` blocks, shape (samples,) [signal's unit, unit/s].
    tolerance
        Accepted lasting shift of the mean [signal's unit]; None: the drift in these blocks beyond chance.

    """
    ends = np.cumsum([block.size for block in residuals])[:-1]
    noise_model, innovations = _fit_noise_model(
        np.concatenate(residuals), np.concatenate(rates), ends[_STRETCH_BLOCKS - 1 :: _STRETCH_BLOCKS]
    )
    blocks = [noise_model.features(block[None]) for block in np.split(innovations, ends)]
    means, energies = (np.array([float(block[index][0]) for block in blocks]) for index in (0, 1))
    samples = innovations.size / means.size
    if tolerance is None:
        tolerance = _drift_beyond_chance(means, noise_model.innovation / noise_model.dc_gain / math.sqrt(samples))
    return Baseline(
        noise_model,
        learn_series(means, tolerance),
        learn_series(energies, _drift_beyond_chance(energies, _CUBE_ROOT_STD / samples**0.5)),
    )


def _fit_noise_model(residuals: Array, rates: Array, ends: NDArray[np.intp]) -> tuple[NoiseModel, Array]:
    """
    Estimate the noise of residuals; return the noise model and the innovations.

    The autoregression covers the sensor's memory only: each stretch up to one of the `ends` is centred first. The
    charts handle slower changes.
    """
    order = np.argsort(np.abs(rates), kind='stable')
    squares, sorted_rates = (residuals[order] - np.median(residuals)) ** 2, rates[order]
    noise = max(float(np.mean(squares[: squares.size // 2])), LEAST_SPREAD**2)
    fast = slice(squares.size - max(int(_FAST_SHARE * squares.size), 1), None)
    fast_energy = float(np.sum(sorted_rates[fast] ** 2))
    excess = max(float(np.sum(squares[fast] - noise)), 0.0)
    white = NoiseModel(math.sqrt(noise), math.sqrt(excess / fast_energy) if fast_energy > 0.0 else 0.0)
    weighted = white.weighted(residuals, rates)
    coefficients = autoregression([stretch - np.mean(stretch) for stretch in np.split(weighted, ends)])
    coloured = replace(white, coefficients=coefficients)
    innovations = coloured.innovations(weighted, np.empty(0))
    return replace(coloured, innovation=max(float(np.std(innovations)), LEAST_SPREAD)), innovations


def _drift_beyond_chance(means: Array, chance_std: float) -> float:
    """Return the largest drift of averaged means beyond chance, given the standard deviation of a block's mean."""
    groups = means.size // _DRIFT_BLOCKS
    slow = np.mean(means[: groups * _DRIFT_BLOCKS].reshape(groups, _DRIFT_BLOCKS), axis=1) - np.mean(means)
    return max(0.0, float(np.max(np.abs(slow))) - _CHANCE_LIMIT * chance_std / math.sqrt(_DRIFT_BLOCKS))
