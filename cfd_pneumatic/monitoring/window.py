# SPDX-License-Identifier: Apache-2.0
"""The last seconds of a device's signals, as a recording."""

from __future__ import annotations

from array import array

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

_WHOLE = 0.95  # share of the window that a signal has to cover
_SLACK = 0.25  # of what is kept beyond the window


class RollingSignal:
    """
    Stamps and values of a signal, those of the last seconds.

    Parameters
    ----------
    length
        How long values are kept [ns].

    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._stamps = array('q')
        self._values = array('d')

    def __len__(self) -> int:
        """Return the number of values."""
        return len(self._stamps)

    @property
    def begin(self) -> int:
        """Stamp of the first value, or 0 [ns]."""
        return self._stamps[0] if self._stamps else 0

    def clear(self) -> None:
        """Forget them."""
        del self._stamps[:], self._values[:]

    def take(self, stamp: int, value: float) -> None:
        """Add a value; one whose stamp [ns] is not behind the last is left out."""
        if self._stamps and stamp <= self._stamps[-1]:
            return
        self._stamps.append(stamp)
        self._values.append(value)
        if stamp - self._stamps[0] > (1.0 + _SLACK) * self._length:
            self._drop(stamp - self._length)

    def _drop(self, before: int) -> None:
        """Drop what is older than a stamp [ns], but for the value that held then."""
        first = int(np.searchsorted(np.frombuffer(self._stamps, dtype=np.int64), before, side='right')) - 1
        if first > 0:
            del self._stamps[:first], self._values[:first]

    def between(self, begin: int, end: int, epoch: int) -> Signal:
        """Return the values from a stamp to another [ns], in seconds since an epoch [ns]."""
        stamps = np.array(self._stamps, dtype=np.int64)
        chosen = (stamps >= begin) & (stamps <= end)
        times = (stamps[chosen] - epoch).astype(np.float64) / NANOSECONDS
        return Signal(times, np.array(self._values, dtype=np.float64)[chosen])

    def held_from(self, begin: int, epoch: int) -> Signal | None:
        """Return values that hold until the next, from a stamp on [ns]; None where none is known there."""
        stamps, values = np.array(self._stamps, dtype=np.int64), np.array(self._values, dtype=np.float64)
        held = int(np.searchsorted(stamps, begin, side='right')) - 1
        if held < 0:
            return None
        changes = np.concatenate([[True], np.diff(values[held:]) != 0.0])
        return Signal((np.maximum(stamps[held:], begin)[changes] - epoch) / NANOSECONDS, values[held:][changes])


class Window:
    """
    What was heard of a device in the last seconds.

    Parameters
    ----------
    seconds
        How long it reaches back [s].

    """

    def __init__(self, seconds: float) -> None:
        length = round(seconds * NANOSECONDS)
        self.length = length
        self.displacement = RollingSignal(length)
        self.pressures = {name: RollingSignal(length) for name in CYLINDERS}
        self.setpoints = {name: RollingSignal(length) for name in CYLINDERS}
        self.force = RollingSignal(length)

    @property
    def begin(self) -> int:
        """Stamp of the first sample, or 0 [ns]."""
        return self.displacement.begin

    def clear(self) -> None:
        """Forget all of it."""
        for track in (self.displacement, self.force, *self.pressures.values(), *self.setpoints.values()):
            track.clear()

    def recording(self, begin: int, end: int) -> Recording:
        """
        Return what was heard from a stamp to another [ns].

        A cylinder or force that was not heard all the time is left out.
        """
        cylinders = {}
        for name, track in self.pressures.items():
            pressure = track.between(begin, end, begin)
            if _covers(pressure, begin, end):
                cylinders[name] = CylinderSignals(pressure, self.setpoints[name].held_from(begin, begin))
        force = self.force.between(begin, end, begin)
        return Recording(
            name='the last seconds',
            epoch=begin,
            displacement=self.displacement.between(begin, end, begin),
            cylinders=cylinders,
            force=force if _covers(force, begin, end) else None,
            health=(),
        )


def _covers(signal: Signal, begin: int, end: int) -> bool:
    """Return whether a signal was heard from a stamp to another [ns], about."""
    if len(signal) < 2:
        return False
    covered = float(signal.times[-1] - signal.times[0])
    return covered > _WHOLE * (end - begin) / NANOSECONDS
