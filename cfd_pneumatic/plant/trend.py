# SPDX-License-Identifier: Apache-2.0
"""What rises or falls from bag to bag of one device, and not by chance: wear, which no single bag shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau, theilslopes

CHANCE = 1e-4
"""That a value which does not drift seems to: a plant has hundreds of them. Fewer than eight bags never tell it."""

_LEAST = 0.05  # of a value, by which it has to change
_FEWEST = 3  # values that have a slope


@dataclass(frozen=True)
class Trend:
    """
    A value that drifts.

    Attributes
    ----------
    first, last
        Where the line through it begins and ends [unit of the value].

    """

    first: float
    last: float


def trend_of(places: Sequence[float], values: Sequence[float | None]) -> Trend | None:
    """
    Return how a value drifts, or None: by Mann and Kendall's test, and Theil and Sen's line.

    Both go by the order of the values: an outlier does no harm, nor does a value that grows ever faster.

    Parameters
    ----------
    places
        Where the bags stand, by time or one after the other [-].
    values
        One for each bag; None where there is none.

    """
    told = [(place, value) for place, value in zip(places, values) if value is not None]
    if len(told) < _FEWEST:
        return None
    at, value = np.array(told).T
    if not kendalltau(at, value).pvalue <= CHANCE:  # it is no number where all values are one
        return None
    slope, _, _, _ = theilslopes(value, at)
    middle = float(np.median(value - slope * at))
    first, last = (middle + slope * end for end in (at[0], at[-1]))
    return Trend(first, last) if abs(last - first) > _LEAST * abs(float(np.median(value))) else None
