# SPDX-License-Identifier: Apache-2.0
"""CUSUM charts for autocorrelated series: sums of innovations that give an alarm above a threshold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import autoregression, whitened
from cfd_pneumatic.monitoring.run_length import SLACK, Excursions, find_excursions, raise_threshold, threshold_for
from cfd_pneumatic.runtime import compiler

_CLIP = 4.0  # standard deviations: largest score of a value
_OUTLYING = 5.0  # robust standard deviations
_NORMAL_PER_MEDIAN = 1.4826  # standard deviation over median absolute deviation

LEAST_SPREAD = 1e-80
"""Smallest standard deviation of a residual, so that its square and quotients by it are finite [its unit]."""


@dataclass(frozen=True)
class SeriesModel:
    """
    The usual behaviour of a series.

    Attributes
    ----------
    mean
        In the series' unit.
    coefficients
        Coefficients of its autoregression.
    std
        Standard deviation of the innovations, in the series' unit.
    tolerance
        Accepted shift of the mean, in the series' unit.
    learned_from
        Number of values.
    excursions
        Excursions of the chart's sums over these values, upwards and downwards.

    """

    mean: float
    coefficients: Array
    std: float
    tolerance: float
    learned_from: int
    excursions: tuple[Excursions, Excursions] = (Excursions(), Excursions())

    @property
    def dc_gain(self) -> float:
        """DC gain of the whitening filter: innovation over lasting shift [-]."""
        return max(1.0 - float(np.sum(self.coefficients)), 0.0)

    @property
    def slack(self) -> float:
        """Mean score above which the sum grows until an alarm [standard deviations]."""
        return SLACK + self.tolerance * self.dc_gain / self.std


def learn_series(values: Array, tolerance: float = 0.0) -> SeriesModel:
    """Learn the usual behaviour from a stretch of a series; outliers are clipped."""
    median = float(np.median(values))
    reach = _OUTLYING * _NORMAL_PER_MEDIAN * float(np.median(np.abs(values - median)))
    near = np.clip(values, median - reach, median + reach) if reach > 0.0 else values
    mean = float(np.mean(near))
    coefficients = autoregression([near - mean])
    new = whitened(near - mean, coefficients)[coefficients.size :]
    std = max(float(np.sqrt(np.sum(new**2) / max(new.size - 1 - coefficients.size, 1))), LEAST_SPREAD)
    series = SeriesModel(mean, coefficients, std, tolerance, values.size)
    scores = np.clip(whitened(values - mean, coefficients)[coefficients.size :] / std, -_CLIP, _CLIP)
    return replace(series, excursions=(find_excursions(scores, series.slack), find_excursions(-scores, series.slack)))


@compiler()
def _advance(  # type: ignore[no-untyped-def]
    values, mean, coefficients, std, slack, thresholds, clip, history, sums, runs
):
    """Add scores up; return the index of the value at which a sum exceeds its threshold, or -1."""
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
    CUSUM chart of a series.

    The score of a value is its innovation, at most four standard deviations: no single value gives an alarm.

    Parameters
    ----------
    series
        Usual behaviour of the series.
    mean_run
        Mean number of values between two false alarms.
    two_sided
        Whether a mean below the usual gives an alarm, too.

    """

    def __init__(self, series: SeriesModel, mean_run: float, two_sided: bool) -> None:
        self._series = series
        sides = 2 if two_sided else 1
        normal = threshold_for(mean_run * sides, series.learned_from)
        self.thresholds = np.array([raise_threshold(normal, excursions) for excursions in series.excursions[:sides]])
        self._slack = series.slack
        self._history = np.zeros(series.coefficients.size)
        self._sums = np.zeros(sides)
        self._runs = np.zeros(sides, dtype=np.int64)

    def update(self, values: Array) -> int:
        """Add values; return the index of the first value that gives an alarm, or -1. Later values are not added."""
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
    def alarm_proximity(self) -> float:
        """Largest ratio of a sum to its threshold [-]."""
        return float(np.max(self._sums / self.thresholds))

    @property
    def values_since_change(self) -> int:
        """Number of values since the sum nearest its threshold left zero: estimates the time since the change."""
        return int(self._runs[np.argmax(self._sums / self.thresholds)])

    def restart(self) -> None:
        """Forget sums and earlier values."""
        self._history[:] = 0.0
        self.reset_sums()

    def reset_sums(self) -> None:
        """Set the sums to zero, as after an alarm; the series continues."""
        self._sums[:] = 0.0
        self._runs[:] = 0


def warm_up() -> None:
    """Compile the chart's kernel, or load it from the cache, so that no sample waits."""
    Chart(SeriesModel(0.0, np.zeros(1), 1.0, 0.0, 1000), 1000.0, two_sided=True).update(np.zeros(1))
