"""
How long a CUSUM chart runs until it gives a false alarm, and the threshold that makes it as long as is wanted.

The chart adds standard normal scores less a slack and starts anew at zero (Page, 1954). Its mean run is Siegmund's
approximation (1985), which holds to a percent for the slack and the thresholds here. Mean and spread of the scores are
learned from a limited stretch; what the rate of false alarms is on the average over what may have been learned decides
about the threshold.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.optimize import brentq

SLACK = 0.5
"""What a score has to exceed on the average until an alarm comes [standard deviations]."""

_OVERSHOOT = 1.166  # what the sum passes either end by on the average, together, Siegmund (1985)
_LOWEST, _HIGHEST = 0.1, 1e4  # thresholds
_NODES, _WEIGHTS = hermegauss(15)
_SMALLEST_SPREAD = 0.2
_LONGEST_EXPONENT = 700.0  # of floating point's range


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

    if excess(_LOWEST) <= 0.0:
        return _LOWEST
    return float(brentq(excess, _LOWEST, _HIGHEST, xtol=1e-3))
