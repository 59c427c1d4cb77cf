"""A CUSUM chart on a series that has a memory: what is new in each value, added up until it is too much for chance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from cfd_pneumatic.compiling import compiler
from cfd_pneumatic.identification.colour import autoregression, whitened
from cfd_pneumatic.monitoring.run_length import SLACK, threshold_for

Array = NDArray[np.float64]

_CLIP = 4.0  # standard deviations that a single value counts for at most
_OUTLYING = 5.0  # robust standard deviations
_LEAST_LIGHTNESS = 0.2
_NORMAL_PER_MEDIAN = 1.4826  # standard deviation over median absolute deviation


@dataclass(frozen=True)
class Series:
    """
    What is usual for a series.

    Attributes
    ----------
    mean
        In the series' unit.
    colour
        As in `colour.autoregression`.
    std
        Standard deviation of what is new in a value, more where large ones are more frequent than in a normal
        distribution, in the series' unit.
    tolerance
        How far the mean may stray, in the series' unit.
    learned_from
        Number of values.

    """

    mean: float
    colour: Array
    std: float
    tolerance: float
    learned_from: int

    @property
    def persistence(self) -> float:
        """What is new in each value of a lasting shift, over the shift [-]."""
        return max(1.0 - float(np.sum(self.colour)), 0.0)


def usual(values: Array, tolerance: float = 0.0) -> Series:
    """Return what is usual for a series, from a stretch of it; what lies far out counts as far as that only."""
    median = float(np.median(values))
    reach = _OUTLYING * _NORMAL_PER_MEDIAN * float(np.median(np.abs(values - median)))
    near = np.clip(values, median - reach, median + reach) if reach > 0.0 else values
    mean = float(np.mean(near))
    colour = autoregression([near - mean])
    new = whitened(near - mean, colour)[colour.size :]
    std = max(float(np.sqrt(np.sum(new**2) / max(new.size - 1 - colour.size, 1))), np.finfo(float).tiny)
    unclipped = whitened(values - mean, colour)[colour.size :] / std
    return Series(mean, colour, std / _lightness(np.clip(unclipped, -_CLIP, _CLIP)), tolerance, values.size)


def _lightness(scores: Array) -> float:
    """
    Return the scale on which scores would make false alarms as rare as normal ones do, one at most.

    With each step of its threshold a chart's false alarms become rarer by a factor, whose logarithm solves
    E exp(exponent * (score - slack)) = 1 (Siegmund, 1985). It is twice the slack for normal scores, and less where
    there are more large ones; by less than its standard error counts as chance.
    """
    normal = 2.0 * SLACK
    smallest = min(_exponent(side, normal) / normal for side in (scores, -scores))
    chance = math.sqrt(math.expm1(normal**2)) / (SLACK * math.sqrt(scores.size))
    return min(max(smallest + chance, _LEAST_LIGHTNESS), 1.0)


def _exponent(scores: Array, highest: float) -> float:
    """Return the exponent, up to a highest one, at which E exp(exponent * (score - slack)) = 1."""

    def excess(exponent: float) -> float:
        return float(np.mean(np.expm1(exponent * (scores - SLACK))))

    lowest = _LEAST_LIGHTNESS * highest
    if excess(highest) <= 0.0:
        return highest
    return float(brentq(excess, lowest, highest)) if excess(lowest) < 0.0 else lowest


@compiler()
def _advance(  # type: ignore[no-untyped-def]
    values, mean, colour, std, slack, threshold, clip, history, sums, runs
):
    """Add values up; return the index of the one with which a sum exceeds the threshold, or -1."""
    for index in range(values.size):
        expected = 0.0
        for lag in range(colour.size):
            expected += colour[lag] * history[lag]
        score = (values[index] - mean - expected) / std
        score = min(max(score, -clip), clip)
        for lag in range(colour.size - 1, 0, -1):
            history[lag] = history[lag - 1]
        if colour.size:
            history[0] = expected + score * std
        for side in range(sums.size):
            step = score if side == 0 else -score
            sums[side] = max(0.0, sums[side] + step - slack)
            runs[side] = runs[side] + 1 if sums[side] > 0.0 else 0
            if sums[side] > threshold:
                return index
    return -1


class Chart:
    """
    The test of one series.

    A value counts by what is new in it, at most four standard deviations: no single one gives an alarm. After an alarm
    it begins anew at zero.

    Parameters
    ----------
    series
        What is usual.
    mean_run
        Mean number of values between two false alarms.
    two_sided
        Whether a mean below the usual gives an alarm, too.

    """

    def __init__(self, series: Series, mean_run: float, two_sided: bool) -> None:
        self._series = series
        sides = 2 if two_sided else 1
        self.threshold = threshold_for(mean_run * sides, series.learned_from)
        self._slack = SLACK + series.tolerance * series.persistence / series.std
        self._history = np.zeros(series.colour.size)
        self._sums = np.zeros(sides)
        self._runs = np.zeros(sides, dtype=np.int64)

    def take(self, values: Array) -> int:
        """Return the index of the first value that gives an alarm, or -1; values behind it are not looked at."""
        series = self._series
        return int(
            _advance(
                values,
                series.mean,
                series.colour,
                series.std,
                self._slack,
                self.threshold,
                _CLIP,
                self._history,
                self._sums,
                self._runs,
            )
        )

    @property
    def nearness(self) -> float:
        """The larger sum over the threshold [-]."""
        return float(np.max(self._sums)) / self.threshold

    @property
    def run(self) -> int:
        """For how many values the larger sum has been above zero: since the change, as far as can be told."""
        return int(self._runs[np.argmax(self._sums)])

    def restart(self) -> None:
        """Forget what was added up."""
        self._history[:] = 0.0
        self.again()

    def again(self) -> None:
        """Begin anew at zero behind an alarm, the series going on."""
        self._sums[:] = 0.0
        self._runs[:] = 0


def warm_up() -> None:
    """Compile what a chart takes, or load it compiled, so that no sample waits for it."""
    Chart(Series(0.0, np.zeros(1), 1.0, 0.0, 1000), 1000.0, two_sided=True).take(np.zeros(1))
