# SPDX-License-Identifier: Apache-2.0
"""
Thresholds of a CUSUM chart for a given mean time between false alarms.

The chart adds standard normal scores less a slack and starts anew at zero (Page, 1954). Its mean run is Siegmund's
approximation (1985), which holds to a percent for the slack and the thresholds here. Mean and spread of the scores are
learned from a limited stretch. The threshold gives the wanted rate of false alarms on average over the uncertainty of
mean and spread.

Heavy-tailed or autocorrelated scores cause larger excursions of the sum. Excursions are measured in the same stretch,
and the threshold is raised so that they exceed it as rarely.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from cfd_pneumatic.arrays import Array

SLACK = 0.5
"""Mean score above which the sum grows until an alarm [standard deviations]."""

_OVERSHOOT = 1.166  # mean overshoot of the sum at both ends together, Siegmund (1985)
_LOWEST, _HIGHEST = 0.1, 1e4  # thresholds
_PRECISION = 1e-7  # of a threshold
_NODES, _WEIGHTS = hermegauss(15)
_SMALLEST_SPREAD = 0.2
_LONGEST_EXPONENT = 700.0  # of floating point's range
_HEIGHT = 1.5  # an excursion counts if it is higher
_NORMAL_EXCESS = 1.0 / (2.0 * SLACK)  # mean excess of excursions over any height for normal scores, Siegmund (1985)
_EXPECTED = 5  # weight of the prior, in excursions of normal scores


def mean_run_length(threshold: float, slack: float = SLACK, shift: float = 0.0, spread: float = 1.0) -> float:
    """
    Return the mean number of scores until the sum exceeds a threshold.

    Parameters
    ----------
    threshold, slack
        Threshold and slack of the chart [-].
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
    Return the threshold for a wanted mean run; mean and spread were learned from independent scores.

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
            of_shift * of_spread / mean_run_length(threshold, SLACK, shift, spread)
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
    """Excursions of a chart's sum from zero while the device is healthy."""

    number: int = 0
    """Number of excursions above 1.5."""

    excess: float = 0.0
    """Sum of the peaks' heights above 1.5 [-]."""


def find_excursions(scores: Array, slack: float) -> Excursions:
    """Return the excursions of a chart's sum for scores, shape (n,) [-]."""
    height, peaks = 0.0, [0.0]
    for score in scores.tolist():
        height = max(0.0, height + score - slack)
        if height == 0.0:
            peaks.append(0.0)
        peaks[-1] = max(peaks[-1], height)
    excesses = [peak - _HEIGHT for peak in peaks if peak > _HEIGHT]
    return Excursions(len(excesses), sum(excesses))


def raise_threshold(threshold: float, excursions: Excursions) -> float:
    """
    Raise a threshold for normal scores so that the measured excursions exceed it as rarely.

    The excess of peaks over a height is distributed exponentially. Its mean is known from some excursions only, so the
    chance to exceed a threshold is that of a Pareto distribution. The threshold stays if the mean excess does not
    exceed that of normal scores by more than its standard error.
    """
    known = _EXPECTED + excursions.number
    mean = (_EXPECTED * _NORMAL_EXCESS + excursions.excess) / known
    if mean <= _NORMAL_EXCESS * (1.0 + 1.0 / math.sqrt(known)):
        return threshold
    return max(threshold, _HEIGHT + mean * known * math.expm1((threshold - _HEIGHT) / _NORMAL_EXCESS / known))
