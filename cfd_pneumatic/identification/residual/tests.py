# SPDX-License-Identifier: Apache-2.0
"""
Test whether a residual is noise, or whether a better model could explain part of the residual.

Three tests hold for noise of any spectrum: dependence on the inputs (decisive for an output-error model), a line in the
spectrum, a moving mean. Two tests compare the residual with the noise at rest: autocorrelation and size.
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
from cfd_pneumatic.identification.residual.linear_prediction import (
    autocovariance,
    autoregression,
    autoregressive_series,
    whitened,
)
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.residual.normal_matrix import gram, orthonormal
from cfd_pneumatic.identification.residual.regressors import Regressors
from cfd_pneumatic.identification.residual.thresholds import (
    LARGEST_COLOURED_NOISE,
    LARGEST_EXPLAINED,
    LARGEST_EXPLAINED_NOISE,
    LARGEST_LINE_SHARE,
    LARGEST_SIZE_RATIO,
    LARGEST_SIZE_RATIO_LONG,
    LARGEST_SLOW_SHARE,
    LARGEST_SQUARED_CORRELATION,
    LEAST_SINGULAR_VALUE,
    LEVEL_ORDINATES,
    LINE_ALLOWANCE,
    LINE_WINDOW,
    LJUNG_BOX_LAGS,
    LJUNG_BOX_QUANTILE,
    LJUNG_BOX_SIMULATIONS,
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
    A test of a residual.

    Attributes
    ----------
    name
        Name in results.
    statistic, threshold
        The test fails if the statistic exceeds the threshold [-].
    what
        Meaning of the statistic.
    decisive
        Whether a failure means that the model lacks something; False if noise of unknown spectrum may be the reason.

    """

    name: str
    statistic: float
    threshold: float
    what: str
    decisive: bool = True

    @property
    def passed(self) -> bool:
        """Whether the residual passes as noise."""
        return self.statistic <= self.threshold


def is_noise(tests: Iterable[Test]) -> bool:
    """Return whether all decisive tests passed; no test after a failed test is computed."""
    return all(test.passed for test in tests if test.decisive)


def residual_tests(
    residuals: Sequence[Array], regressors: Sequence[Regressors], noise: Noise, refined: bool
) -> Iterator[Test]:
    """
    Yield the tests of residuals, the test of the size first; each test is computed when the caller requests it.

    Parameters
    ----------
    residuals
        Residual of each experiment at adjacent samples, shape (n,).
    regressors
        Signals that the residuals may depend on.
    noise
        Noise of the residuals.
    refined
        Whether the model has a core or effects. Their equations are approximations, which widens the tolerance.

    """
    yield _size_test(residuals, noise)
    if any(np.any(residual) for residual in residuals):
        for test in _tests_of_structure(residuals, regressors, noise, refined):
            yield (
                replace(test, decisive=False) if noise.rounded else test
            )  # rounding depends on the signal: only the size counts


def _tests_of_structure(
    residuals: Sequence[Array], regressors: Sequence[Regressors], noise: Noise, refined: bool
) -> Iterator[Test]:
    """Yield the tests that do not depend on the size of the residuals."""
    coefficients = autoregression(residuals)
    innovations = [whitened(residual, coefficients) for residual in residuals]
    approximation_share = LARGEST_EXPLAINED_NOISE * min((noise.std / _rms(residuals)) ** 2, 1.0) if refined else 0.0
    blur_share = noise.blur**2 / (noise.blur**2 + noise.std**2) if noise.blur else 0.0
    material = max(LARGEST_EXPLAINED, approximation_share, blur_share)
    yield _inputs_test(innovations, regressors, coefficients, material)
    yield _slow_inputs_test(residuals, regressors, material)
    spectra = [list(map(_periodogram, series)) for series in (residuals, _prewhitened(residuals))]
    yield _line_test(spectra)
    yield _level_test(spectra, sum(residual.size for residual in residuals))
    yield _whiteness_test(residuals, noise, approximation_share)


def _inputs_test(
    innovations: Sequence[Array], regressors: Sequence[Regressors], coefficients: Array, material: float
) -> Test:
    """Test how much of the innovations, the quick part of the residual, a regression on the inputs explains."""
    products, count = _innovation_products(innovations, regressors, coefficients)
    size = np.sqrt(np.diag(products))
    varying = np.flatnonzero(size[:-1])
    correlations, correlations_with_innovation = (
        products[varying][:, columns] / np.outer(size[varying], size[columns]) for columns in (varying, [-1])
    )
    directions = orthonormal(correlations, LEAST_SINGULAR_VALUE)
    share, rank = float(np.sum((directions.T @ correlations_with_innovation) ** 2)), directions.shape[1]
    significant = float(betaincinv(rank / 2.0, max(count - rank, 1) / 2.0, 1.0 - SIGNIFICANCE))
    threshold = max(significant, rank / count + material)
    return Test('inputs', share, threshold, 'share of the residual that a regression on the inputs explains')


