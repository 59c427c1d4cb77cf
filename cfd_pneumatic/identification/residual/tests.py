# SPDX-License-Identifier: Apache-2.0
"""
What is left of the measured pressure: whether a model that knew more could explain it.

A residual is asked for what it would show if the model lacked something. Does it depend on the inputs (what counts for
an output-error model)? Does a line stand out of its spectrum? Does its mean move? These are asked of noise of any
spectrum. Does it resemble itself more than the noise does, and is it larger? That is asked against the noise at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import betaincinv, fdtri

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.linear_prediction import autocovariance, autoregression, driven, whitened
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.residual.normal_matrix import gram, orthonormal
from cfd_pneumatic.identification.residual.regressors import Regressors
from cfd_pneumatic.identification.residual.thresholds import (
    LARGEST_COLOURED_NOISE,
    LARGEST_EXPLAINED,
    LARGEST_EXPLAINED_NOISE,
    LARGEST_LIKENESS,
    LARGEST_LINE_SHARE,
    LARGEST_SIZE_RATIO,
    LARGEST_SIZE_RATIO_LONG,
    LARGEST_SLOW_SHARE,
    LEAST_SINGULAR_VALUE,
    LEVEL_ORDINATES,
    LIKENESS_LAGS,
    LIKENESS_QUANTILE,
    LIKENESS_SIMULATIONS,
    LINE_ALLOWANCE,
    LINE_WINDOW,
    LONG_RECORD,
    LONGEST_SIMULATED,
    MOST_REGRESSED_SAMPLES,
    MOST_SLOW_SAMPLES,
    NOISE_ALLOWANCE,
    REGRESSION_STRETCH,
    ROUNDING_ALLOWANCE,
    SHIFT_SIGNIFICANCE,
    SIGNIFICANCE,
    SIMULATION_LEAD,
    SLOW_ORDINATES,
)

_SEED = 1  # of the simulated thresholds


@dataclass(frozen=True)
class Test:
    """
    One test of a residual.

    Attributes
    ----------
    name
        What it asks for.
    statistic, threshold
        It fails where the statistic exceeds the threshold [-].
    what
        The statistic in words.
    decisive
        Whether a failure means that the model lacks something; it doesn't where noise of unknown spectrum may be the
        reason.

    """

    name: str
    statistic: float
    threshold: float
    what: str
    decisive: bool = True

    @property
    def passed(self) -> bool:
        """Whether the residual is as noise would be."""
        return self.statistic <= self.threshold


def is_noise(tests: Iterable[Test]) -> bool:
    """Return whether a residual is as noise would be, as far as can be told; a test that fails is the last one made."""
    return all(test.passed for test in tests if test.decisive)


def tests_of(
    residuals: Sequence[Array], regressors: Sequence[Regressors], noise: Noise, refined: bool
) -> Iterator[Test]:
    """
    Yield the tests of residuals, whatever they are of: that of the size first, and each when it is asked for.

    Parameters
    ----------
    residuals
        Of each experiment, at neighbouring samples, shape (n,).
    regressors
        What they may depend on.
    noise
        Of the residuals.
    refined
        Whether the model has a core or effects. Their laws are approximations: what these leave counts for less.

    """
    yield _size_test(residuals, noise)
    if any(np.any(residual) for residual in residuals):
        for test in _tests_of_kind(residuals, regressors, noise, refined):
            yield replace(test, decisive=False) if noise.rounded else test  # that depends on the signal: its size tells


def _tests_of_kind(
    residuals: Sequence[Array], regressors: Sequence[Regressors], noise: Noise, refined: bool
) -> Iterator[Test]:
    """Yield the tests of what residuals are like, whatever their size."""
    coefficients = autoregression(residuals)
    innovations = [whitened(residual, coefficients) for residual in residuals]
    beside = LARGEST_EXPLAINED_NOISE * min((noise.std / _size(residuals)) ** 2, 1.0) if refined else 0.0
    blurred = noise.blur**2 / (noise.blur**2 + noise.std**2) if noise.blur else 0.0
    material = max(LARGEST_EXPLAINED, beside, blurred)
    yield _inputs_test(innovations, regressors, coefficients, material)
    yield _slow_inputs_test(residuals, regressors, material)
    spectra = [list(map(_periodogram, series)) for series in (residuals, _forgotten(residuals))]
    yield _line_test(spectra)
    yield _level_test(spectra, sum(residual.size for residual in residuals))
    yield _whiteness_test(residuals, noise, beside)


def _inputs_test(
    innovations: Sequence[Array], regressors: Sequence[Regressors], coefficients: Array, material: float
) -> Test:
    """Ask how much of what is new in each sample a regression on the inputs explains: the quick part."""
    common, count = _common(innovations, regressors, coefficients)
    size = np.sqrt(np.diag(common))
    varying = np.flatnonzero(size[:-1])
    alike, shared = (common[varying][:, rest] / np.outer(size[varying], size[rest]) for rest in (varying, [-1]))
    directions = orthonormal(alike, LEAST_SINGULAR_VALUE)
    share, rank = float(np.sum((directions.T @ shared) ** 2)), directions.shape[1]
    significant = float(betaincinv(rank / 2.0, max(count - rank, 1) / 2.0, 1.0 - SIGNIFICANCE))
    threshold = max(significant, rank / count + material)
    return Test('inputs', share, threshold, 'share of the residual that a regression on the inputs explains')


def _slow_inputs_test(residuals: Sequence[Array], regressors: Sequence[Regressors], material: float) -> Test:
    """
    Ask how much of the residual as it is a regression on the inputs explains, slow parts and all.

    What chance explains of noise with a memory is seen from the same residual against the inputs of other times: all
    circular shifts of it.
    """
    residual, columns = _slow_parts(residuals, regressors)
    basis = _orthogonal(columns)
    spectra = np.fft.rfft(basis.T) * np.conj(np.fft.rfft(residual))
    shares = np.sum(np.fft.irfft(spectra, residual.size) ** 2, axis=0) / float(residual @ residual)
    threshold = float(np.quantile(shares, 1.0 - SHIFT_SIGNIFICANCE)) + material
    return Test(
        'slow_inputs', float(shares[0]), threshold, 'share of the residual, slow parts too, that inputs explain'
    )


def _common(innovations: Sequence[Array], regressors: Sequence[Regressors], coefficients: Array) -> tuple[Array, int]:
    """
    Return the products of the whitened inputs with each other and with what is new, and of how many samples they are.

    The last row and column, shape (width + 1, width + 1), are what is new. Of long recordings they are of stretches.
    """
    count = sum(one.size for one in innovations)
    every = max(1, count // MOST_REGRESSED_SAMPLES)
    width = min(one.width(count) for one in regressors)
    common, asked = np.zeros((width + 1, width + 1)), 0
    for new, own in zip(innovations, regressors):
        for begin in range(0, new.size, every * REGRESSION_STRETCH):
            end = min(begin + REGRESSION_STRETCH, new.size)
            before = min(begin, coefficients.size)
            columns = whitened(own.values(begin - before, end, width), coefficients)[:, before:]
            common += gram(np.vstack([columns, new[begin:end]]))
            asked += end - begin
    return common, asked


def _slow_parts(residuals: Sequence[Array], regressors: Sequence[Regressors]) -> tuple[Array, Array]:
    """Return the residuals and the inputs, of long recordings the sums of neighbours, but for a few at the end."""
    count = sum(one.size for one in residuals)
    width = min(one.width(count) for one in regressors)
    together = count / MOST_SLOW_SAMPLES if count > 2 * MOST_SLOW_SAMPLES else 1.0
    parts, columns = [], []
    for residual, own in zip(residuals, regressors):
        edges = np.linspace(0, residual.size, max(1, round(residual.size / together)) + 1).astype(np.intp)
        parts.append(np.add.reduceat(residual, edges[:-1]))
        columns.append(own.sums(edges, width))
    kept = _quick(sum(part.size for part in parts))
    return np.concatenate(parts)[:kept], np.concatenate(columns, axis=1).T[:kept]


def _quick(length: int) -> int:
    """Return the longest length up to one whose Fourier transform is quick: a few hundredths less at most."""
    return next(one for one in range(length, 0, -1) if pow(30, one, one) == 0)  # of 2, 3 and 5 alone


def _orthogonal(columns: Array) -> Array:
    """Return an orthonormal basis of what columns span, those that are zero left out, shape (n, rank)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    return np.asarray(scaled @ orthonormal(scaled.T @ scaled, LEAST_SINGULAR_VALUE))


