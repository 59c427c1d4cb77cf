# SPDX-License-Identifier: Apache-2.0
"""Taking in the messages of one channel, a block at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.blocks import MessageBlock
from cfd_pneumatic.recording.bags.decoding import Decoder
from cfd_pneumatic.recording.bags.fields import FieldPath
from cfd_pneumatic.recording.memory_maps import allocate, give_back
from cfd_pneumatic.recording.sources import SignalSource
from cfd_pneumatic.recording.wording import counted, listed

MOST_LAGS = 16_384
"""Of a longer recording every second, fourth, ... lag is kept, so that no more than these are."""


_MOST_NAMES = 20


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
    lag : int or None
        Median time from stamp to reception [ns], None without stamps.
    notes : tuple of str
        What was amiss.

    """

    channel: SignalSource
    times: NDArray[np.int64]
    raw: Array
    unstamped: list[slice | NDArray[np.intp]]
    lag: int | None
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

    def add(self, block: MessageBlock) -> None:
        """Take in messages."""
        if not len(block):
            return
        try:
            columns = self._decoder.decode(block)
            self._names = self._names or self._decoder.names(block.payload(0))
        except InputError as error:
            raise InputError(f'topic {self.channel.source}: {error}') from error
        found = columns.found
        received, stamps, values = block.times[found], columns.stamps[found], columns.values[found]
        stamped = stamps != 0
        self._missing += len(block) - len(values)
        self._lags.add((received - stamps)[stamped])
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
            notes.append(f'{channel.name}: {counted(self._missing, "message")} without {self._wanted}')
        return Content(
            channel,
            self._times[: self._count],
            self._raw[: self._count],
            self._unstamped,
            self._lags.median(),
            tuple(notes),
        )

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
    """Times from stamp to reception [ns], of all messages or of some that are spread evenly."""

    def __init__(self) -> None:
        self._kept = np.empty(0, np.int64)
        self._seen = 0
        self._every = 1

    def add(self, lags: NDArray[np.int64]) -> None:
        """Take in the lags of further messages."""
        self._kept = np.concatenate([self._kept, lags[-self._seen % self._every :: self._every]])
        self._seen += len(lags)
        while len(self._kept) > MOST_LAGS:
            self._kept = self._kept[::2]
            self._every *= 2

    def median(self) -> int | None:
        """Return the median, None of nothing."""
        kept = self._kept
        return int(kept[0]) + int(np.median(kept - kept[0])) if kept.size else None
