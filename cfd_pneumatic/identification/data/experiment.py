"""One cylinder in one recording, made ready for the model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.motion import Motion, smooth_motion
from cfd_pneumatic.identification.data.split import MOTION, PARTS, Split, stroke_times
from cfd_pneumatic.identification.data.stamps import regular_clock
from cfd_pneumatic.model import DIRECTIONS
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.recording.spool import PART, Growing, extent, give_back, parts, thinned

Array = NDArray[np.float64]

_BEYOND = 0.5  # longest time by which a pressure may be read early [s]
_LARGEST_PRESSURE = 1e9  # [Pa]
_LARGEST_DISPLACEMENT = 1e3  # [m]
_BLOCK = 4096  # samples: what is simulated of them stays in a processor's cache
_STRETCH = 65_536  # samples
_STRETCHES = 16  # that tell what the noise of a long recording is like
_FEWEST_SAMPLES = 20  # four gains, a set-point, and something left to judge them by


class Block(NamedTuple):
    """
    A piece of an experiment.

    Attributes
    ----------
    grid
        Its grid times: the last one before it, which it begins from, and its own.
    samples
        Its pressure samples among those of the experiment.
    at
        Their places in `grid`.

    """

    grid: slice
    samples: slice
    at: NDArray[np.intp] | slice


@dataclass(frozen=True)
class Experiment:
    """
    Inputs of the model on one time grid, and what was measured.

    The grid is the union of the times of displacement, set-point and pressure, so that none of them is resampled: the
    displacement is a straight line between its samples, as the model takes it to be.

    Attributes
    ----------
    recording
        Name of the recording.
    cylinder
        Name of the cylinder.
    times
        Grid, increasing, shape (n,) [s].
    displacement
        Smoothed displacement that grows this chamber, shape (n,) [m].
    setpoint
        Absolute set-point on the step that ends at each grid time, shape (n,) [Pa].
    setpoint_recorded
        False where the set-point is a constant that the fit has to find.
    samples
        Grid indices of the pressure samples, shape (m,).
    pressure
        Measured absolute pressure, shape (m,) [Pa].
    part
        Index into `split.PARTS` of each pressure sample, shape (m,).
    starts_at_rest
        Whether the piston stands still at the start, so that the pressure there is the set-point.
    motion
        The smoothed displacement, with its noise.

    """

    recording: str
    cylinder: str
    times: Array
    displacement: Array
    setpoint: Array
    setpoint_recorded: bool
    samples: NDArray[np.intp]
    pressure: Array
    part: NDArray[np.int8]
    starts_at_rest: bool
    motion: Motion

    @property
    def sample_times(self) -> Array:
        """Times of the pressure samples, shape (m,) [s]."""
        return self.times[self.samples]

    @cached_property
    def fitted(self) -> NDArray[np.bool_]:
        """Which pressure samples a model is fitted to, those before the test part, shape (m,)."""
        fitted = Growing(np.bool_)
        for part in parts(self.part):
            fitted.append(self.part[part] < PARTS.index('test'))
        return fitted.array()

    def until(self, part: str) -> Experiment:
        """
        Return the experiment without the pressure samples that come after a part; the motion goes on a little.

        A few samples are left where all come after it.
        """
        last = int(np.max(np.flatnonzero(self.part <= PARTS.index(part)), initial=_FEWEST_SAMPLES - 1))
        end = self.sample_times[last] + _BEYOND
        grid = int(np.searchsorted(self.times, end, side='right'))
        return replace(
            self,
            times=self.times[:grid],
            displacement=self.displacement[:grid],
            setpoint=self.setpoint[:grid],
            samples=self.samples[: last + 1],
            pressure=self.pressure[: last + 1],
            part=self.part[: last + 1],
        )

    def liveliest(self, steps: int, counts: NDArray[np.bool_]) -> tuple[Experiment, slice]:
        """
        Return the part of so many grid steps in which the piston moves farthest, and which samples are in it.

        It is the whole where that has no more steps. Only motion counts at whose samples `counts` is true, shape (m,).
        """
        last = self.times.size - 1
        if last <= steps:
            return self, slice(0, self.samples.size)
        firsts = np.arange(0, last - steps + 1, max(1, steps // 4))
        travelled = self._travelled(np.concatenate([firsts, firsts + steps]), counts)
        first = int(firsts[np.argmax(travelled[firsts.size :] - travelled[: firsts.size])])
        return self._between(first, first + steps)

    def stretches(self) -> Iterator[tuple[Experiment, slice]]:
        """Yield the whole, or of a long experiment stretches all over it, and which samples are in each."""
        count = self.samples.size
        if count <= _STRETCHES * _STRETCH:
            yield self, slice(0, count)
            return
        for begin in np.linspace(0, count - _STRETCH, _STRETCHES).astype(int):
            yield self._between(int(self.samples[begin]), int(self.samples[begin + _STRETCH - 1]))

    def _between(self, first: int, last: int) -> tuple[Experiment, slice]:
        """Return the part from one grid time to another, and which samples are in it."""
        begin, end = np.searchsorted(self.samples, [first, last + 1]).tolist()
        part = replace(
            self,
            times=self.times[first : last + 1],
            displacement=self.displacement[first : last + 1],
            setpoint=self.setpoint[first : last + 1],
            samples=self.samples[begin:end] - first,
            pressure=self.pressure[begin:end],
            part=self.part[begin:end],
            starts_at_rest=self.starts_at_rest and first == 0,
        )
        return part, slice(begin, end)

    def _travelled(self, grid: NDArray[np.intp], counts: NDArray[np.bool_]) -> Array:
        """Return how far the piston has moved, where it counts, by some of the grid times."""
        ends, place = np.unique(grid, return_inverse=True)
        travel = np.zeros(ends.size + 1)
        x = self.displacement[self.samples[0]]
        for part in parts(self.samples, self.displacement):
            at = self.samples[part]
            moved = np.abs(np.diff(self.displacement[at], prepend=x))
            travel += np.bincount(np.searchsorted(ends, at), moved * counts[part], travel.size)
            x = self.displacement[at[-1]]
        travelled: Array = np.cumsum(travel)[place]
        return travelled

    def blocks(self) -> Iterator[Block]:
        """Yield the experiment up to its last sample, in pieces that are small against a long recording."""
        first = 0
        for begin in range(0, self.samples.size, _BLOCK):
            samples = slice(begin, min(begin + _BLOCK, self.samples.size))
            at = self.samples[samples] - first
            last = first + int(at[-1])
            at_each = at[-1] - at[0] == at.size - 1
            yield Block(slice(first, last + 1), samples, slice(int(at[0]), int(at[-1]) + 1) if at_each else at)
            first = last
            if samples.stop % PART == 0:
                self.give_back()

    def give_back(self) -> None:
        """Give back the memory of what is kept in files."""
        give_back(self.times, self.displacement, self.setpoint, self.samples, self.pressure, self.part, self.fitted)

    @property
    def span(self) -> float:
        """The measured pressure's span p99 - p1 over the whole recording [Pa]."""
        low, high = np.percentile(thinned(self.pressure), [1.0, 99.0])
        return float(high - low)


