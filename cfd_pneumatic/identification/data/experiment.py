# SPDX-License-Identifier: Apache-2.0
"""A measured signal of a recording and the inputs of its model, on a common time grid."""

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
        Last grid time before the piece, then the grid times of the piece, shape (n,) [s].
    inputs
        Inputs of the model at these times, by name, each of shape (n,) [SI].
    samples
        Samples of the experiment that the piece holds.
    sample_indices
        Indices of these samples in `times`.

    """

    times: Array
    inputs: Mapping[str, Array]
    samples: slice
    sample_indices: NDArray[np.intp] | slice


@dataclass(frozen=True)
class Experiment:
    """
    A measured signal of a recording, and the inputs of its model.

    The grid holds the times of every signal, so that no signal is resampled. The displacement is a straight line
    between its samples, as the model assumes.

    Attributes
    ----------
    recording
        Name of the recording.
    times
        Grid, increasing, shape (n,) [s].
    inputs
        Inputs of the model, by name, each of shape (n,) [SI]; the channel defines the names.
    samples
        Grid indices of the samples, shape (m,).
    measured
        The signal at its samples, shape (m,) [SI].
    part
        Index into `split.PARTS` for each sample, shape (m,).
    motion
        The smoothed displacement of the recording.
    starts_at_rest
        Whether the piston rests at the start.
    drifts
        Whether the set-point was not recorded and may drift.
    index
        Index of the recording among those that are fitted together: its row of `Model.own`.
    chosen
        Samples that a fit counts, shape (m,); None: the samples before the test part.
    cut_from
        Start of the recording [s], if the experiment is cut from its middle and starts as measured there; else None.

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
    def starts_with_recording(self) -> bool:
        """Whether the experiment begins where the recording begins."""
        return self.cut_from is None

    @property
    def begin(self) -> float:
        """Start of the recording [s]."""
        return float(self.times[0]) if self.cut_from is None else self.cut_from

    def at_samples(self, name: str) -> Array:
        """Return an input at the samples, shape (m,) [SI]."""
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
        """Extremes of pressure [Pa] and displacement [m], and the highest speed [m/s], for a pressure's inputs."""
        return extremes(self.times, self.inputs['displacement'], self.inputs['setpoint'])

    @lazy_property
    def parabolic(self) -> Experiment | None:
        """
        The experiment with parabolas from sample to sample that replace the straight lines; None if none is replaced.

        Inputs hold the `acceleration` [m/s^2] on the step that ends at each grid time, too. This acceleration keeps the
        mean displacement of the step. None for a long experiment, too, because parabolas take memory.
        """
        if self.times.size > LONGEST_PARABOLIC:
            return None
        setpoint, displacement = self.inputs['setpoint'], self.inputs['displacement']
        needed = np.append(setpoint[1:] != setpoint[:-1], True)
        needed[0] = needed[self.samples] = True
        line_counts = np.diff(np.flatnonzero(needed))
        needed[1:] |= np.repeat(line_counts > MOST_PARABOLA_LINES, line_counts)
        kept = np.flatnonzero(needed)
        if kept.size == self.times.size:
            return None
        inputs = {name: values[kept] for name, values in self.inputs.items()}
        durations, knot_displacement = np.diff(self.times[kept]), inputs['displacement']
        integrals = np.add.reduceat(0.5 * (displacement[1:] + displacement[:-1]) * np.diff(self.times), kept[:-1])
        bend = np.where(
            np.diff(kept) > 1, 0.5 * (knot_displacement[1:] + knot_displacement[:-1]) - integrals / durations, 0.0
        )
        return replace(
            self,
            times=self.times[kept],
            inputs={**inputs, 'acceleration': np.append(0.0, 12.0 * bend / durations**2)},
            samples=np.searchsorted(kept, self.samples),
        )

    @property
    def fitted(self) -> Mask:
        """Samples before the test part, shape (m,)."""
        return self.part < PARTS.index('test')

    @property
    def counts(self) -> Mask:
        """Samples that a fit counts, shape (m,)."""
        return self.fitted if self.chosen is None else self.chosen

    @property
    def settled(self) -> Mask:
        """Samples from the first one that a fit counts on, shape (m,); earlier samples depend on the start."""
        return np.asarray(np.maximum.accumulate(self.counts | ~self.fitted))

    @property
    def first_value(self) -> float:
        """The signal at the start of the experiment: the median of a few samples [SI]."""
        return float(np.median(self.measured[:START_SAMPLES]))

    @property
    def span(self) -> float:
        """Span p99 - p1 of the signal over the whole recording [SI]."""
        low, high = np.percentile(self.measured, [1.0, 99.0])
        return float(high - low)

    def until(self, part: str) -> Experiment:
        """
        Return the experiment up to the end of a part; the inputs go on a little.

        If all samples are later than the part, a few samples remain that do not count.
        """
        last = int(np.max(np.flatnonzero(self.part <= PARTS.index(part)), initial=FEWEST_SAMPLES - 1))
        end = self.sample_times[last] + INPUT_MARGIN
        grid = int(np.searchsorted(self.times, end, side='right'))
        cut = self._cut(slice(0, grid), slice(0, last + 1))
        return replace(cut, chosen=cut.counts & (cut.part <= PARTS.index(part)))

    def liveliest(self, steps: int) -> slice:
        """
        Return the samples of the stretch of `steps` grid steps in which the piston moves farthest.

        Motion between samples that do not count is ignored. All samples are returned if the experiment is shorter.
        """
        last = self.times.size - 1
        if last <= steps:
            return slice(0, self.samples.size)
        moved = np.abs(np.diff(self.at_samples('displacement'), prepend=self.inputs['displacement'][self.samples[0]]))
        travel = np.append(0.0, np.cumsum(moved * self.counts))
        firsts = np.arange(0, last - steps + 1, max(1, steps // 4))
        begins, ends = (np.searchsorted(self.samples, firsts + offset, side='right') for offset in (0, steps))
        best = int(np.argmax(travel[ends] - travel[begins]))
        return slice(int(begins[best]), int(ends[best]))

    def stretch(self, samples: slice) -> Experiment:
        """Return the part of the experiment with some adjacent samples; the experiment itself if these are all."""
        if samples == slice(0, self.samples.size):
            return self
        first_step = int(self.samples[samples.start]) if samples.start else 0
        return self._cut(slice(first_step, int(self.samples[samples.stop - 1]) + 1), samples)

    def blocks(
        self, count: int | None = None, delay: float = 0.0, displacement_delay: float = 0.0, setpoint_delay: float = 0.0
    ) -> Iterator[Block]:
        """
        Yield the experiment in pieces, up to sample number `count` or to the end.

        The samples were taken `delay` seconds before their stamps; the grid holds these earlier times, too.
        The displacement is stamped `displacement_delay` seconds after the piston was there. A set-point acts
        `setpoint_delay` seconds after its command; the grid holds the times from which set-points act, too.
        """
        previous_end = self.times[0]
        for begin in range(0, self.samples.size if count is None else count, BLOCK_SAMPLES):
            samples = slice(begin, min(begin + BLOCK_SAMPLES, self.samples.size))
            block = self._early_block(samples, delay, previous_end) if delay else self._block(samples)
            previous_end = block.times[-1]
            if displacement_delay:
                block = block._replace(
                    inputs={**block.inputs, 'displacement': self._displacement(block.times + displacement_delay)}
                )
            yield self._with_late_setpoint(block, setpoint_delay) if setpoint_delay else block

    def _block(self, samples: slice) -> Block:
        """Return the piece that holds some adjacent samples."""
        first_step = int(self.samples[samples.start - 1]) if samples.start else 0
        indices = self.samples[samples] - first_step
        grid = slice(first_step, first_step + int(indices[-1]) + 1)
        is_contiguous = indices[-1] - indices[0] == indices.size - 1
        inputs = {name: values[grid] for name, values in self.inputs.items()}
        sample_indices = slice(int(indices[0]), int(indices[-1]) + 1) if is_contiguous else indices
        return Block(self.times[grid], inputs, samples, sample_indices)

    def _early_block(self, samples: slice, delay: float, previous_end: float) -> Block:
        """Return the piece of adjacent samples that were taken a delay before their stamps, from `previous_end` on."""
        taken = np.clip(self.times[self.samples[samples]] - delay, self.times[0], self.times[-1])
        grid = slice(*np.searchsorted(self.times, [previous_end, taken[-1]], side='right').tolist())
        times = np.union1d(self.times[grid], np.append(previous_end, taken))
        ends = np.searchsorted(self.times, times)  # grid steps that end at these times or later
        inputs = {name: values[ends] for name, values in self.inputs.items()}
        inputs['displacement'] = self._displacement(times)
        return Block(times, inputs, samples, np.searchsorted(times, taken))

    def _with_late_setpoint(self, block: Block, delay: float) -> Block:
        """Return a piece in which each set-point acts a delay after its command; the first was always commanded."""
        begins, setpoints = self._commands
        acting_from = begins + delay
        within = (acting_from > block.times[0]) & (acting_from < block.times[-1])
        times = np.union1d(block.times, acting_from[within])
        kept = np.searchsorted(times, block.times)
        inputs = {name: np.interp(times, block.times, values) for name, values in block.inputs.items()}
        inputs['setpoint'] = setpoints[np.searchsorted(acting_from, np.append(times[0], times[:-1]), side='right')]
        if 'acceleration' in inputs:
            ends = np.searchsorted(block.times, times)  # steps of the piece that end at these times or later
            inputs['acceleration'] = block.inputs['acceleration'][ends]
            remaining = block.times[ends] - times
            passed = times - block.times[np.maximum(ends - 1, 0)]
            inputs['displacement'] -= 0.5 * inputs['acceleration'] * passed * remaining
        return Block(times, inputs, block.samples, kept[block.sample_indices])

    @lazy_property
    def _commands(self) -> tuple[Array, Array]:
        """Times at which the commanded set-point changes, shape (n,) [s], and the set-points, shape (n + 1,) [Pa]."""
        setpoint = self.inputs['setpoint']
        changed = np.flatnonzero(np.diff(setpoint))
        return self.times[changed], setpoint[np.append(changed, setpoint.size - 1)]

    def _displacement(self, times: Array) -> Array:
        """Return the displacement at increasing times, shape (n,) [m]; after the last grid time its rate stays."""
        displacement = self.inputs['displacement']
        rate = (displacement[-1] - displacement[-2]) / (self.times[-1] - self.times[-2])
        return np.asarray(np.interp(times, self.times, displacement) + rate * np.maximum(times - self.times[-1], 0.0))

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
    """Return the shortest sampling period of the experiments [s]."""
    return min(experiment.period for experiment in experiments)


def rests_at_start(motion: Motion) -> bool:
    """
    Return whether a piston that moves in a recording rests at the start.

    A piston that never moves does not count: the set-point may have changed just before the start.
    """
    first_samples = motion.displacement[:REST_SAMPLES]
    limit = max(LEAST_MOTION * motion.noise, LARGEST_MOTION_AT_REST * motion.reach)
    return motion.reach > 0.0 and bool(np.ptp(first_samples) <= limit)
