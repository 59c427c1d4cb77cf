# SPDX-License-Identifier: Apache-2.0
"""Taking in the messages of one channel, a block at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import Decoder, FieldPath, MessageBlock
from cfd_pneumatic.recording.memory_maps import allocate, give_back
from cfd_pneumatic.recording.message_texts import count_of, listed
from cfd_pneumatic.recording.sources import SignalSource

MOST_LAGS = 16_384
"""Of a longer recording every second, fourth, ... lag is kept, so that no more than these are."""


_MOST_NAMES = 20
_STRAY = 1e15  # eleven days, by which a time of reception that cannot be differs from others [ns]
_FEW = 0.1  # share of the messages
_STRETCHES = 20  # of the lags, whose medians a line is laid through


@dataclass(frozen=True)
class ReceptionClock:
    """
    How the clock of reception lies to that of the stamps.

    Attributes
    ----------
    lag : int
        Median time from stamp to reception [ns].
    begin : int
        Time of reception from which the rate counts [ns].
    begins_with : float
        Lag then, on the line through the lags [ns].
    rate : float
        By which the lag grows [-]: 0 where both clocks run alike.
    drift : float
        By which it grows over all messages [ns].
    scatter : float
        Between the lags that a twentieth of all messages exceed and fall below, off the line [ns].

    """

    lag: int
    begin: int
    begins_with: float
    rate: float
    drift: float
    scatter: float

    def lag_at(self, received: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the lags of messages by their times of reception [ns], which follow a line."""
        lags: NDArray[np.int64] = np.rint(self.begins_with + self.rate * (received - self.begin)).astype(np.int64)
        return lags


@dataclass(frozen=True)
class Content:
    """
    What the messages of a channel hold.

    Attributes
    ----------
    channel : SignalSource
        The channel.
    times : (n,) array of int
        The stamps [ns], or times of reception where there is none.
    raw : (n,) array
        Numbers as recorded.
    unstamped : list of slice or array of int
        Which samples have no stamp.
    clock : ReceptionClock or None
        How the times of reception lie to the stamps, None without stamps.
    notes : tuple of str
        What was amiss.

    """

    channel: SignalSource
    times: NDArray[np.int64]
    raw: Array
    unstamped: list[slice | NDArray[np.intp]]
    clock: ReceptionClock | None
    notes: tuple[str, ...]