def observed_motion(recording: Recording) -> tuple[Motion, Array]:
    """
    Return the smoothed displacement and the times at which its strokes begin and end.

    Raises
    ------
    InputError
        If the recording is too short, nothing moves in it, or its numbers are no displacements.

    """
    signal = recording.displacement
    if signal.times.size < _FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: {signal.times.size} displacement samples are too few to identify anything: '
            f'record at least {_FEWEST_SAMPLES}'
        )
    low, high = extent(signal.values)
    _check_that_plausible(f'{recording.name}: the displacement', low, high, _LARGEST_DISPLACEMENT, 'm')
    motion = smooth_motion(signal.times, signal.values)
    strokes = stroke_times(motion.times, motion.displacement, motion.noise)
    if strokes.size == 0 or high - low <= MOTION * motion.noise:
        raise InputError(
            f'{recording.name}: the piston does not move (range {(high - low) * 1e3:.3g} mm, '
            f'noise {motion.noise * 1e3:.3g} mm): record strokes of the piston'
        )
    return motion, strokes


def make_experiment(recording: Recording, cylinder: str, motion: Motion, split: Split) -> Experiment:
    """
    Return one cylinder of a recording on the model's grid.

    Raises
    ------
    InputError
        If pressure and displacement hardly overlap in time, the pressure never changes, or its numbers are none.

    """
    signals = recording.cylinders[cylinder]
    pressure = _during(motion, Signal(on_clock(signals.pressure.times, motion), signals.pressure.values))
    if len(pressure) < _FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: only {len(pressure)} samples of {cylinder}/pressure lie between the first and the last '
            'displacement sample: check the time offsets of the two topics'
        )
    low, high = extent(pressure.values)
    if low == high:
        raise InputError(f'{recording.name}: {cylinder}/pressure never changes ({low:g} Pa): is its sensor connected?')
    _check_that_plausible(f'{recording.name}: {cylinder}/pressure', low, high, _LARGEST_PRESSURE, 'Pa')
    setpoint = signals.setpoint
    if setpoint is not None:
        setpoint = Signal(motion.on_clock(setpoint.times), setpoint.values)
    else:
        seen = pressure.values[: np.searchsorted(pressure.times, split.bounds[1])]
        level = float(np.median(thinned(seen if seen.size else pressure.values)))
        setpoint = Signal(motion.times[:1], np.array([level]))
    times, displacement, acting = Growing(), Growing(), Growing()
    samples, part = Growing(np.intp), Growing(np.int8)
    begin = float(np.nextafter(motion.times[0], -np.inf))
    for piece in motion.pieces():
        if begin >= pressure.times[-1]:
            break
        end = min(piece.times[-1], pressure.times[-1])
        sampled = _after(begin, end, pressure.times)
        grid = np.unique(np.concatenate([piece.knots(), sampled, _after(begin, end, setpoint.times)]))
        grid = _after(begin, end, grid)
        samples.append(len(times) + np.searchsorted(grid, sampled))
        part.append(split.part_of(sampled))
        times.append(grid)
        displacement.append(DIRECTIONS[cylinder] * piece.at(grid))
        acting.append(_held(setpoint, np.maximum(np.append(begin, grid[:-1]), motion.times[0])))
        begin = end
        give_back(pressure.times, setpoint.times, setpoint.values)
    return Experiment(
        recording=recording.name,
        cylinder=cylinder,
        times=times.array(),
        displacement=displacement.array(),
        setpoint=acting.array(),
        setpoint_recorded=signals.setpoint is not None,
        samples=samples.array(),
        pressure=pressure.values,
        part=part.array(),
        starts_at_rest=_rests_at_start(motion),
        motion=motion,
    )


