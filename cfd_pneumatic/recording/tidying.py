"""Making signals of samples as they come: out of order, twice, with gaps, not a number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.messages import NANOSECONDS
from cfd_pneumatic.recording.wording import counted

MAX_DISORDER = 1.0
"""Time [s] by which a sample may come late; more means that the clock was set back."""

GAP = 5.0
"""An interval of so many usual ones is a gap."""

JITTER = 0.1
"""Spread of the intervals, as a part of the usual one, from which on it is mentioned."""


@dataclass(frozen=True)
class Tidied:
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
    values: NDArray[np.float64]
    notes: tuple[str, ...]


def tidy(times: NDArray[np.int64], values: NDArray[np.float64], name: str, *, held: bool = False) -> Tidied:
    """
    Return samples sorted, each time once, finite.

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
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f'{name} holds no finite number')
    if not finite.all():
        notes.append(f'{name}: dropped {counted(int(np.count_nonzero(~finite)), "sample")} not finite')
        times, values = times[finite], values[finite]

    behind = np.maximum.accumulate(times) - times
    late = int(np.count_nonzero(behind))
    if late:
        worst = int(np.argmax(behind))
        if behind[worst] > MAX_DISORDER * NANOSECONDS:
            raise InputError(
                f'{name}: time goes back by {behind[worst] / NANOSECONDS:.3f} s at sample {worst + 1:,}: '
                'the clock was set back or two recordings are in one; split it there'
            )
        notes.append(f'{name}: sorted {counted(late, "sample")} out of order')
        order = np.argsort(times, kind='stable')
        times, values = times[order], values[order]

    new = np.diff(times) > 0
    keep = np.append(new, True) if held else np.append(True, new)
    if not keep.all():
        kept = 'last' if held else 'first'
        notes.append(
            f'{name}: {counted(int(np.count_nonzero(~keep)), "sample")} at the time of another, kept the {kept}'
        )
        times, values = times[keep], values[keep]

    if not held:
        notes += _describe_intervals(np.diff(times) / NANOSECONDS, name)
    return Tidied(times, values, tuple(notes))


def changes(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the samples that begin a new value, the first included."""
    return np.flatnonzero(np.append(True, values[1:] != values[:-1]))


def _describe_intervals(intervals: NDArray[np.float64], name: str) -> list[str]:
    if len(intervals) < 2:
        return []
    usual = float(np.median(intervals))
    gaps = intervals[intervals > GAP * usual]
    low, high = np.percentile(intervals, [5, 95])
    notes = []
    if high - low > JITTER * usual:
        notes.append(f'{name}: intervals of {1e3 * low:.4g} to {1e3 * high:.4g} ms about {1e3 * usual:.4g} ms')
    if gaps.size:
        notes.append(f'{name}: {counted(gaps.size, "gap")}, the longest {gaps.max():.4g} s')
    return notes
