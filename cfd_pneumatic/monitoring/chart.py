# SPDX-License-Identifier: Apache-2.0
"""A CUSUM chart on a series that has a memory: what is new in each value, added up until it is too much for chance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import autoregression, whitened
from cfd_pneumatic.monitoring.run_length import SLACK, Excursions, as_rare, excursions, threshold_for
from cfd_pneumatic.runtime import compiler

_CLIP = 4.0  # standard deviations that a single value counts for at most
_OUTLYING = 5.0  # robust standard deviations
_NORMAL_PER_MEDIAN = 1.4826  # standard deviation over median absolute deviation

LEAST_SPREAD = 1e-80
"""Of a residual that has always been the same: its square, and that of what it divides, are numbers [its unit]."""


@dataclass(frozen=True)
class Series:
    """
    What is usual for a series.

    Attributes
    ----------
    mean
        In the series' unit.
    coefficients
        Of its autoregression.
    std
        Standard deviation of what is new in a value, in the series' unit.
    tolerance
        How far the mean may stray, in the series' unit.
    learned_from
        Number of values.
    excursions
        Those of the chart's sums over these values, upwards and downwards.

    """

    mean: float
    coefficients: Array
    std: float
    tolerance: float
    learned_from: int
    excursions: tuple[Excursions, Excursions] = (Excursions(), Excursions())

    @property
    def persistence(self) -> float:
        """What is new in each value of a lasting shift, over the shift [-]."""
        return max(1.0 - float(np.sum(self.coefficients)), 0.0)

    @property
    def slack(self) -> float:
        """What a score has to exceed on the average until an alarm comes [standard deviations]."""
        return SLACK + self.tolerance * self.persistence / self.std


def usual(values: Array, tolerance: float = 0.0) -> Series:
    """Return what is usual for a series, from a stretch of it; what lies far out counts as far as that only."""
    median = float(np.median(values))
    reach = _OUTLYING * _NORMAL_PER_MEDIAN * float(np.median(np.abs(values - median)))
    near = np.clip(values, median - reach, median + reach) if reach > 0.0 else values
    mean = float(np.mean(near))
    coefficients = autoregression([near - mean])
    new = whitened(near - mean, coefficients)[coefficients.size :]
    std = max(float(np.sqrt(np.sum(new**2) / max(new.size - 1 - coefficients.size, 1))), LEAST_SPREAD)
    series = Series(mean, coefficients, std, tolerance, values.size)
    scores = np.clip(whitened(values - mean, coefficients)[coefficients.size :] / std, -_CLIP, _CLIP)
    return replace(series, excursions=(excursions(scores, series.slack), excursions(-scores, series.slack)))


@compiler()
def _advance(  # type: ignore[no-untyped-def]
    values, mean, coefficients, std, slack, thresholds, clip, history, sums, runs
):
    """Add values up; return the index of the one with which a sum exceeds its threshold, or -1."""
    for index in range(values.size):
        expected = 0.0
        for lag in range(coefficients.size):
            expected += coefficients[lag] * history[lag]
        score = (values[index] - mean - expected) / std
        score = min(max(score, -clip), clip)
        for lag in range(coefficients.size - 1, 0, -1):
            history[lag] = history[lag - 1]
        if coefficients.size:
            history[0] = expected + score * std
        for side in range(sums.size):
            step = score if side == 0 else -score
            sums[side] = max(0.0, sums[side] + step - slack)
            runs[side] = runs[side] + 1 if sums[side] > 0.0 else 0
            if sums[side] > thresholds[side]:
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
        normal = threshold_for(mean_run * sides, series.learned_from)
        self.thresholds = np.array([as_rare(normal, own) for own in series.excursions[:sides]])
        self._slack = series.slack
        self._history = np.zeros(series.coefficients.size)
        self._sums = np.zeros(sides)
        self._runs = np.zeros(sides, dtype=np.int64)

    def take(self, values: Array) -> int:
        """Return the index of the first value that gives an alarm, or -1; values behind it are not looked at."""
        series = self._series
        return int(
            _advance(
                values,
                series.mean,
                series.coefficients,
                series.std,
                self._slack,
                self.thresholds,
                _CLIP,
                self._history,
                self._sums,
                self._runs,
            )
        )

    @property
    def nearness(self) -> float:
        """The sum that is nearest to its threshold, over it [-]."""
        return float(np.max(self._sums / self.thresholds))

    @property
    def run(self) -> int:
        """For how many values the sum that is nearest has been above zero: since the change, as far as can be told."""
        return int(self._runs[np.argmax(self._sums / self.thresholds)])

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