def _check_that_plausible(name: str, low: float, high: float, most: float, unit: str) -> None:
    if max(-low, high) > most:
        raise InputError(
            f'{name} goes from {low:.3g} to {high:.3g} {unit}, which no device does: is it what the topic or column '
            'holds, and in the unit that the mapping says?'
        )


def on_clock(stamps: Array, motion: Motion) -> Array:
    """Return when a pressure's samples were taken [s]: with the displacement's, or by a clock of their own."""
    if motion.stamps is motion.times:
        return stamps
    if _all_among(stamps, motion.stamps):
        return motion.on_clock(stamps)
    clock = regular_clock(stamps)
    return stamps if clock is None else clock


def _all_among(stamps: Array, others: Array) -> bool:
    return all(
        np.array_equal(others[np.minimum(np.searchsorted(others, stamps[part]), others.size - 1)], stamps[part])
        for part in parts(stamps, others)
    )


def _during(motion: Motion, signal: Signal) -> Signal:
    """Return the samples from the first of the displacement to its last."""
    first = int(np.searchsorted(signal.times, motion.times[0]))
    last = int(np.searchsorted(signal.times, motion.times[-1], side='right'))
    return Signal(signal.times[first:last], signal.values[first:last])


def _after(begin: float, end: float, times: Array) -> Array:
    """Return those of increasing times that lie after one and up to another [s]."""
    first, last = np.searchsorted(times, [begin, end], side='right')
    return times[first:last]


def _held(setpoint: Signal, begins: Array) -> Array:
    """Return the set-points held when steps begin: they act until their ends."""
    held = np.searchsorted(setpoint.times, begins, side='right') - 1
    values: Array = setpoint.values[np.maximum(held, 0)]
    return values


def _rests_at_start(motion: Motion) -> bool:
    opening = motion.displacement[:10]
    return bool(np.ptp(opening) <= max(MOTION * motion.noise, 2e-3 * motion.reach))
