# SPDX-License-Identifier: Apache-2.0
"""One measured signal beside its model: blocks of residuals, and the charts that watch them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.monitoring.baseline import FEWEST_BLOCKS, Baseline, Weighing, learn
from cfd_pneumatic.monitoring.chart import Chart

_MISFIT = 20.0  # learned mean over the noise from which on the model can't be this device's
_KEPT = 600  # blocks that a departure is described by
_MOMENT = 5e-3  # in which a signal at rest moves by less than its noise [s]
_FULL = 0.5  # share of the usual number of samples from which on a block counts
CHARTS = 3
"""One-sided tests in a channel: its mean up, its mean down, its energy up."""


class ResidualBlock(NamedTuple):
    """Residuals over a short time."""

    start: int
    """Stamp of the first [ns]."""

    residuals: Array
    """Measured less predicted [signal's unit]."""

    rates: Array
    """Of the predicted signal [unit/s]."""

    @property
    def mean(self) -> float:
        """Mean residual [signal's unit]."""
        return float(np.mean(self.residuals))


@dataclass(frozen=True)
class Departure:
    """
    How a signal parts from its model.

    Attributes
    ----------
    channel
        `cylinder_a`, `cylinder_b` or `contact_force`.
    since
        Stamp from which on, as far as can be told [ns].
    level
        Whether the mean has moved; otherwise the residual has become larger about it.
    shift
        Mean residual since then, less the usual one [signal's unit].
    at_rest
        The same while the signal rests; None where it hardly does.
    root_mean_square
        Root mean square of the residual since then [signal's unit].
    usual
        The usual one [signal's unit].

    """

    channel: str
    since: int
    level: bool
    shift: float
    at_rest: float | None
    root_mean_square: float
    usual: float


class WatchedSignal:
    """
    A measured signal beside its model.

    It learns from its first residuals what is usual, and says from then on where they depart from it.

    Parameters
    ----------
    name
        `cylinder_a`, `cylinder_b` or `contact_force`.
    learning
        How many blocks it learns from.
    block
        Length of a block [ns].
    mean_run
        Mean number of blocks between two false alarms; what it is when learning ends counts.
    tolerance
        How far the mean may stray for a lasting time [signal's unit]; None: it is learned.

    """

    def __init__(self, name: str, learning: int, block: int, mean_run: float, tolerance: float | None = None) -> None:
        self.name = name
        self.baseline: Baseline | None = None
        self._learning = max(learning, FEWEST_BLOCKS)
        self._length = block
        self.mean_run = mean_run
        self._tolerance = tolerance
        self._learned: list[ResidualBlock] = []
        self._recent: deque[ResidualBlock] = deque(maxlen=_KEPT)
        self._samples = 0.0
        self.charts: tuple[Chart, ...] = ()
        self.rings = 0
        self.restart()

    @property
    def learned(self) -> float:
        """Share of what it learns from that it has seen [0 to 1]."""
        return 1.0 if self.baseline is not None else len(self._learned) / self._learning

    @property
    def usual(self) -> float:
        """Usual root mean square of the residual [signal's unit]."""
        assert self.baseline is not None
        return self.baseline.weighing.root_mean_square(self.baseline.energy.mean)

    @property
    def misfit(self) -> float | None:
        """Mean residual that was learned [signal's unit], where it is so large that something was wrong; else None."""
        if self.baseline is None or abs(self.baseline.mean.mean) < _MISFIT * self.baseline.weighing.noise:
            return None
        return self.baseline.mean.mean

    @property
    def nearness(self) -> float:
        """How near to an alarm it is: the largest sum of a chart over its threshold [0 to 1]."""
        return max((chart.nearness for chart in self.charts), default=0.0)

    @property
    def agitation(self) -> float:
        """Standard deviation within the last block over the noise; zero where there is no such block [-]."""
        if self.baseline is None or not self._recent:
            return 0.0
        block, weighing = self._recent[-1], self.baseline.weighing
        return float(np.std(weighing.weighed(block.residuals, block.rates))) / weighing.noise

    def restart(self) -> None:
        """Begin anew behind a break; what was learned stays."""
        self._start = -1
        self._residuals: list[float] = []
        self._rates: list[float] = []
        self._recent.clear()
        self._before = np.empty(0)
        for chart in self.charts:
            chart.restart()

    def take(self, stamp: int, residual: float, rate: float) -> Departure | None:
        """Take a residual [signal's unit] at a stamp [ns]; `rate` is the predicted signal's [unit/s]."""
        departure = None
        number = stamp // self._length
        if number != self._start // self._length and self._residuals:
            departure = self.take_block(ResidualBlock(self._start, np.array(self._residuals), np.array(self._rates)))
            self._residuals, self._rates = [], []
        if not self._residuals:
            self._start = stamp
        self._residuals.append(residual)
        self._rates.append(rate)
        return departure

    def take_block(self, block: ResidualBlock) -> Departure | None:
        """Take a whole block."""
        if self.baseline is None:
            self._learned.append(block)
            if len(self._learned) == self._learning:
                self._learn()
            return None
        if block.residuals.size < _FULL * self._samples:
            return None
        self._recent.append(block)
        weighing = self.baseline.weighing
        weighed = weighing.weighed(block.residuals, block.rates)
        features = weighing.features(weighing.innovations(weighed, self._before)[None])
        self._before = weighed
        rung = [chart for chart, values in zip(self.charts, features) if chart.take(values) >= 0]
        if not rung:
            return None
        self.rings += 1
        begin = self._recent[-min(max(rung[0].run, 1), len(self._recent))].start
        departure = self.describe(begin, level=rung[0] is self.charts[0])
        for chart in rung:
            chart.again()
        return departure

    def describe(self, since: int, level: bool) -> Departure:
        """Return how the signal parts from its model since a stamp [ns]."""
        assert self.baseline is not None
        usual, weighing = self.baseline.mean.mean, self.baseline.weighing
        blocks = [block for block in self._recent if block.start >= since] or list(self._recent)[-1:]
        resting = [block for block in blocks if _rests(block, weighing)]
        together = np.concatenate([block.residuals for block in blocks])
        return Departure(
            channel=self.name,
            since=since,
            level=level,
            shift=float(np.mean(together)) - usual,
            at_rest=float(np.mean([block.mean for block in resting])) - usual if resting else None,
            root_mean_square=rms(together),
            usual=self.usual,
        )

    def _learn(self) -> None:
        sizes = [block.residuals.size for block in self._learned]
        self._samples = float(np.median(sizes))
        whole = [block for block in self._learned if block.residuals.size >= _FULL * self._samples]
        self.adopt(learn([block.residuals for block in whole], [block.rates for block in whole], self._tolerance))
        self._learned = []

    def adopt(self, baseline: Baseline) -> None:
        """Watch from now on, with what is usual; `charts` are those of the mean and of the energy."""
        self.baseline = baseline
        self.charts = (
            Chart(baseline.mean, CHARTS / 2.0 * self.mean_run, two_sided=True),
            Chart(baseline.energy, CHARTS * self.mean_run, two_sided=False),
        )


def _rests(block: ResidualBlock, weighing: Weighing) -> bool:
    """Return whether the predicted signal hardly moves in a block."""
    return rms(block.rates) * _MOMENT < weighing.noise
