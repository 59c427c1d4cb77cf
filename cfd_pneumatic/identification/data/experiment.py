# SPDX-License-Identifier: Apache-2.0
"""One measured signal of one recording beside what drives its model, on one time grid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.data.thresholds import (
    BLOCK_SAMPLES,
    FEWEST_SAMPLES,
    INPUT_MARGIN,
    LARGEST_MOTION_AT_REST,
    LEAST_MOTION,
    LONGEST_PARABOLIC,
    MOST_PARABOLA_LINES,
    REST_SAMPLES,
    START_SAMPLES,
)
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model import extremes


class Block(NamedTuple):
    """
    A piece of an experiment.

    Attributes
    ----------
    times
        The last grid time before it, which it begins from, and its own, shape (n,) [s].
    inputs
        What drives the model there, by name, each of shape (n,) [SI].
    samples
        Its samples among those of the experiment.
    at
        Their places in `times`.

    """

    times: Array
    inputs: Mapping[str, Array]
    samples: slice
    at: NDArray[np.intp] | slice


@dataclass(frozen=True)
class Experiment:
    """
    What was measured of one signal in one recording, and the inputs of its model.

    The grid holds the times of every signal, so that none of them is resampled: the displacement is a straight line
    between its samples, as the model takes it to be.

    Attributes
    ----------
    recording
        Name of the recording.
    times
        Grid, increasing, shape (n,) [s].
    inputs
        What drives the model, by name, each of shape (n,) [SI]; the channel says which there are.
    samples
        Grid indices of the samples, shape (m,).
    measured
        The signal at its samples, shape (m,) [SI].
    part
        Index into `split.PARTS` of each sample, shape (m,).
    motion
        The smoothed displacement of the recording.
    starts_at_rest
        Whether the piston stands still at the start.
    drifts
        Whether what nobody recorded may drift.
    index
        Of the recording among those that are fitted together: its row of `Model.own`.
    chosen
        Which samples a fit counts, shape (m,); None: those before the test part.
    cut_from
        When its recording began [s], of what is cut from its middle and starts as measured there; None otherwise.

    """

    recording: str
    times: Array
    inputs: Mapping[str, Array]
    samples: NDArray[np.intp]
    measured: Array
    part: NDArray[np.int8]
    motion: Motion
    starts_at_rest: bool
    drifts: bool = False
    index: int = 0
    chosen: Mask | None = None
    cut_from: float | None = None

    @property
    def whole(self) -> bool:
        """Whether it begins where its recording does."""
        return self.cut_from is None

    @property
    def begin(self) -> float:
        """When its recording began [s]."""
        return float(self.times[0]) if self.cut_from is None else self.cut_from

    def at_samples(self, name: str) -> Array:
        """Return an input at the samples, shape (m,)."""
        return self.inputs[name][self.samples]

    @property
    def sample_times(self) -> Array:
        """Times of the samples, shape (m,) [s]."""
        return self.times[self.samples]

    @lazy_property
    def period(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.sample_times)))

    @lazy_property
    def extremes(self) -> tuple[tuple[float, float], tuple[float, float], float]:
        """Extremes of pressure [Pa] and displacement [m], and the highest speed [m/s], where these are its inputs."""
        return extremes(self.times, self.inputs['displacement'], self.inputs['setpoint'])

    @lazy_property
    def parabolic(self) -> Experiment | None:
        """
        The same with the piston on a parabola from sample to sample, where few straight lines followed it in between.

        Its inputs hold the `acceleration` on the step that ends at each grid time, too [m/s^2]: the one by which the
        mean displacement of the step stays what it is. None where no line goes, and of what is long: it takes memory.
        """
        if self.times.size > LONGEST_PARABOLIC:
            return None
        held, moved = self.inputs['setpoint'], self.inputs['displacement']
        needed = np.append(held[1:] != held[:-1], True)
        needed[0] = needed[self.samples] = True
        lines = np.diff(np.flatnonzero(needed))
        needed[1:] |= np.repeat(lines > MOST_PARABOLA_LINES, lines)
        kept = np.flatnonzero(needed)
        if kept.size == self.times.size:
            return None
        inputs = {name: values[kept] for name, values in self.inputs.items()}
        lasting, ends = np.diff(self.times[kept]), inputs['displacement']
        swept = np.add.reduceat(0.5 * (moved[1:] + moved[:-1]) * np.diff(self.times), kept[:-1])
        bend = np.where(np.diff(kept) > 1, 0.5 * (ends[1:] + ends[:-1]) - swept / lasting, 0.0)
        return replace(
            self,
            times=self.times[kept],
            inputs={**inputs, 'acceleration': np.append(0.0, 12.0 * bend / lasting**2)},
            samples=np.searchsorted(kept, self.samples),
        )

    @property
    def fitted(self) -> Mask:
        """Which samples lie before the test part, shape (m,)."""
        return self.part < PARTS.index('test')

    @property
    def counts(self) -> Mask:
        """Which samples a fit counts, shape (m,)."""
        return self.fitted if self.chosen is None else self.chosen

    @property
    def settled(self) -> Mask:
        """Which samples come at or after the first one that a fit counts, shape (m,); before it the start decides."""
        return np.asarray(np.maximum.accumulate(self.counts | ~self.fitted))

    @property
    def first(self) -> float:
        """The signal where the experiment begins: the median of a few samples [SI]."""
        return float(np.median(self.measured[:START_SAMPLES]))

    @property
    def span(self) -> float:
        """Span p99 - p1 of the signal over the whole recording [SI]."""
        low, high = np.percentile(self.measured, [1.0, 99.0])
        return float(high - low)

    def until(self, part: str) -> Experiment:
        """
        Return the experiment without the samples that come after a part; the inputs go on a little.

        A few samples are left where all come after it; these don't count.
        """
        last = int(np.max(np.flatnonzero(self.part <= PARTS.index(part)), initial=FEWEST_SAMPLES - 1))
        end = self.sample_times[last] + INPUT_MARGIN
        grid = int(np.searchsorted(self.times, end, side='right'))
        cut = self._cut(slice(0, grid), slice(0, last + 1))
        return replace(cut, chosen=cut.counts & (cut.part <= PARTS.index(part)))

    def liveliest(self, steps: int) -> slice:
        """
        Return the samples of so many grid steps in which the piston moves farthest; all where there are no more steps.

        Motion between samples that don't count is none.
        """
        last = self.times.size - 1
        if last <= steps:
            return slice(0, self.samples.size)
        moved = np.abs(np.diff(self.at_samples('displacement'), prepend=self.inputs['displacement'][self.samples[0]]))
        travel = np.append(0.0, np.cumsum(moved * self.counts))
        firsts = np.arange(0, last - steps + 1, max(1, steps // 4))
        begins, ends = (np.searchsorted(self.samples, firsts + beyond, side='right') for beyond in (0, steps))
        best = int(np.argmax(travel[ends] - travel[begins]))
        return slice(int(begins[best]), int(ends[best]))

    def stretch(self, samples: slice) -> Experiment:
        """Return the part with some neighbouring samples, from the first one on; itself where these are all."""
        if samples == slice(0, self.samples.size):
            return self
        first = int(self.samples[samples.start]) if samples.start else 0
        return self._cut(slice(first, int(self.samples[samples.stop - 1]) + 1), samples)

    def blocks(self, count: int | None = None, delay: float = 0.0, late: float = 0.0) -> Iterator[Block]:
        """
        Yield the experiment up to the last of so many samples, or of all, in pieces.

        The samples were taken `delay` seconds before they are stamped; then the grid holds these times, too. The
        displacement is stamped `late` seconds after the piston was there.
        """
        last = self.times[0]
        for begin in range(0, self.samples.size if count is None else count, BLOCK_SAMPLES):
            samples = slice(begin, min(begin + BLOCK_SAMPLES, self.samples.size))
            block = self._early(samples, delay, last) if delay else self._block(samples)
            last = block.times[-1]
            if late:
                block = block._replace(inputs={**block.inputs, 'displacement': self._displacement(block.times + late)})
            yield block

    def _block(self, samples: slice) -> Block:
        """Return some neighbouring samples."""
        first = int(self.samples[samples.start - 1]) if samples.start else 0
        at = self.samples[samples] - first
        grid = slice(first, first + int(at[-1]) + 1)
        at_each = at[-1] - at[0] == at.size - 1
        inputs = {name: values[grid] for name, values in self.inputs.items()}
        return Block(self.times[grid], inputs, samples, slice(int(at[0]), int(at[-1]) + 1) if at_each else at)

    def _early(self, samples: slice, delay: float, last: float) -> Block:
        """Return some neighbouring samples, taken a delay before their stamps, behind a block that ends at a time."""
        taken = np.clip(self.times[self.samples[samples]] - delay, self.times[0], self.times[-1])
        between = slice(*np.searchsorted(self.times, [last, taken[-1]], side='right').tolist())
        times = np.union1d(self.times[between], np.append(last, taken))
        step = np.searchsorted(self.times, times)  # that ends there or later
        inputs = {name: values[step] for name, values in self.inputs.items()}
        inputs['displacement'] = self._displacement(times)
        return Block(times, inputs, samples, np.searchsorted(times, taken))

    def _displacement(self, times: Array) -> Array:
        """Return the displacement at increasing times, shape (n,) [m]; beyond the last one it goes on as it went."""
        known = self.inputs['displacement']
        rate = (known[-1] - known[-2]) / (self.times[-1] - self.times[-2])
        return np.asarray(np.interp(times, self.times, known) + rate * np.maximum(times - self.times[-1], 0.0))

    def _cut(self, grid: slice, samples: slice) -> Experiment:
        return replace(
            self,
            times=self.times[grid],
            inputs={name: values[grid] for name, values in self.inputs.items()},
            samples=self.samples[samples] - grid.start,
            measured=self.measured[samples],
            part=self.part[samples],
            chosen=None if self.chosen is None else self.chosen[samples],
            cut_from=self.begin if grid.start else self.cut_from,
        )


def shortest_period(experiments: Sequence[Experiment]) -> float:
    """Return the shortest of the experiments' periods of samples [s]."""
    return min(one.period for one in experiments)


def rests_at_start(motion: Motion) -> bool:
    """
    Return whether the piston stands still at the start of a recording that moves it.

    One that never does may begin anywhere: what moves there is the set-point, perhaps a moment before.
    """
    opening = motion.displacement[:REST_SAMPLES]
    largest = max(LEAST_MOTION * motion.noise, LARGEST_MOTION_AT_REST * motion.reach)
    return motion.reach > 0.0 and bool(np.ptp(opening) <= largest)
