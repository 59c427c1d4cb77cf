# SPDX-License-Identifier: Apache-2.0
"""Autoregression of noise: estimate, whiten and simulate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.thresholds import (
    FEWEST_SAMPLES_PER_ORDER,
    HIGHEST_ORDER,
    LEAST_INDEPENDENT_SHARE,
    LEAST_INNOVATION,
    LONGEST_RESPONSE,
)
from cfd_pneumatic.runtime import compiler


def autocovariance(series: Sequence[Array], lags: int) -> Array:
    """Return the autocovariance of several series together at lags 0 to `lags`, shape (lags + 1,)."""
    count = sum(run.size for run in series)
    products = np.zeros(lags + 1)
    for run in series:
        for lag in range(min(lags + 1, run.size)):
            products[lag] += float(run[lag:] @ run[: run.size - lag])
    return products / max(count, 1)


def autoregression(series: Sequence[Array]) -> Array:
    """
    Return coefficients c of e_t = sum c_k e_(t-k) + white noise, shape (order,), by Yule and Walker.

    The order, up to `HIGHEST_ORDER`, has the least Bayesian information criterion. The result is empty for white noise
    and for zeros. Each order follows from the order before (Durbin, 1960).
    """
    count = sum(run.size for run in series)
    highest = min(HIGHEST_ORDER, count // FEWEST_SAMPLES_PER_ORDER)
    covariance = autocovariance(series, highest)
    best = coefficients = np.empty(0)
    innovation = float(covariance[0])
    if innovation == 0.0:
        return best
    lowest = count * np.log(innovation)
    for order in range(1, highest + 1):
        unexplained = covariance[order] - coefficients @ covariance[order - 1 : 0 : -1]
        reflection = unexplained / max(innovation, LEAST_INNOVATION)
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        innovation *= 1.0 - reflection**2
        criterion = count * np.log(max(innovation, LEAST_INNOVATION)) + order * np.log(count)
        if criterion < lowest:
            best, lowest = coefficients, criterion
    return best


def whitened(series: Array, coefficients: Array) -> Array:
    """
    Return the innovations of a series, shape (n,), or of several series, shape (k, n).

    Samples before the first sample count as zero.
    """
    innovations = series.copy()
    for lag, coefficient in enumerate(coefficients.tolist(), start=1):
        innovations[..., lag:] -= coefficient * series[..., :-lag]
    return innovations


@compiler(nogil=True)
def autoregressive_series(innovations: Array, coefficients: Array) -> Array:
    """Return the autoregressive series of innovations, both of shape (n,); the series begins at rest."""
    series = innovations.copy()
    for index in range(series.size):
        for lag in range(min(index, coefficients.size)):
            series[index] += coefficients[lag] * series[index - 1 - lag]
    return series


def independent_share(coefficients: Array) -> float:
    """Return the number of independent samples per sample of autoregressive noise, at most 1 [-]."""
    response = _impulse_response(coefficients)
    return float(np.clip(np.sum(response**2) * (1.0 - np.sum(coefficients)) ** 2, LEAST_INDEPENDENT_SHARE, 1.0))


def variance_of_mean(coefficients: Array, count: int) -> float:
    """Return the variance of the mean of adjacent samples of autoregressive noise [variance of a sample]."""
    response = _impulse_response(coefficients)
    of_mean = np.convolve(response, np.full(count, 1.0 / count))
    return float(np.sum(of_mean**2) / np.sum(response**2))


def _impulse_response(coefficients: Array) -> Array:
    """Return the response of autoregressive noise to an innovation of 1, shape (n,) [-]."""
    impulse = np.zeros(LONGEST_RESPONSE)
    impulse[0] = 1.0
    return np.asarray(autoregressive_series(impulse, np.asarray(coefficients)))
