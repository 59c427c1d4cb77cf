# SPDX-License-Identifier: Apache-2.0
"""
Making signals of samples as they come: out of order, twice, with gaps, not a number.

All of it happens in place and part by part, so that it takes no memory beside the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import NANOSECONDS, earliest_after
from cfd_pneumatic.recording.memory_maps import parts
from cfd_pneumatic.recording.message_texts import count_of

MAX_DISORDER = 1.0
"""Time [s] by which a sample may come late; more means that the clock was set back."""

GAP = 5.0
"""An interval of so many usual ones is a gap."""

JITTER = 0.5
"""Spread of the intervals, as a part of the usual one, from which on it is mentioned."""

_RESOLUTION = 10_000
"""Steps into which the mean interval is divided to tell the usual one."""

_LONGEST = 20
"""Mean intervals that no more than a twentieth of all can exceed."""


@dataclass(frozen=True)
class Cleaned:
    """
    Samples in order.

    Attributes
    ----------
    times : (n,) array of int
        Strictly increasing times [ns].
    values : (n,) array
        Finite values.
    notes : tuple of str
        What was amiss.

    """

    times: NDArray[np.int64]
    values: Array
    notes: tuple[str, ...]


def clean(times: NDArray[np.int64], values: Array, name: str, *, held: bool = False) -> Cleaned:
    """
    Return samples sorted, each time once, finite; they are moved within the arrays that are given.

    Parameters
    ----------
    times : (n,) array of int
        Times [ns].
    values : (n,) array
        Values.
    name : str
        Name of the signal, for messages.
    held : bool
        Whether a value holds until the next, as a set-point does: of several at one time the last counts instead of the
        first, and intervals may differ.

    Raises
    ------
    InputError
        If no finite sample is there, or time goes back by more than `MAX_DISORDER`.

    """
    notes = []
    given = len(times)
    times, values = keep(times, values, lambda part: np.isfinite(values[part]))
    if not len(times):
        raise InputError(f'{name} holds no finite number')
    if len(times) < given:
        notes.append(f'{name}: dropped {count_of(given - len(times), "sample")} not finite')

    late = _count_late(times, name)
    if late:
        _sort(times, values)
        notes.append(f'{name}: sorted {count_of(late, "sample")} out of order')

    finite = len(times)
    times, values = keep(times, values, lambda part: (_ends if held else _begins)(times, part))
    if len(times) < finite:
        kept = 'last' if held else 'first'
        notes.append(f'{name}: {count_of(finite - len(times), "sample")} at the time of another, kept the {kept}')

    if not held:
        notes += _describe_intervals(times, name)
    return Cleaned(times, values, tuple(notes))


def share_at_shared_times(times: NDArray[np.int64], values: Array) -> float:
    """Return which share of the samples has the time of the sample before, and another value."""
    shared = sum(int(np.count_nonzero(~_begins(times, part) & _begins(values, part))) for part in parts(times, values))
    return shared / max(1, len(times))


def at_changes(cleaned: Cleaned) -> Cleaned:
    """Return the samples that begin a new value, the first included; they are moved within their arrays."""
    times, values = keep(cleaned.times, cleaned.values, lambda part: _begins(cleaned.values, part))
    if len(times) < len(cleaned.times) / 2:
        times, values = times.copy(), values.copy()  # or the rest would stay in memory
    return Cleaned(times, values, cleaned.notes)


def keep(
    times: NDArray[np.int64], values: Array, wanted: Callable[[slice], NDArray[np.bool_]]
) -> tuple[NDArray[np.int64], Array]:
    """Move the samples of which a function of a part says that they are wanted to the front, and return them."""
    end = 0
    for part in parts(times, values):
        which = wanted(part)
        count = int(np.count_nonzero(which))
        if end < part.start or count < len(which):
            times[end : end + count] = times[part][which]
            values[end : end + count] = values[part][which]
        end += count
    return times[:end], values[:end]


def _begins(numbers: NDArray[Any], part: slice) -> NDArray[np.bool_]:
    """Return which numbers of a part differ from the one before."""
    before = numbers[max(part.start - 1, 0) : part.stop]
    differ: NDArray[np.bool_] = before[1:] != before[:-1]
    return differ if part.start else np.append(True, differ)


def _ends(numbers: NDArray[Any], part: slice) -> NDArray[np.bool_]:
    """Return which numbers of a part differ from the one after."""
    after = numbers[part.start : part.stop + 1]
    differ: NDArray[np.bool_] = after[1:] != after[:-1]
    return differ if part.stop < len(numbers) else np.append(differ, True)


def _count_late(times: NDArray[np.int64], name: str) -> int:
    """Return how many samples come after a later one."""
    late = worst = where = 0
    latest = times[0]
    for part in parts(times):
        behind = np.maximum(np.maximum.accumulate(times[part]), latest) - times[part]
        late += int(np.count_nonzero(behind))
        if behind.max() > worst:
            worst, where = int(behind.max()), part.start + int(np.argmax(behind))
        latest = max(latest, times[part].max())
    if worst > MAX_DISORDER * NANOSECONDS and late == len(times) - 1 and late > 1:
        raise InputError(f'{name}: time runs backwards from the first sample to the last: turn the rows round')
    if worst > MAX_DISORDER * NANOSECONDS:
        raise InputError(
            f'{name}: time goes back by {worst / NANOSECONDS:.3f} s at sample {where + 1:,}: '
            'the clock was set back or two recordings are in one; split it there'
        )
    return late


def _sort(times: NDArray[np.int64], values: Array) -> None:
    """Sort by time; samples of equal times stay as they are."""
    limits = earliest_after([int(times[part].min()) for part in parts(times)])
    waiting_times, waiting_values = times[:0], values[:0]
    end = 0
    for part, limit in zip(parts(times, values), limits):
        some_times = np.concatenate([waiting_times, times[part]])
        some_values = np.concatenate([waiting_values, values[part]])
        order = np.argsort(some_times, kind='stable')
        some_times, some_values = some_times[order], some_values[order]
        ready = int(np.searchsorted(some_times, limit, side='right'))
        times[end : end + ready], values[end : end + ready] = some_times[:ready], some_values[:ready]
        waiting_times, waiting_values = some_times[ready:], some_values[ready:]
        end += ready


def _describe_intervals(times: NDArray[np.int64], name: str) -> list[str]:
    if len(times) < 3:
        return []
    low, usual, high = quantiles_of_intervals(times, (0.05, 0.5, 0.95))
    notes = []
    if high - low > JITTER * usual:
        notes.append(f'{name}: intervals of {1e-6 * low:.4g} to {1e-6 * high:.4g} ms about {1e-6 * usual:.4g} ms')
    gaps = longest = 0
    for intervals in _intervals(times):
        gaps += int(np.count_nonzero(intervals > GAP * usual))
        longest = max(longest, int(intervals.max()))
    if gaps:
        notes.append(f'{name}: {count_of(gaps, "gap")}, the longest {longest / NANOSECONDS:.4g} s')
    return notes


def _intervals(times: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Yield the times between samples [ns], part by part."""
    for part in parts(times[:-1]):
        yield np.diff(times[part.start : part.stop + 1])


def quantiles_of_intervals(times: NDArray[np.int64], fractions: Sequence[float]) -> list[float]:
    """Return quantiles, up to 0.95, of the times between samples [ns], to a part in `_RESOLUTION` of the mean."""
    count = len(times) - 1
    mean = int(times[-1] - times[0]) / count
    width = max(1, int(mean / _RESOLUTION))
    last = int(_LONGEST * mean / width) + 1
    bins = np.zeros(last + 1, np.int64)
    for intervals in _intervals(times):
        bins += np.bincount(np.minimum(intervals // width, last), minlength=last + 1)
    ranks = np.array(fractions) * (count - 1)
    below, above = (np.searchsorted(np.cumsum(bins), side(ranks), side='right') for side in (np.floor, np.ceil))
    between = below + (above - below) * (ranks % 1.0)
    return [float(quantile) for quantile in between * width + (width - 1) / 2]
