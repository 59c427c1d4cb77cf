# SPDX-License-Identifier: Apache-2.0
"""Split recordings at the gaps in which a logger paused or repeated its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.recording.message_texts import count_of
from cfd_pneumatic.recording.recording import Recording
from cfd_pneumatic.recording.signals import Signal

SHORTEST, LONGEST = 0.2, 0.5
"""
Longest interval that is never a gap, and shortest interval that is always a gap [s].

After 0.2 s the model has forgotten the position of the piston. Between the limits, 40 missing samples are a gap:
measured runs at 100 Hz that lack 30 are simulated better in one piece, since each piece has an offset and a drift.
"""

_SOME, _MANY = 10.0, 40.0  # times the usual interval
_SHORTEST_PIECE = 1.0  # shorter pieces are left out [s]
_LEAPS = 5.0  # times the 99 % quantile of the changes between samples


def split_at_gaps(recording: Recording) -> list[Recording]:
    """
    Split a recording at the gaps of its displacement into separate recordings.

    A recording without gaps, or of a piston at rest, stays whole. Pieces shorter than a second are left out. A time in
    which a logger repeats the samples of all signals counts as a gap. Force samples in a gap of a pressure are dropped.
    """
    if recording.rests:
        return [recording]
    recording = _without_force_in_gaps(_without_repeated_rows(recording))
    times = recording.displacement.times
    intervals, gaps = np.diff(times), _gaps_of(times)
    if not gaps.size:
        return [recording]
    begins, ends = [0, *(gaps + 1).tolist()], [*gaps.tolist(), len(times) - 1]
    pieces = [
        replace(
            recording.between(float(times[begin]), float(np.nextafter(times[end], np.inf))),
            name=f'{recording.name} from {float(times[begin]):.4g} s' if begin else recording.name,
        )
        for begin, end in zip(begins, ends)
        if times[end] - times[begin] >= _SHORTEST_PIECE
    ]
    if not pieces:
        return [recording]
    longest = float(np.max(intervals[gaps]))
    gaps_text = f'{count_of(len(gaps), "gap")} of up to {longest:.3g} s'
    note = f'{gaps_text}: the parts between the gaps are used as separate recordings'
    return [replace(pieces[0], health=(*recording.health, note)), *(replace(piece, health=()) for piece in pieces[1:])]


def _gaps_of(times: Array) -> NDArray[np.intp]:
    """Return the indices of the samples that are followed by a gap."""
    intervals = np.diff(times)
    if not intervals.size:
        return np.empty(0, np.intp)
    usual = float(np.median(intervals))
    return np.flatnonzero(intervals > max(SHORTEST, min(_MANY * usual, max(LONGEST, _SOME * usual))))


def _without_repeated_rows(recording: Recording) -> Recording:
    """Return a recording without times in which all signals are constant and a signal leaps afterwards."""
    signals = [signal for role, _, signal in recording.signals() if role in ('displacement', 'pressure', 'force')]
    values, times = recording.displacement.values, recording.displacement.times
    begins = np.flatnonzero(np.append(True, np.diff(values) != 0.0))
    ends = np.append(begins[1:], len(values)) - 1
    long = times[ends] - times[begins] > SHORTEST
    repeated = [
        (float(begin), float(end))
        for begin, end in zip(times[begins[long]], times[ends[long]])
        if all(_is_constant(signal, begin, end) for signal in signals)
        and any(_leaps_behind(signal, end) for signal in signals)
    ]
    if not repeated:
        return recording
    note = f'{count_of(len(repeated), "time")} all signals repeat their last sample: left out as gaps'
    return replace(_without(recording, repeated), health=(*recording.health, note))


def _is_constant(signal: Signal, begin: float, end: float) -> bool:
    first, last = np.searchsorted(signal.times, [begin, end], side='right').tolist()
    return bool(last - first > 1 and np.ptp(signal.values[first:last]) == 0.0)


def _leaps_behind(signal: Signal, time: float) -> bool:
    index = int(np.searchsorted(signal.times, time, side='right'))
    steps = np.abs(np.diff(signal.values))
    return bool(0 < index < len(signal) and steps[index - 1] > _LEAPS * np.percentile(steps, 99.0))


def _without_force_in_gaps(recording: Recording) -> Recording:
    """Return a recording without force samples in gaps of a pressure: the force is computed from the pressures."""
    if recording.force is None:
        return recording
    gaps = [
        (float(times[index]), float(times[index + 1]))
        for times in (cylinder.pressure.times for cylinder in recording.cylinders.values())
        for index in _gaps_of(times)
    ]
    return replace(recording, force=_outside(recording.force, gaps)) if gaps else recording


def _without(recording: Recording, spans: Sequence[tuple[float, float]]) -> Recording:
    cylinders = {
        name: replace(signals, pressure=_outside(signals.pressure, spans))
        for name, signals in recording.cylinders.items()
    }
    force = None if recording.force is None else _outside(recording.force, spans)
    return replace(recording, displacement=_outside(recording.displacement, spans), cylinders=cylinders, force=force)


def _outside(signal: Signal, spans: Sequence[tuple[float, float]]) -> Signal:
    """Return the samples outside of given spans of time; a span excludes its begin."""
    kept = np.ones(len(signal), bool)
    for begin, end in spans:
        first, last = np.searchsorted(signal.times, [begin, end], side='right').tolist()
        kept[first:last] = False
    return replace(signal, times=signal.times[kept], values=signal.values[kept])