def _slow_inputs_test(residuals: Sequence[Array], regressors: Sequence[Regressors], material: float) -> Test:
    """
    Test how much of the residual, slow parts included, a regression on the inputs explains.

    The share that coloured noise has by chance follows from all circular shifts of the residual against the inputs.
    """
    residual, columns = _decimated(residuals, regressors)
    basis = _orthonormal_basis(columns)
    spectra = np.fft.rfft(basis.T) * np.conj(np.fft.rfft(residual))
    shares = np.sum(np.fft.irfft(spectra, residual.size) ** 2, axis=0) / float(residual @ residual)
    threshold = float(np.quantile(shares, 1.0 - SHIFT_SIGNIFICANCE)) + material
    return Test(
        'slow_inputs', float(shares[0]), threshold, 'share of the residual, slow parts included, that inputs explain'
    )


def _innovation_products(
    innovations: Sequence[Array], regressors: Sequence[Regressors], coefficients: Array
) -> tuple[Array, int]:
    """
    Return the inner products of the whitened inputs and the innovations, (width + 1, width + 1), and their samples.

    The last row and column hold the innovations. Long recordings are sampled in stretches.
    """
    count = sum(series.size for series in innovations)
    stride = max(1, count // MOST_REGRESSED_SAMPLES)
    width = min(series.width(count) for series in regressors)
    products, used = np.zeros((width + 1, width + 1)), 0
    for innovation, regressor in zip(innovations, regressors):
        for begin in range(0, innovation.size, stride * REGRESSION_STRETCH):
            end = min(begin + REGRESSION_STRETCH, innovation.size)
            before = min(begin, coefficients.size)
            columns = whitened(regressor.values(begin - before, end, width), coefficients)[:, before:]
            products += gram(np.vstack([columns, innovation[begin:end]]))
            used += end - begin
    return products, used


def _decimated(residuals: Sequence[Array], regressors: Sequence[Regressors]) -> tuple[Array, Array]:
    """Return residuals (n,) and inputs (n, width), summed in groups if long, in a length quick to transform."""
    count = sum(series.size for series in residuals)
    width = min(series.width(count) for series in regressors)
    group = count / MOST_SLOW_SAMPLES if count > 2 * MOST_SLOW_SAMPLES else 1.0
    parts, columns = [], []
    for residual, regressor in zip(residuals, regressors):
        edges = np.linspace(0, residual.size, max(1, round(residual.size / group)) + 1).astype(np.intp)
        parts.append(np.add.reduceat(residual, edges[:-1]))
        columns.append(regressor.sums(edges, width))
    kept = _quick_length(sum(part.size for part in parts))
    return np.concatenate(parts)[:kept], np.concatenate(columns, axis=1).T[:kept]


def _quick_length(length: int) -> int:
    """Return the largest length up to a limit with a quick Fourier transform, a few percent less at most."""
    return next(
        candidate for candidate in range(length, 0, -1) if pow(30, candidate, candidate) == 0
    )  # only factors 2, 3 and 5


def _orthonormal_basis(columns: Array) -> Array:
    """Return an orthonormal basis of the span of columns, shape (n, rank)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    return np.asarray(scaled @ orthonormal(scaled.T @ scaled, LEAST_SINGULAR_VALUE))


def _line_test(spectra: Sequence[Sequence[Array]]) -> Test:
    """
    Test whether a line exceeds the adjacent spectrum, which is smooth in autoregressive noise.

    The slowest ordinates belong to the test of the level.
    """
    ratio, count = min(map(_line_ratio, spectra))
    # an ordinate has an exponential distribution, which the scatter of the adjacent median widens a little
    significant = LINE_ALLOWANCE * math.log(max(count, 1) / SIGNIFICANCE)
    threshold = max(significant, LARGEST_LINE_SHARE * count)
    return Test('line', ratio, threshold, 'largest line of the spectrum over the adjacent ordinates')


def _line_ratio(spectra: Sequence[Array]) -> tuple[float, int]:
    """Return the largest ratio of an ordinate to the adjacent ordinates, and the number of ordinates."""
    worst, count = 0.0, 0
    for power in spectra:
        if power.size > 2 * SLOW_ORDINATES:
            window = min(LINE_WINDOW, power.size // 2 * 2 - 1)
            background = median_filter(power, size=window, mode='reflect') / math.log(2.0)
            worst = max(worst, float(np.max((power / background)[SLOW_ORDINATES:])))
            count += power.size
    return worst, count


def _prewhitened(residuals: Sequence[Array]) -> list[Array]:
    """
    Return residuals whitened by a first-order autoregression.

    Whitening flattens the spectrum of noise that is correlated over a few samples. Lines and slower parts remain.
    """
    first = float(autocovariance(residuals, 1)[1] / autocovariance(residuals, 0)[0])
    coefficient = np.array([max(first, 0.0)])
    return [whitened(residual, coefficient) for residual in residuals]


def _level_test(spectra: Sequence[Sequence[Array]], count: int) -> Test:
    """Test whether the mean moves slowly, from the ratio of the slowest ordinates to the adjacent ordinates."""
    ratio, threshold = min(_level_ratio(series, count) for series in spectra)
    return Test('level', ratio, threshold, 'slowest ordinates of the spectrum over the adjacent ordinates')


def _level_ratio(spectra: Sequence[Array], count: int) -> tuple[float, float]:
    """Return the ratio of the mean slow ordinate to the mean adjacent ordinate, and its threshold."""
    slow: list[float] = []
    background: list[float] = []
    for power in spectra:
        if power.size > 4 * SLOW_ORDINATES:
            slow.extend(power[:SLOW_ORDINATES])
            background.extend(power[SLOW_ORDINATES:LEVEL_ORDINATES])
    if not slow:
        return 0.0, 1.0
    ratio = float(np.mean(slow) / np.mean(background))
    material = LARGEST_SLOW_SHARE * count / (2.0 * len(slow))
    return ratio, max(float(fdtri(2 * len(slow), 2 * len(background), 1.0 - SIGNIFICANCE)), material)


def _periodogram(residual: Array) -> Array:
    """Return the ordinates of the periodogram, without zero and the highest frequency."""
    power: Array = np.abs(np.fft.rfft(residual - np.mean(residual))[1 : (residual.size - 1) // 2 + 1]) ** 2
    return power


def _whiteness_test(residuals: Sequence[Array], noise: Noise, material: float) -> Test:
    """
    Test the autocorrelation by Ljung and Box, with a threshold from simulated noise as at rest.

    A part that makes a share `material` of the residual correlates adjacent samples by this share at most.
    """
    lengths = [min(residual.size, LONGEST_SIMULATED) for residual in residuals]
    significant = _significant_autocorrelation(tuple(lengths), tuple(noise.coefficients.tolist()))
    allowed = max(LARGEST_SQUARED_CORRELATION, LJUNG_BOX_LAGS * material**2)
    threshold = significant * (1.0 + NOISE_ALLOWANCE * noise.uncertainty) + allowed * sum(lengths)
    statistic = _ljung_box([residual[:length] for residual, length in zip(residuals, lengths)])
    description = "autocorrelation of the residual, Ljung and Box's Q"
    return Test('ljung_box', statistic, threshold, description, noise.known and noise.coefficients.size == 0)


@lru_cache(maxsize=64)
def _significant_autocorrelation(lengths: tuple[int, ...], coefficients: tuple[float, ...]) -> float:
    """Return the statistic that autoregressive noise hardly ever exceeds, from simulations."""
    rng = np.random.default_rng(_SEED)
    shape = np.array(coefficients, dtype=np.float64)
    simulated = [
        _ljung_box(
            [
                autoregressive_series(rng.standard_normal(SIMULATION_LEAD + length), shape)[SIMULATION_LEAD:]
                for length in lengths
            ]
        )
        for _ in range(LJUNG_BOX_SIMULATIONS)
    ]
    return float(np.mean(simulated) + LJUNG_BOX_QUANTILE * np.std(simulated))


def _ljung_box(series: Sequence[Array]) -> float:
    count = sum(run.size for run in series)
    covariance = autocovariance([run - np.mean(run) for run in series], min(LJUNG_BOX_LAGS, count // 4))
    correlation = covariance[1:] / covariance[0]
    return float(count * (count + 2.0) * np.sum(correlation**2 / (count - np.arange(1, correlation.size + 1))))


def _size_test(residuals: Sequence[Array], noise: Noise) -> Test:
    """Test whether the residual is larger than the noise."""
    ratio = _rms(residuals) / noise.std
    is_long = sum(residual.size for residual in residuals) >= LONG_RECORD
    largest = LARGEST_SIZE_RATIO_LONG if is_long else LARGEST_SIZE_RATIO
    limit = (ROUNDING_ALLOWANCE if noise.rounded else 1.0) * largest * (1.0 + NOISE_ALLOWANCE * noise.uncertainty)
    threshold = limit if noise.known else LARGEST_COLOURED_NOISE
    return Test('noise_floor', ratio, threshold, 'root mean square of the residual over the noise')


def _rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals together."""
    return math.sqrt(float(np.mean(np.concatenate(residuals) ** 2)))
