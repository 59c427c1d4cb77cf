# SPDX-License-Identifier: Apache-2.0
"""The last seconds of a device's signals, as a recording."""

from __future__ import annotations

from array import array

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

_COVERED_SHARE = 0.95  # share of the window that a signal must cover
_EXCESS_SHARE = 0.25  # share of the window kept beyond it, so that values are dropped in batches


class RollingSignal:
    """
    Stamps and values of the last seconds of a signal.

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
        """Delete all values."""
        del self._stamps[:], self._values[:]

    def append(self, stamp: int, value: float) -> None:
        """Append a value unless its stamp [ns] is at or before the last stamp."""
        if self._stamps and stamp <= self._stamps[-1]:
            return
        self._stamps.append(stamp)
        self._values.append(value)
        if stamp - self._stamps[0] > (1.0 + _EXCESS_SHARE) * self._length:
            self._drop_before(stamp - self._length)

    def _drop_before(self, before: int) -> None:
        """Drop values older than a stamp [ns], except the value that held at the stamp."""
        first = int(np.searchsorted(np.frombuffer(self._stamps, dtype=np.int64), before, side='right')) - 1
        if first > 0:
            del self._stamps[:first], self._values[:first]

    def between(self, begin: int, end: int, epoch: int) -> Signal:
        """Return the values between two stamps [ns], with times in seconds since an epoch [ns]."""
        stamps = np.array(self._stamps, dtype=np.int64)
        chosen = (stamps >= begin) & (stamps <= end)
        times = (stamps[chosen] - epoch).astype(np.float64) / NANOSECONDS
        return Signal(times, np.array(self._values, dtype=np.float64)[chosen])

    def held_from(self, begin: int, epoch: int) -> Signal | None:
        """Return the changes of a held value from a stamp on [ns]; None if the value is unknown at the stamp."""
        stamps, values = np.array(self._stamps, dtype=np.int64), np.array(self._values, dtype=np.float64)
        first = int(np.searchsorted(stamps, begin, side='right')) - 1
        if first < 0:
            return None
        changes = np.concatenate([[True], np.diff(values[first:]) != 0.0])
        return Signal((np.maximum(stamps[first:], begin)[changes] - epoch) / NANOSECONDS, values[first:][changes])


class Window:
    """
    Signals of a device in the last seconds.

    Parameters
    ----------
    seconds
        Length of the window [s].

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
        """Delete all signals."""
        for signal in (self.displacement, self.force, *self.pressures.values(), *self.setpoints.values()):
            signal.clear()

    def recording(self, begin: int, end: int) -> Recording:
        """
        Return the recording between two stamps [ns].

        A cylinder or a force without values over the whole time is omitted.
        """
        cylinders = {}
        for name, signal in self.pressures.items():
            pressure = signal.between(begin, end, begin)
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
    """Return whether a signal covers nearly the whole time between two stamps [ns]."""
    if len(signal) < 2:
        return False
    covered = float(signal.times[-1] - signal.times[0])
    return covered > _COVERED_SHARE * (end - begin) / NANOSECONDS
