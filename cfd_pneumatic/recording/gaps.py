# SPDX-License-Identifier: Apache-2.0
"""Recordings of a logger that paused: what lies between two gaps is a recording of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cfd_pneumatic.recording.signals import Recording
from cfd_pneumatic.recording.wording import counted

LONGEST = 0.5
"""Time in which the piston may have done anything [s]: a model that goes on over it has forgotten where it was."""

_TIMES = 10.0  # the usual interval
_SHORTEST = 1.0  # a piece that tells something [s]


def pieces(recording: Recording) -> list[Recording]:
    """
    Return what lies between the gaps of a recording's displacement, each a recording of its own.

    A recording without gaps, or of a piston that rests, is itself. Pieces shorter than a second are left out.
    """
    if recording.rests:
        return [recording]
    times = recording.displacement.times
    intervals = np.diff(times)
    if not intervals.size:
        return [recording]
    gaps = np.flatnonzero(intervals > max(LONGEST, _TIMES * float(np.median(intervals))))
    if not gaps.size:
        return [recording]
    begins, ends = [0, *(gaps + 1).tolist()], [*gaps.tolist(), len(times) - 1]
    found = [
        replace(
            recording.between(float(times[begin]), float(np.nextafter(times[end], np.inf))),
            name=f'{recording.name} from {float(times[begin]):.4g} s' if begin else recording.name,
        )
        for begin, end in zip(begins, ends)
        if times[end] - times[begin] >= _SHORTEST
    ]
    if not found:
        return [recording]
    longest = float(np.max(intervals[gaps]))
    what = f'{counted(len(gaps), "gap")} of up to {longest:.3g} s'
    note = f'{what}: the model starts anew behind each, and what lies between is a recording of its own'
    return [replace(found[0], health=(*recording.health, note)), *(replace(one, health=()) for one in found[1:])]
