# SPDX-License-Identifier: Apache-2.0
"""
How long a CUSUM chart runs until it gives a false alarm, and the threshold that makes it as long as is wanted.

The chart adds standard normal scores less a slack and starts anew at zero (Page, 1954). Its mean run is Siegmund's
approximation (1985), which holds to a percent for the slack and the thresholds here. Mean and spread of the scores are
learned from a limited stretch; what the rate of false alarms is on the average over what may have been learned decides
about the threshold.

Where scores are heavier than normal or remember what came before, sums go farther. How far is learned from the same
stretch, by the chart's own excursions from zero, and the threshold is moved to where it is passed as seldom.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from cfd_pneumatic.arrays import Array

SLACK = 0.5
"""What a score has to exceed on the average until an alarm comes [standard deviations]."""

_OVERSHOOT = 1.166  # what the sum passes either end by on the average, together, Siegmund (1985)
_LOWEST, _HIGHEST = 0.1, 1e4  # thresholds
_PRECISION = 1e-7  # of a threshold
_NODES, _WEIGHTS = hermegauss(15)
_SMALLEST_SPREAD = 0.2
_LONGEST_EXPONENT = 700.0  # of floating point's range
_HEIGHT = 1.5  # of excursions that count
_NORMAL_EXCESS = 1.0 / (2.0 * SLACK)  # over any height, of normal scores, Siegmund (1985)
_EXPECTED = 5  # excursions with which such scores are expected before any was seen


def mean_run(threshold: float, slack: float = SLACK, shift: float = 0.0, spread: float = 1.0) -> float:
    """
    Return after how many scores, on the average, the sum exceeds a threshold.

    Parameters
    ----------
    threshold, slack
        Of the chart [-].
    shift, spread
        Mean and standard deviation of the scores [-].

    """
    drift = (shift - slack) / spread
    length = threshold / spread + _OVERSHOOT
    if abs(drift) < 1e-6:
        return length**2
    exponent = min(-2.0 * drift * length, _LONGEST_EXPONENT)
    return (math.exp(exponent) - exponent - 1.0) / (2.0 * drift**2)


@lru_cache(maxsize=256)
def threshold_for(wanted: float, learned_from: int) -> float:
    """
    Return the threshold of a chart whose scores' mean and spread were learned from so many independent scores.

    Parameters
    ----------
    wanted
        Mean number of scores between two false alarms.
    learned_from
        Number of scores; the fewer, the higher the threshold.

    """
    weights = _WEIGHTS / np.sum(_WEIGHTS)
    shifts = _NODES / math.sqrt(learned_from)
    spreads = np.maximum(1.0 + _NODES / math.sqrt(2.0 * learned_from), _SMALLEST_SPREAD)

    def excess(threshold: float) -> float:
        rate = sum(
            of_shift * of_spread / mean_run(threshold, SLACK, shift, spread)
            for of_shift, shift in zip(weights.tolist(), shifts.tolist())
            for of_spread, spread in zip(weights.tolist(), spreads.tolist())
        )
        return math.log(rate * wanted)

    low, high = _LOWEST, _HIGHEST
    if excess(low) <= 0.0:
        return low
    while high - low > _PRECISION:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high


class Excursions(NamedTuple):
    """How high a chart's sum went before it came back to zero, in a stretch where nothing was wrong."""

    number: int = 0
    """Of those that passed 1.5."""

    excess: float = 0.0
    """By which their peaks passed it, all together [-]."""


def excursions(scores: Array, slack: float) -> Excursions:
    """Return the excursions of a chart's sum over scores, shape (n,) [-]."""
    height, peaks = 0.0, [0.0]
    for score in scores.tolist():
        height = max(0.0, height + score - slack)
        if height == 0.0:
            peaks.append(0.0)
        peaks[-1] = max(peaks[-1], height)
    excesses = [peak - _HEIGHT for peak in peaks if peak > _HEIGHT]
    return Excursions(len(excesses), sum(excesses))


def as_rare(threshold: float, seen: Excursions) -> float:
    """
    Return the threshold that excursions like those that were seen pass as seldom as those of normal scores pass this.

    By how much peaks pass a height is distributed exponentially. With a mean that is known from some excursions only,
    the chance to pass a threshold is that of a Pareto distribution. A mean that is smaller than that of normal scores,
    or larger by less than its standard error, counts as theirs.
    """
    known = _EXPECTED + seen.number
    mean = (_EXPECTED * _NORMAL_EXCESS + seen.excess) / known
    if mean <= _NORMAL_EXCESS * (1.0 + 1.0 / math.sqrt(known)):
        return threshold
    return max(threshold, _HEIGHT + mean * known * math.expm1((threshold - _HEIGHT) / _NORMAL_EXCESS / known))
