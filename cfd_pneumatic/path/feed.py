# SPDX-License-Identifier: Apache-2.0
"""Fastest feed at which the force along a path stays within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from scipy.optimize import brentq

from cfd_pneumatic.path.thresholds import FASTEST_FEED, FEED_TOLERANCE, LONGEST_PATH, SLOWEST_SHARE


class FastestFeed(NamedTuple):
    """Fastest feeds that keep a tolerance [m/s]; None if no feed keeps it."""

    predicted: float | None
    """For the predicted force."""

    with_band: float | None
    """For the whole band."""


def fastest_feed(error_at: Callable[[float], float], length: float, tolerance: float, start: float) -> float | None:
    """
    Return the fastest feed at which an error stays within a tolerance; None if no feed does.

    Parameters
    ----------
    error_at
        Returns the largest error of the force at a feed [N].
    length
        Length of the path [m]; a path takes at most `LONGEST_PATH`.
    tolerance
        Largest accepted error [N].
    start
        Feed at which the search begins [m/s]; slower feeds are searched down to a share, `SLOWEST_SHARE`.

    """
    slowest = max(SLOWEST_SHARE * start, 1.01 * length / LONGEST_PATH)

    def excess(logarithm: float) -> float:
        return error_at(math.exp(logarithm)) - tolerance

    low = high = math.log(min(start, FASTEST_FEED))
    if excess(low) > 0.0:
        while excess(low) > 0.0:
            if low <= math.log(slowest):
                return None
            high, low = low, max(low - math.log(2.0), math.log(slowest))
    else:
        while excess(high) <= 0.0:
            if high >= math.log(FASTEST_FEED):
                return FASTEST_FEED
            low, high = high, min(high + math.log(2.0), math.log(FASTEST_FEED))
    return math.exp(float(brentq(excess, low, high, xtol=FEED_TOLERANCE)))
