# SPDX-License-Identifier: Apache-2.0
"""Regressors of a residual: signals, some at several lags, computed in pieces of a long recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.thresholds import (
    FEWEST_SAMPLES_PER_REGRESSOR,
    REGRESSOR_CHUNK,
    REGRESSOR_LAGS,
)


@dataclass(frozen=True)
class Regressors:
    """
    Signals that the residual of a recording may depend on.

    Attributes
    ----------
    once
        Signals at lag zero only, each of shape (n,).
    lagged
        Signals at several lags, each of shape (n,).
    weight
        Weight of each sample, shape (n,).
    first
        Index of the sample with the first residual.

    """

    once: Sequence[Array]
    lagged: Sequence[Array]
    weight: Array
    first: int

    def width(self, samples: int) -> int:
        """Return the number of regressors, with a constant, that a number of samples allows."""
        most = max(1, samples // FEWEST_SAMPLES_PER_REGRESSOR)
        return min(1 + len(self.once) + len(REGRESSOR_LAGS) * len(self.lagged), most)

    def values(self, begin: int, end: int, width: int) -> Array:
        """Return the first `width` regressors, weighted, for residuals `begin` to before `end`, shape (width, n)."""
        rows = self.first + np.arange(begin, end)
        regressors = np.empty((width, end - begin))
        weight = self.weight[rows]
        for row, (signal, lag) in zip(regressors, self._signals()):
            row[:] = weight if signal is None else weight * signal.take(rows - lag, mode='clip')
        return regressors

    def sums(self, edges: NDArray[np.intp], width: int) -> Array:
        """Return the sums of `values` from each edge to before the next edge, shape (width, edges - 1)."""
        parts = []
        begin = 0
        while begin < len(edges) - 1:
            end = max(begin + 1, int(np.searchsorted(edges, edges[begin] + REGRESSOR_CHUNK, side='right')) - 1)
            inner_edges = edges[begin:end] - edges[begin]
            parts.append(np.add.reduceat(self.values(edges[begin], edges[end], width), inner_edges, axis=1))
            begin = end
        return np.concatenate(parts, axis=1)

    def _signals(self) -> Iterator[tuple[Array | None, int]]:
        """Yield each signal, None for the constant, and its lag."""
        yield None, 0
        for signal in self.once:
            yield signal, 0
        for lag in REGRESSOR_LAGS:
            for signal in self.lagged:
                yield signal, lag
