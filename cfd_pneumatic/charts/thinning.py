# SPDX-License-Identifier: Apache-2.0
"""Reduction of long series to minima and maxima, which loses no visible detail of a plot."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

_BLOCK = 10_000  # columns that are reduced at once, to limit the memory

Times = TypeVar('Times', Array, NDArray[np.int64])


def thinned(times: Times, values: Array, columns: int) -> tuple[Times, Array]:
    """
    Return the lowest and the highest sample of each column, in the order of time.

    The columns hold equally many samples. A series of at most two samples per column is returned unchanged.
    """
    if times.size <= 2 * columns:
        return times, values
    edges = np.linspace(0, values.size, columns + 1).astype(np.intp)
    widest = int(np.max(np.diff(edges)))
    extremes = []
    for first in range(0, columns, _BLOCK):
        block_edges = edges[first : first + _BLOCK + 1, None]
        indices = np.minimum(
            block_edges[:-1] + np.arange(widest), block_edges[1:] - 1
        )  # repeats a column's last sample
        samples = values[indices]
        ends = np.column_stack([np.argmin(samples, axis=1), np.argmax(samples, axis=1)])
        extremes.append(np.take_along_axis(indices, ends, axis=1).ravel())
    kept = np.unique(np.concatenate(extremes))
    return times[kept], values[kept]
