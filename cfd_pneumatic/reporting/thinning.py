# SPDX-License-Identifier: Apache-2.0
"""Long series made short for people: minima and maxima, so that nothing that can be seen is lost."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

_TOGETHER = 10_000  # columns

Times = TypeVar('Times', Array, NDArray[np.int64])


def thinned(times: Times, values: Array, columns: int) -> tuple[Times, Array]:
    """
    Return the lowest and the highest sample of each of so many columns of equally many samples, in their order.

    A series that is not longer than two samples a column comes back as it is.
    """
    if times.size <= 2 * columns:
        return times, values
    edges = np.linspace(0, values.size, columns + 1).astype(np.intp)
    widest = int(np.max(np.diff(edges)))
    found = []
    for first in range(0, columns, _TOGETHER):
        own = edges[first : first + _TOGETHER + 1, None]
        at = np.minimum(own[:-1] + np.arange(widest), own[1:] - 1)  # the last sample fills what is left
        seen = values[at]
        ends = np.column_stack([np.argmin(seen, axis=1), np.argmax(seen, axis=1)])
        found.append(np.take_along_axis(at, ends, axis=1).ravel())
    kept = np.unique(np.concatenate(found))
    return times[kept], values[kept]
