# SPDX-License-Identifier: Apache-2.0
"""Collect the samples of a channel from blocks of messages."""

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
"""Largest number of lags in memory; of more lags only every second, fourth, ... is kept."""


_MOST_NAMES = 20
_STRAY = 1e15  # eleven days: lag that only an impossible time of reception has [ns]
_FEW = 0.1  # share of the messages
_STRETCHES = 20  # parts of the lags; a line is fitted through their medians


@dataclass(frozen=True)
class ReceptionClock:
    """
    Relation of the clock of reception to the clock of the stamps.

    Attributes
    ----------
    lag : int
        Median time from stamp to reception [ns].
    begin : int
        Time of the first reception [ns].
    begins_with : float
        Lag at `begin` on the fitted line [ns].
    rate : float
        Growth rate of the lag [-]: 0 for clocks of equal rates.
    drift : float
        Growth of the lag over all messages [ns].
    scatter : float
        Range between the 5 % and 95 % quantiles of the lags about the line [ns].

    """

    lag: int
    begin: int
    begins_with: float
    rate: float
    drift: float
    scatter: float

    def lag_at(self, received: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the lags on the fitted line at times of reception [ns]."""
        lags: NDArray[np.int64] = np.rint(self.begins_with + self.rate * (received - self.begin)).astype(np.int64)
        return lags


@dataclass(frozen=True)
class Content:
    """
    Samples of a channel, with notes on defects.

    Attributes
    ----------
    channel : SignalSource
        The channel.
    times : (n,) array of int
        Stamps, or times of reception for messages without a stamp [ns].
    raw : (n,) array
        Numbers as recorded.
    unstamped : list of slice or array of int
        Indices of the samples without a stamp.
    clock : ReceptionClock or None
        Relation of the times of reception to the stamps; None without stamps.
    notes : tuple of str
        Defects of the messages.

    """

    channel: SignalSource
    times: NDArray[np.int64]
    raw: Array
    unstamped: list[slice | NDArray[np.intp]]
    clock: ReceptionClock | None
    notes: tuple[str, ...]


class Intake:
    """
    Collector of a channel's samples.

    Parameters
    ----------
    channel : SignalSource
        The channel.
    decoder : Decoder
        Decoder of the messages.
    path : FieldPath
        Path of the numbers, for errors and notes.
    count : int
        Expected number of messages.
    folder : Path or None
        Folder for the samples; None for memory.

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
        """Add the samples of a block of messages."""
        if not len(block):
            return
        try:
            columns = self._decoder.decode(block)
            self._names = self._names or self._decoder.names(block.payload(0))
        except InputError as error:
            raise InputError(f'topic {self.channel.source}: {error}') from error
        usable = columns.has_number
        received, stamps, values = block.times[usable], columns.stamps[usable], columns.values[usable]
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
        Return the collected samples.

        Raises
        ------
        InputError
            If there were no messages, or no message has the number.

        """
        channel = self.channel
        if not self._count:
            if not self._missing:
                raise InputError(f'topic {channel.source}, the {channel.name}, has no messages')
            names = listed(self._names, _MOST_NAMES).replace('“', '?').replace('”', '?')
            alternatives = f'; the names are “{names}”' if self._names else ''
            raise InputError(f'no message on topic {channel.source} has {self._wanted}{alternatives}')
        notes = []
        if self._missing:
            notes.append(f'{channel.name}: {count_of(self._missing, "message")} without {self._wanted}')
        times, raw = self._times[: self._count], self._raw[: self._count]
        strays = self._count_strays()
        if strays and not self._unstamped:
            notes.append(
                f'{channel.name}: {count_of(strays, "message")} with an impossible time of reception: '
                'ordered by the stamps'
            )
            order = np.argsort(times, kind='stable')
            times, raw = times[order], raw[order]
        return Content(channel, times, raw, self._unstamped, self._lags.clock(), tuple(notes))

    def _note_strays(self, received: NDArray[np.int64], stamps: NDArray[np.int64], stamped: NDArray[np.bool_]) -> None:
        """Count messages with a lag that differs by eleven days or more from the lag of the first message."""
        if not stamped.any():
            return
        lags = received[stamped].astype(float) - stamps[stamped].astype(float)
        if self._first_lag is None:
            self._first_lag = float(lags[0])
        self._stamped += len(lags)
        self._strays += int(np.count_nonzero(np.abs(lags - self._first_lag) > _STRAY))

    def _count_strays(self) -> int:
        """Return the number of impossible times of reception if there are few, as in a log that wraps round."""
        strays = min(self._strays, self._stamped - self._strays)
        return strays if strays < _FEW * self._stamped else 0

    @property
    def _wanted(self) -> str:
        """Description of the wanted field; a field of a mapping is not quoted, since it may be secret."""
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
        """Make room for more messages than expected."""
        times, raw = self._times[: self._count], self._raw[: self._count]
        self._times = allocate(count, np.int64, self._folder)
        self._raw = allocate(count, np.float64, self._folder)
        self._times[: self._count], self._raw[: self._count] = times, raw


class _Lags:
    """Lags from stamp to reception [ns] and times of reception [ns], of all messages or of an even selection."""

    def __init__(self) -> None:
        self._kept = np.empty((2, 0), np.int64)
        self._seen = 0
        self._every = 1

    def add(self, lags: NDArray[np.int64], received: NDArray[np.int64]) -> None:
        """Add the lags and the times of reception of further messages."""
        selected = slice(-self._seen % self._every, None, self._every)
        self._kept = np.concatenate([self._kept, np.stack([lags[selected], received[selected]])], axis=1)
        self._seen += len(lags)
        while self._kept.shape[1] > MOST_LAGS:
            self._kept = self._kept[:, ::2]
            self._every *= 2

    def clock(self) -> ReceptionClock | None:
        """Return the relation of the clock of reception to the stamps; None without messages."""
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
            (float(np.median(since_begin)), float(np.median(lags_of_stretch)))
            for since_begin, lags_of_stretch in zip(
                np.array_split(received - begin, stretches), np.array_split(lags - lag, stretches)
            )
        ]
        times, medians = np.array(points).T
        if np.ptp(times) == 0.0:
            return ReceptionClock(lag, begin, float(lag), 0.0, 0.0, _scatter(lags))
        rate, start = np.polyfit(times, medians, 1)
        off = float(np.max(np.abs(medians - start - rate * times)))
        drift = float(rate * np.ptp(received))
        if off > 0.1 * abs(drift):  # not a line: a clock jumps, or the network is slow at times
            return ReceptionClock(lag, begin, float(lag), 0.0, 0.0, _scatter(lags))
        scatter = _scatter(lags - rate * (received - begin))
        return ReceptionClock(lag, begin, float(lag + start), float(rate), drift, scatter)


def _scatter(lags: Array | NDArray[np.int64]) -> float:
    low, high = np.percentile(lags, (5.0, 95.0))
    return float(high - low)