class Intake:
    """
    Takes in the messages of a channel's topic.

    Parameters
    ----------
    channel : SignalSource
        The channel.
    decoder : Decoder
        Finds the numbers in the messages.
    path : FieldPath
        Where they are, for messages.
    count : int
        Number of messages to come, so far as it is known.
    folder : Path or None
        Folder to keep the samples in; None for memory.

    """

    def __init__(
        self, channel: SignalSource, decoder: Decoder, path: FieldPath, count: int, folder: Path | None
    ) -> None:
        self.channel = channel
        self._decoder = decoder
        self._path = path
        self._folder = folder
        self._times = allocate(count, np.int64, folder)
        self._raw = allocate(count, np.float64, folder)
        self._count = 0
        self._missing = 0
        self._unstamped: list[slice | NDArray[np.intp]] = []
        self._lags = _Lags()
        self._names: list[str] = []
        self._first_lag: float | None = None
        self._stamped = self._strays = 0

    def add(self, block: MessageBlock) -> None:
        """Take in messages."""
        if not len(block):
            return
        try:
            columns = self._decoder.decode(block)
            self._names = self._names or self._decoder.names(block.payload(0))
        except InputError as error:
            raise InputError(f'topic {self.channel.source}: {error}') from error
        found = columns.has_number
        received, stamps, values = block.times[found], columns.stamps[found], columns.values[found]
        stamped = stamps != 0
        self._missing += len(block) - len(values)
        self._lags.add((received - stamps)[stamped], received[stamped])
        self._note_strays(received, stamps, stamped)
        if not stamped.all():
            self._unstamped.append(
                self._count + np.flatnonzero(~stamped)
                if stamped.any()
                else slice(self._count, self._count + len(values))
            )
        self._append(np.where(stamped, stamps, received), values)

    def content(self) -> Content:
        """
        Return what was taken in.

        Raises
        ------
        InputError
            If there were no messages, or none has the number.

        """
        channel = self.channel
        if not self._count:
            if not self._missing:
                raise InputError(f'topic {channel.source}, the {channel.name}, has no messages')
            names = listed(self._names, _MOST_NAMES).replace('“', '?').replace('”', '?')
            there = f'; the names are “{names}”' if self._names else ''
            raise InputError(f'no message on topic {channel.source} has {self._wanted}{there}')
        notes = []
        if self._missing:
            notes.append(f'{channel.name}: {count_of(self._missing, "message")} without {self._wanted}')
        times, raw = self._times[: self._count], self._raw[: self._count]
        strays = self._strays_number()
        if strays and not self._unstamped:
            notes.append(
                f'{channel.name}: {count_of(strays, "message")} received at a time that cannot be: placed by the stamps'
            )
            order = np.argsort(times, kind='stable')
            times, raw = times[order], raw[order]
        return Content(channel, times, raw, self._unstamped, self._lags.clock(), tuple(notes))

    def _note_strays(self, received: NDArray[np.int64], stamps: NDArray[np.int64], stamped: NDArray[np.bool_]) -> None:
        """Count messages whose time of reception is far from the stamp otherwise than that of the first one."""
        if not stamped.any():
            return
        lags = received[stamped].astype(float) - stamps[stamped].astype(float)
        if self._first_lag is None:
            self._first_lag = float(lags[0])
        self._stamped += len(lags)
        self._strays += int(np.count_nonzero(np.abs(lags - self._first_lag) > _STRAY))

    def _strays_number(self) -> int:
        """Return how many times of reception are not to be believed, if few are: a log that wraps round leaves some."""
        strays = min(self._strays, self._stamped - self._strays)
        return strays if strays < _FEW * self._stamped else 0

    @property
    def _wanted(self) -> str:
        """What every message is to have; what a mapping says is not quoted."""
        return str(self._path) if self.channel.field is None else 'the field that the mapping gives'

    def _append(self, times: NDArray[np.int64], values: Array) -> None:
        end = self._count + len(times)
        if end > len(self._times):
            self._grow(2 * end)
        self._times[self._count : end] = times
        self._raw[self._count : end] = values
        give_back(self._times, self._raw)
        self._count = end

    def _grow(self, count: int) -> None:
        """Make room for more messages than were announced."""
        times, raw = self._times[: self._count], self._raw[: self._count]
        self._times = allocate(count, np.int64, self._folder)
        self._raw = allocate(count, np.float64, self._folder)
        self._times[: self._count], self._raw[: self._count] = times, raw


class _Lags:
    """Times from stamp to reception [ns], and of reception, of all messages or of some that are spread evenly."""

    def __init__(self) -> None:
        self._kept = np.empty((2, 0), np.int64)
        self._seen = 0
        self._every = 1

    def add(self, lags: NDArray[np.int64], received: NDArray[np.int64]) -> None:
        """Take in the lags of further messages, and when these were received."""
        some = slice(-self._seen % self._every, None, self._every)
        self._kept = np.concatenate([self._kept, np.stack([lags[some], received[some]])], axis=1)
        self._seen += len(lags)
        while self._kept.shape[1] > MOST_LAGS:
            self._kept = self._kept[:, ::2]
            self._every *= 2

    def clock(self) -> ReceptionClock | None:
        """Return how reception lies to the stamps, None of nothing."""
        lags, received = self._kept
        if not lags.size:
            return None
        middle = lags.size // 2
        lag = int(np.partition(lags, middle)[middle])
        near = np.abs(lags.astype(float) - lag) < _STRAY
        lags, received = lags[near], received[near]
        begin = int(received.min())
        stretches = min(_STRETCHES, lags.size)
        points = [
            (float(np.median(since)), float(np.median(own)))
            for since, own in zip(np.array_split(received - begin, stretches), np.array_split(lags - lag, stretches))
        ]
        times, medians = np.array(points).T
        if np.ptp(times) == 0.0:
            return ReceptionClock(lag, begin, float(lag), 0.0, 0.0, _scatter(lags))
        rate, start = np.polyfit(times, medians, 1)
        off = float(np.max(np.abs(medians - start - rate * times)))
        drift = float(rate * np.ptp(received))
        if off > 0.1 * abs(drift):  # no line: something jumps, or a network is slow now and then
            return ReceptionClock(lag, begin, float(lag), 0.0, 0.0, _scatter(lags))
        scatter = _scatter(lags - rate * (received - begin))
        return ReceptionClock(lag, begin, float(lag + start), float(rate), drift, scatter)


def _scatter(lags: Array | NDArray[np.int64]) -> float:
    low, high = np.percentile(lags, (5.0, 95.0))
    return float(high - low)
