# SPDX-License-Identifier: Apache-2.0
"""Trend of a value over the bags of a device: wear, which no single bag shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau, theilslopes

CHANCE = 1e-4
"""Probability of a false trend; small, because a plant has hundreds of values. It takes at least eight bags."""

_LEAST_CHANGE = 0.05  # smallest change of a trend, as a share of the value
_FEWEST = 3  # values for a slope


@dataclass(frozen=True)
class Trend:
    """
    The trend of a value.

    Attributes
    ----------
    first, last
        Begin and end of the line through the values [unit of the value].

    """

    first: float
    last: float


def trend_of(positions: Sequence[float], values: Sequence[float | None]) -> Trend | None:
    """
    Return the trend of a value, or None if the value does not drift.

    The Mann-Kendall test decides, and the Theil-Sen estimator gives the line. Both are robust to outliers and to a
    growth that is not linear.

    Parameters
    ----------
    positions
        Positions of the bags on the time axis, or in their order [-].
    values
        Value of each bag; None for a missing value.

    """
    points = [(position, value) for position, value in zip(positions, values) if value is not None]
    if len(points) < _FEWEST:
        return None
    position, value = np.array(points).T
    if not kendalltau(position, value).pvalue <= CHANCE:  # the p-value is NaN if all values are equal
        return None
    slope, _, _, _ = theilslopes(value, position)
    intercept = float(np.median(value - slope * position))
    first, last = (intercept + slope * end for end in (position[0], position[-1]))
    return Trend(first, last) if abs(last - first) > _LEAST_CHANGE * abs(float(np.median(value))) else None
