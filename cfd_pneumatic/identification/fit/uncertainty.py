# SPDX-License-Identifier: Apache-2.0
"""Standard errors from a Jacobian and residuals that may be correlated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.fit.thresholds import FINEST_LAGS, LEAST_CORRELATION, LEAST_DETERMINED


@dataclass(frozen=True)
class Information:
    """
    What residuals tell about unknowns.

    Attributes
    ----------
    normal
        J'J, shape (k, k).
    scores
        Covariance of J'r by Newey and West, shape (k, k); None where the residual is white.
    power
        r'r.
    size
        How many residuals there are.

    """

    normal: Array
    scores: Array | None
    power: float
    size: int

    def beside_prior(self, precision: Array) -> Information:
        """Return it beside what is known of each unknown beforehand, as precisely as said, shape (k,)."""
        known = np.diag(precision) * (self.power / self.size)
        scores = None if self.scores is None else self.scores + known * (self.power / self.size)
        return replace(self, normal=self.normal + known, scores=scores)

    def covariance(self, degrees: int, free: NDArray[np.intp] | None = None) -> Array:
        """
        Return the covariance of the unknowns, or of those that are free while the others are held.

        (J'J)^-1 times the residual variance where the residual is white. Where neighbouring residuals are correlated,
        by the displacement's smoothed noise or by an effect that the model lacks, each of them tells less: the sandwich
        of Newey and West (1987) with a Bartlett window.
        """
        kept = np.arange(len(self.normal)) if free is None else free
        at = kept[:, None], kept
        normal = self.normal[at]
        size = np.sqrt(np.diag(normal))
        size[size == 0.0] = 1.0  # metres and hertz side by side would pass for a matrix without full rank
        units = np.outer(size, size)
        values, vectors = np.linalg.eigh(normal / units)
        determined = values > LEAST_DETERMINED * np.max(values, initial=0.0)
        inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T / units
        if self.scores is None:
            return np.asarray(inverse * self.power / degrees)
        return np.asarray(inverse @ self.scores[at] @ inverse * (self.size / degrees))


def information(jacobians: Iterable[Array], residuals: Sequence[Array]) -> Information:
    """
    Return what residuals tell about unknowns, in one walk over their Jacobian.

    Parameters
    ----------
    jacobians
        The Jacobian in blocks of rows, in order; none reaches over the end of a run.
    residuals
        Runs of neighbouring residuals, each of shape (n,).

    """
    power = sum(float(run @ run) for run in residuals)
    size = sum(run.size for run in residuals)
    lags = _correlation_length(residuals, power)
    runs = iter(residuals)
    run, at = np.empty(0), 0
    normal: Array | float = 0.0
    scores: Array | float = 0.0
    window = _Window(lags)
    for jacobian in jacobians:
        if not len(jacobian):
            continue
        while at == run.size:
            run, at = next(runs), 0
        rows = slice(at, at + len(jacobian))
        at = rows.stop
        normal = normal + jacobian.T @ jacobian
        if lags:
            scores = scores + window.products(jacobian * run[rows, None], at == run.size)
    return Information(np.asarray(normal), np.asarray(scores) if lags else None, power, size)


class _Window:
    """
    Bartlett's window over scores that come in blocks.

    Long windows are over sums of neighbours: what matters is their length, to a few percent.
    """

    def __init__(self, lags: int) -> None:
        self.group = max(1, lags // FINEST_LAGS)
        self.lags = max(1, lags // self.group)
        self.last: Array | None = None

    def products(self, scores: Array, ends: bool) -> Array:
        """Return the sum of the weighted products that end in a block; the next one begins a run if this `ends` one."""
        summed = np.add.reduceat(scores, np.arange(0, len(scores), self.group)) if self.group > 1 else scores
        before = np.zeros((self.lags + 1, scores.shape[1])) if self.last is None else self.last
        after = np.zeros((self.lags if ends else 0, scores.shape[1]))
        series = np.concatenate([before, summed, after])
        # sums over every window of lags + 1 neighbours, which weight products by the Bartlett window
        total = np.cumsum(series, axis=0)
        windows = total[self.lags + 1 :] - total[: -self.lags - 1]
        self.last = None if ends else series[-self.lags - 1 :]
        return np.asarray(windows.T @ windows / (self.lags + 1.0))


def _correlation_length(runs: Sequence[Array], power: float) -> int:
    """Return over how many samples residuals are correlated, 0 where the first lag's correlation is noise."""
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