def _line_test(spectra: Sequence[Sequence[Array]]) -> Test:
    """
    Ask whether one line stands out of the spectrum beside it, which is smooth in autoregressive noise.

    The slowest ordinates are the level's.
    """
    worst, count = min(map(_line_ratio, spectra))
    # an ordinate is exponential, and its neighbours' median spreads it a little
    significant = LINE_ALLOWANCE * math.log(max(count, 1) / SIGNIFICANCE)
    threshold = max(significant, LARGEST_LINE_SHARE * count)
    return Test('line', worst, threshold, 'largest line of the spectrum over its neighbours')


def _line_ratio(spectra: Sequence[Array]) -> tuple[float, int]:
    """Return the largest ordinate over those beside it, and how many there are."""
    worst, count = 0.0, 0
    for power in spectra:
        if power.size > 2 * SLOW_ORDINATES:
            window = min(LINE_WINDOW, power.size // 2 * 2 - 1)
            beside = median_filter(power, size=window, mode='reflect') / math.log(2.0)
            worst = max(worst, float(np.max((power / beside)[SLOW_ORDINATES:])))
            count += power.size
    return worst, count


def _forgotten(residuals: Sequence[Array]) -> list[Array]:
    """
    Return residuals less what the sample before tells of each.

    That flattens the spectrum of noise with a memory of a few samples, and leaves lines, and what is slower than any
    such memory, where they are.
    """
    first = float(autocovariance(residuals, 1)[1] / autocovariance(residuals, 0)[0])
    memory = np.array([max(first, 0.0)])
    return [whitened(residual, memory) for residual in residuals]


def _level_test(spectra: Sequence[Sequence[Array]], count: int) -> Test:
    """Ask whether the mean of so many samples moves slowly: the slowest ordinates against those beside them."""
    ratio, threshold = min(_slow_ratio(one, count) for one in spectra)
    return Test('level', ratio, threshold, 'slowest ordinates of the spectrum over those beside them')


def _slow_ratio(spectra: Sequence[Array], count: int) -> tuple[float, float]:
    """Return the mean slow ordinate over the mean of those beside, and its threshold."""
    slow: list[float] = []
    beside: list[float] = []
    for power in spectra:
        if power.size > 4 * SLOW_ORDINATES:
            slow.extend(power[:SLOW_ORDINATES])
            beside.extend(power[SLOW_ORDINATES:LEVEL_ORDINATES])
    if not slow:
        return 0.0, 1.0
    ratio = float(np.mean(slow) / np.mean(beside))
    material = LARGEST_SLOW_SHARE * count / (2.0 * len(slow))
    return ratio, max(float(fdtri(2 * len(slow), 2 * len(beside), 1.0 - SIGNIFICANCE)), material)


def _periodogram(residual: Array) -> Array:
    """Return the ordinates of the periodogram, without frequency zero and the last."""
    power: Array = np.abs(np.fft.rfft(residual - np.mean(residual))[1 : (residual.size - 1) // 2 + 1]) ** 2
    return power


def _whiteness_test(residuals: Sequence[Array], noise: Noise, material: float) -> Test:
    """
    Ljung and Box's test, against what noise as at rest makes.

    What makes a `material` share of the residual, however slow it is, correlates neighbours by that share at most.
    """
    lengths = [min(residual.size, LONGEST_SIMULATED) for residual in residuals]
    significant = _significant_likeness(tuple(lengths), tuple(noise.coefficients.tolist()))
    likeness = max(LARGEST_LIKENESS, LIKENESS_LAGS * material**2)
    threshold = significant * (1.0 + NOISE_ALLOWANCE * noise.uncertainty) + likeness * sum(lengths)
    statistic = _ljung_box([residual[:length] for residual, length in zip(residuals, lengths)])
    what = "likeness of neighbouring residuals, Ljung and Box's Q"
    return Test('ljung_box', statistic, threshold, what, noise.known and noise.coefficients.size == 0)


@lru_cache(maxsize=64)
def _significant_likeness(lengths: tuple[int, ...], coefficients: tuple[float, ...]) -> float:
    """Return what autoregressive noise hardly ever exceeds, from simulations of it."""
    rng = np.random.default_rng(_SEED)
    shape = np.array(coefficients, dtype=np.float64)
    simulated = [
        _ljung_box(
            [driven(rng.standard_normal(SIMULATION_LEAD + length), shape)[SIMULATION_LEAD:] for length in lengths]
        )
        for _ in range(LIKENESS_SIMULATIONS)
    ]
    return float(np.mean(simulated) + LIKENESS_QUANTILE * np.std(simulated))


def _ljung_box(series: Sequence[Array]) -> float:
    count = sum(one.size for one in series)
    covariance = autocovariance([one - np.mean(one) for one in series], min(LIKENESS_LAGS, count // 4))
    correlation = covariance[1:] / covariance[0]
    return float(count * (count + 2.0) * np.sum(correlation**2 / (count - np.arange(1, correlation.size + 1))))


def _size_test(residuals: Sequence[Array], noise: Noise) -> Test:
    """Compare the residual's size with the noise's."""
    ratio = _size(residuals) / noise.std
    is_long = sum(residual.size for residual in residuals) >= LONG_RECORD
    largest = LARGEST_SIZE_RATIO_LONG if is_long else LARGEST_SIZE_RATIO
    known = (ROUNDING_ALLOWANCE if noise.rounded else 1.0) * largest * (1.0 + NOISE_ALLOWANCE * noise.uncertainty)
    threshold = known if noise.known else LARGEST_COLOURED_NOISE
    return Test('noise_floor', ratio, threshold, 'root mean square of the residual over that of the noise')


def _size(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals."""
    return math.sqrt(float(np.mean(np.concatenate(residuals) ** 2)))
