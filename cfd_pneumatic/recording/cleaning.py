# SPDX-License-Identifier: Apache-2.0
"""
Clean raw samples: sort them, and drop repeated times and values that are not finite.

The functions work in place and part by part, so that they need no memory in addition to the samples.
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
"""Largest delay of a sample behind later samples [s]; a larger delay means that the clock was set back."""

GAP = 5.0
"""Shortest gap, as a multiple of the usual interval."""

JITTER = 0.5
"""Spread of the intervals, as a part of the usual interval, above which a note reports the spread."""

_RESOLUTION = 10_000
"""Number of histogram bins per mean interval."""

_LONGEST = 20
"""Length of the histogram in mean intervals; at most a twentieth of all intervals can be longer."""


@dataclass(frozen=True)
class Cleaned:
    """
    Samples in order of time.

    Attributes
    ----------
    times : (n,) array of int
        Strictly increasing times [ns].
    values : (n,) array
        Finite values.
    notes : tuple of str
        Defects of the raw samples.

    """

    times: NDArray[np.int64]
    values: Array
    notes: tuple[str, ...]


def clean(times: NDArray[np.int64], values: Array, name: str, *, held: bool = False) -> Cleaned:
    """
    Return finite samples at strictly increasing times; the function modifies the arrays.

    Parameters
    ----------
    times : (n,) array of int
        Times [ns].
    values : (n,) array
        Values.
    name : str
        Name of the signal, for messages.
    held : bool
        Whether a value holds until the next, as a set-point does. Then the last of several values at a time counts
        instead of the first, and intervals may differ.

    Raises
    ------
    InputError
        If there is no finite sample, or time goes back by more than `MAX_DISORDER`.

    """
    notes = []
    count = len(times)
    times, values = keep(times, values, lambda part: np.isfinite(values[part]))
    if not len(times):
        raise InputError(f'{name} holds no finite number')
    if len(times) < count:
        notes.append(f'{name}: dropped {count_of(count - len(times), "sample")} not finite')

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
    """Return the share of samples with the time of the previous sample and another value."""
    shared = sum(int(np.count_nonzero(~_begins(times, part) & _begins(values, part))) for part in parts(times, values))
    return shared / max(1, len(times))


def at_changes(cleaned: Cleaned) -> Cleaned:
    """Return the first sample of each run of equal values; the function modifies the arrays."""
    times, values = keep(cleaned.times, cleaned.values, lambda part: _begins(cleaned.values, part))
    if len(times) < len(cleaned.times) / 2:
        times, values = times.copy(), values.copy()  # releases the memory of the dropped samples
    return Cleaned(times, values, cleaned.notes)


def keep(
    times: NDArray[np.int64], values: Array, wanted: Callable[[slice], NDArray[np.bool_]]
) -> tuple[NDArray[np.int64], Array]:
    """Move the wanted samples to the front of the arrays and return them; `wanted` selects the samples of a part."""
    end = 0
    for part in parts(times, values):
        is_wanted = wanted(part)
        count = int(np.count_nonzero(is_wanted))
        if end < part.start or count < len(is_wanted):
            times[end : end + count] = times[part][is_wanted]
            values[end : end + count] = values[part][is_wanted]
        end += count
    return times[:end], values[:end]


def _begins(numbers: NDArray[Any], part: slice) -> NDArray[np.bool_]:
    """Return which numbers of a part differ from the previous number."""
    before = numbers[max(part.start - 1, 0) : part.stop]
    differ: NDArray[np.bool_] = before[1:] != before[:-1]
    return differ if part.start else np.append(True, differ)


def _ends(numbers: NDArray[Any], part: slice) -> NDArray[np.bool_]:
    """Return which numbers of a part differ from the next number."""
    after = numbers[part.start : part.stop + 1]
    differ: NDArray[np.bool_] = after[1:] != after[:-1]
    return differ if part.stop < len(numbers) else np.append(differ, True)


def _count_late(times: NDArray[np.int64], name: str) -> int:
    """Return the number of samples that come after a sample with a later time."""
    late = worst = worst_index = 0
    latest = times[0]
    for part in parts(times):
        behind = np.maximum(np.maximum.accumulate(times[part]), latest) - times[part]
        late += int(np.count_nonzero(behind))
        if behind.max() > worst:
            worst, worst_index = int(behind.max()), part.start + int(np.argmax(behind))
        latest = max(latest, times[part].max())
    if worst > MAX_DISORDER * NANOSECONDS and late == len(times) - 1 and late > 1:
        raise InputError(f'{name}: time runs backwards from the first sample to the last: turn the rows round')
    if worst > MAX_DISORDER * NANOSECONDS:
        raise InputError(
            f'{name}: time goes back by {worst / NANOSECONDS:.3f} s at sample {worst_index + 1:,}: '
            'the clock was set back or two recordings are in one; split it there'
        )
    return late


def _sort(times: NDArray[np.int64], values: Array) -> None:
    """Sort samples by time; samples of equal times keep their order."""
    limits = earliest_after([int(times[part].min()) for part in parts(times)])
    waiting_times, waiting_values = times[:0], values[:0]
    end = 0
    for part, limit in zip(parts(times, values), limits):
        merged_times = np.concatenate([waiting_times, times[part]])
        merged_values = np.concatenate([waiting_values, values[part]])
        order = np.argsort(merged_times, kind='stable')
        merged_times, merged_values = merged_times[order], merged_values[order]
        ready = int(np.searchsorted(merged_times, limit, side='right'))
        times[end : end + ready], values[end : end + ready] = merged_times[:ready], merged_values[:ready]
        waiting_times, waiting_values = merged_times[ready:], merged_values[ready:]
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
    """Return quantiles, up to 0.95, of the intervals [ns], with a resolution of the mean / `_RESOLUTION`."""
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
