# SPDX-License-Identifier: Apache-2.0
"""Autoregression: how much a sample of noise says about the next, and how to take that out."""

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
    count = sum(one.size for one in series)
    products = np.zeros(lags + 1)
    for one in series:
        for lag in range(min(lags + 1, one.size)):
            products[lag] += float(one[lag:] @ one[: one.size - lag])
    return products / max(count, 1)


def autoregression(series: Sequence[Array]) -> Array:
    """
    Return coefficients c of e_t = sum c_k e_(t-k) + white noise, shape (order,), by Yule and Walker.

    Each order follows from the one before (Durbin, 1960).
    The order, up to `HIGHEST_ORDER`, has the least Bayesian information criterion; white noise, and none, have none.
    """
    count = sum(one.size for one in series)
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
    Return what is new in each sample of a series, shape (n,), or of several, shape (k, n).

    What came before the first is taken as zero.
    """
    innovations = series.copy()
    for lag, coefficient in enumerate(coefficients.tolist(), start=1):
        innovations[..., lag:] -= coefficient * series[..., :-lag]
    return innovations


@compiler(nogil=True)
def driven(innovations: Array, coefficients: Array) -> Array:
    """Return the series, shape (n,), in which innovations, shape (n,), are what is new; it begins at rest."""
    series = innovations.copy()
    for index in range(series.size):
        for lag in range(min(index, coefficients.size)):
            series[index] += coefficients[lag] * series[index - 1 - lag]
    return series


def independent_share(coefficients: Array) -> float:
    """Return how many independent samples a sample of autoregressive noise is worth, at most one [-]."""
    impulse = np.zeros(LONGEST_RESPONSE)
    impulse[0] = 1.0
    response = driven(impulse, np.asarray(coefficients))
    return float(np.clip(np.sum(response**2) * (1.0 - np.sum(coefficients)) ** 2, LEAST_INDEPENDENT_SHARE, 1.0))
