# SPDX-License-Identifier: Apache-2.0
"""Standard errors and covariances from a Jacobian and residuals that may be correlated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.fit.thresholds import FINEST_LAGS, LEAST_CORRELATION, LEAST_DETERMINED


@dataclass(frozen=True, eq=False)
class Covariance:
    """
    Covariance of the parameters of a channel.

    Attributes
    ----------
    names
        Names of the parameters: `k_x`, `EFFECT.PARAMETER`, `setpoint_offset`.
    matrix
        Covariance, shape (k, k) [product of both parameters' SI units].

    """

    names: tuple[str, ...]
    matrix: Array


@dataclass(frozen=True)
class Information:
    """
    Information of residuals about unknowns.

    Attributes
    ----------
    normal
        J'J, shape (k, k).
    scores
        Covariance of J'r by Newey and West, shape (k, k); None if the residual is white.
    power
        r'r.
    size
        Number of residuals.

    """

    normal: Array
    scores: Array | None
    power: float
    size: int

    def with_prior(self, precision: Array) -> Information:
        """Return the information with a prior of each unknown, of given precision, shape (k,)."""
        prior = np.diag(precision) * (self.power / self.size)
        scores = None if self.scores is None else self.scores + prior * (self.power / self.size)
        return replace(self, normal=self.normal + prior, scores=scores)

    def covariance(self, degrees: int, free: NDArray[np.intp] | None = None) -> Array:
        """
        Return the covariance of the unknowns, or of the free unknowns while the others are held.

        For a white residual this is (J'J)^-1 times the residual variance. Smoothed noise of the displacement, or an
        effect that the model lacks, correlates the residual, so that a sample has less information. The covariance then
        is the sandwich of Newey and West (1987) with a Bartlett window.
        """
        kept = np.arange(len(self.normal)) if free is None else free
        block = kept[:, None], kept
        normal = self.normal[block]
        scale = np.sqrt(np.diag(normal))
        scale[scale == 0.0] = 1.0  # without scaling, metres and hertz would look like a singular matrix
        units = np.outer(scale, scale)
        values, vectors = np.linalg.eigh(normal / units)
        determined = values > LEAST_DETERMINED * np.max(values, initial=0.0)
        inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T / units
        if self.scores is None:
            return np.asarray(inverse * self.power / degrees)
        return np.asarray(inverse @ self.scores[block] @ inverse * (self.size / degrees))


def information(jacobians: Iterable[Array], residuals: Sequence[Array]) -> Information:
    """
    Return the information of residuals about unknowns, in a single pass over the Jacobian.

    Parameters
    ----------
    jacobians
        The Jacobian in blocks of rows, in order; no block crosses the end of a run.
    residuals
        Runs of adjacent residuals, each of shape (n,).

    """
    power = sum(float(run @ run) for run in residuals)
    size = sum(run.size for run in residuals)
    lags = _correlation_length(residuals, power)
    runs = iter(residuals)
    run, position = np.empty(0), 0
    normal: Array | float = 0.0
    scores: Array | float = 0.0
    window = _Window(lags)
    for jacobian in jacobians:
        if not len(jacobian):
            continue
        while position == run.size:
            run, position = next(runs), 0
        rows = slice(position, position + len(jacobian))
        position = rows.stop
        normal = normal + jacobian.T @ jacobian
        if lags:
            scores = scores + window.products(jacobian * run[rows, None], position == run.size)
    return Information(np.asarray(normal), np.asarray(scores) if lags else None, power, size)


class _Window:
    """
    Bartlett's window over scores that arrive in blocks.

    Long windows use sums of adjacent scores, because the length of the window matters to a few percent only.
    """

    def __init__(self, lags: int) -> None:
        self.group = max(1, lags // FINEST_LAGS)
        self.lags = max(1, lags // self.group)
        self.last: Array | None = None

    def products(self, scores: Array, ends: bool) -> Array:
        """Return the sum of the weighted products that end in a block; `ends` is True for the last block of a run."""
        summed = np.add.reduceat(scores, np.arange(0, len(scores), self.group)) if self.group > 1 else scores
        before = np.zeros((self.lags + 1, scores.shape[1])) if self.last is None else self.last
        after = np.zeros((self.lags if ends else 0, scores.shape[1]))
        series = np.concatenate([before, summed, after])
        # sums over each window of lags + 1 scores weight the products by the Bartlett window
        total = np.cumsum(series, axis=0)
        windows = total[self.lags + 1 :] - total[: -self.lags - 1]
        self.last = None if ends else series[-self.lags - 1 :]
        return np.asarray(windows.T @ windows / (self.lags + 1.0))


def _correlation_length(runs: Sequence[Array], power: float) -> int:
    """Return the number of samples over which residuals are correlated, 0 if the first lag's correlation is noise."""
    significance = LEAST_CORRELATION / math.sqrt(sum(run.size for run in runs))
    longest = max(1, min(run.size for run in runs) // 4)

    def correlation(lag: int) -> float:
        return sum(float(run[lag:] @ run[:-lag]) for run in runs) / power

    if power == 0.0 or abs(correlation(1)) < significance:
        return 0
    lag = 1
    while lag < longest and correlation(lag) > significance:
        lag += max(1, lag // 8)
    return min(2 * lag, longest)
