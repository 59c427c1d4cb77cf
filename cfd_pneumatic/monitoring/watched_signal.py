# SPDX-License-Identifier: Apache-2.0
"""A measured signal that is compared with its model: blocks of residuals, and CUSUM charts."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.monitoring.baseline import FEWEST_BLOCKS, Baseline, NoiseModel, learn_baseline
from cfd_pneumatic.monitoring.chart import Chart

_MISFIT_LIMIT = 20.0  # learned mean over noise above which the model is not of this device
_KEPT_BLOCKS = 600  # blocks from which a departure is described
_REST_TIME = 5e-3  # time in which a signal at rest changes by less than its noise [s]
_LEAST_SHARE = 0.5  # share of the usual number of samples that a block must have
CHARTS = 3
"""One-sided tests in a channel: its mean up, its mean down, its energy up."""


class ResidualBlock(NamedTuple):
    """A block of successive residuals."""

    start: int
    """Stamp of the first residual [ns]."""

    residuals: Array
    """Measured minus predicted [signal's unit]."""

    rates: Array
    """Rates of the predicted signal [unit/s]."""

    @property
    def mean(self) -> float:
        """Mean residual [signal's unit]."""
        return float(np.mean(self.residuals))


@dataclass(frozen=True)
class Departure:
    """
    How a signal departs from its model.

    Attributes
    ----------
    channel
        `cylinder_a`, `cylinder_b` or `contact_force`.
    since
        Estimated stamp of the beginning [ns].
    is_mean_shift
        Whether the mean has shifted; otherwise the variance has grown.
    shift
        Mean residual since then minus the usual mean [signal's unit].
    shift_at_rest
        Shift while the signal is at rest; None if there is no block at rest.
    root_mean_square
        Root mean square of the residual since then [signal's unit].
    usual_rms
        Usual root mean square of the residual [signal's unit].

    """

    channel: str
    since: int
    is_mean_shift: bool
    shift: float
    shift_at_rest: float | None
    root_mean_square: float
    usual_rms: float


class WatchedSignal:
    """
    A measured signal that is compared with its model.

    The first residuals give the baseline. Later residuals are tested against the baseline.

    Parameters
    ----------
    name
        `cylinder_a`, `cylinder_b` or `contact_force`.
    learning
        Number of blocks for the baseline.
    block
        Length of a block [ns].
    mean_run
        Mean number of blocks between two false alarms; the value at the end of learning counts.
    tolerance
        Accepted lasting shift of the mean [signal's unit]; None: learned.

    """

    def __init__(self, name: str, learning: int, block: int, mean_run: float, tolerance: float | None = None) -> None:
        self.name = name
        self.baseline: Baseline | None = None
        self._blocks_to_learn = max(learning, FEWEST_BLOCKS)
        self._block_length = block
        self.mean_run = mean_run
        self._tolerance = tolerance
        self._learned: list[ResidualBlock] = []
        self._recent: deque[ResidualBlock] = deque(maxlen=_KEPT_BLOCKS)
        self._usual_samples = 0.0
        self.charts: tuple[Chart, ...] = ()
        self.ring_count = 0
        self.restart()

    @property
    def learned_share(self) -> float:
        """Share of the learning that is complete [0 to 1]."""
        return 1.0 if self.baseline is not None else len(self._learned) / self._blocks_to_learn

    @property
    def usual_rms(self) -> float:
        """Usual root mean square of the residual [signal's unit]."""
        assert self.baseline is not None
        return self.baseline.noise_model.root_mean_square(self.baseline.energy.mean)

    @property
    def misfit(self) -> float | None:
        """Learned mean residual if it is too large for a matching model [signal's unit]; otherwise None."""
        if self.baseline is None or abs(self.baseline.mean.mean) < _MISFIT_LIMIT * self.baseline.noise_model.noise:
            return None
        return self.baseline.mean.mean

    @property
    def alarm_proximity(self) -> float:
        """Largest ratio of a chart's sum to its threshold [0 to 1]."""
        return max((chart.alarm_proximity for chart in self.charts), default=0.0)

    @property
    def relative_spread(self) -> float:
        """Standard deviation within the last block over the noise; zero without a block [-]."""
        if self.baseline is None or not self._recent:
            return 0.0
        block, noise_model = self._recent[-1], self.baseline.noise_model
        return float(np.std(noise_model.weighted(block.residuals, block.rates))) / noise_model.noise

    def restart(self) -> None:
        """Begin anew after a break; the baseline stays."""
        self._start = -1
        self._residuals: list[float] = []
        self._rates: list[float] = []
        self._recent.clear()
        self._previous_block = np.empty(0)
        for chart in self.charts:
            chart.restart()

    def add_residual(self, stamp: int, residual: float, rate: float) -> Departure | None:
        """Add a residual [signal's unit] at a stamp [ns]; `rate` is that of the predicted signal [unit/s]."""
        departure = None
        index = stamp // self._block_length
        if index != self._start // self._block_length and self._residuals:
            departure = self.add_block(ResidualBlock(self._start, np.array(self._residuals), np.array(self._rates)))
            self._residuals, self._rates = [], []
        if not self._residuals:
            self._start = stamp
        self._residuals.append(residual)
        self._rates.append(rate)
        return departure

    def add_block(self, block: ResidualBlock) -> Departure | None:
        """Add a block; return the departure if a chart gives an alarm."""
        if self.baseline is None:
            self._learned.append(block)
            if len(self._learned) == self._blocks_to_learn:
                self._learn()
            return None
        if block.residuals.size < _LEAST_SHARE * self._usual_samples:
            return None
        self._recent.append(block)
        noise_model = self.baseline.noise_model
        weighted = noise_model.weighted(block.residuals, block.rates)
        features = noise_model.features(noise_model.innovations(weighted, self._previous_block)[None])
        self._previous_block = weighted
        rung = [chart for chart, values in zip(self.charts, features) if chart.update(values) >= 0]
        if not rung:
            return None
        self.ring_count += 1
        begin = self._recent[-min(max(rung[0].values_since_change, 1), len(self._recent))].start
        departure = self.describe(begin, is_mean_shift=rung[0] is self.charts[0])
        for chart in rung:
            chart.reset_sums()
        return departure

    def describe(self, since: int, is_mean_shift: bool) -> Departure:
        """Return how the signal departs from its model since a stamp [ns]."""
        assert self.baseline is not None
        usual, noise_model = self.baseline.mean.mean, self.baseline.noise_model
        blocks = [block for block in self._recent if block.start >= since] or list(self._recent)[-1:]
        resting = [block for block in blocks if _is_at_rest(block, noise_model)]
        residuals = np.concatenate([block.residuals for block in blocks])
        return Departure(
            channel=self.name,
            since=since,
            is_mean_shift=is_mean_shift,
            shift=float(np.mean(residuals)) - usual,
            shift_at_rest=float(np.mean([block.mean for block in resting])) - usual if resting else None,
            root_mean_square=rms(residuals),
            usual_rms=self.usual_rms,
        )

    def _learn(self) -> None:
        sizes = [block.residuals.size for block in self._learned]
        self._usual_samples = float(np.median(sizes))
        whole = [block for block in self._learned if block.residuals.size >= _LEAST_SHARE * self._usual_samples]
        self.set_baseline(
            learn_baseline([block.residuals for block in whole], [block.rates for block in whole], self._tolerance)
        )
        self._learned = []

    def set_baseline(self, baseline: Baseline) -> None:
        """Set the baseline, and begin charts of the mean and of the energy."""
        self.baseline = baseline
        self.charts = (
            Chart(baseline.mean, CHARTS / 2.0 * self.mean_run, two_sided=True),
            Chart(baseline.energy, CHARTS * self.mean_run, two_sided=False),
        )


def _is_at_rest(block: ResidualBlock, noise_model: NoiseModel) -> bool:
    """Return whether the predicted signal is at rest in a block."""
    return rms(block.rates) * _REST_TIME < noise_model.noise
