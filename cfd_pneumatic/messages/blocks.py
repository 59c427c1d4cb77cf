# SPDX-License-Identifier: Apache-2.0
"""Blocks: many messages of a topic as one piece of memory, so that they can be decoded together."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection

Owner = TypeVar('Owner')

Span = tuple[int, int]
"""From when to when [ns]; 0 where it's not known."""

TOGETHER = 16_384
"""Messages of all topics that are put together."""

NEVER = 2**63 - 1
"""Later than any time [ns]."""


@dataclass(frozen=True)
class MessageBlock:
    """
    Messages of one topic, in order of reception.

    Attributes
    ----------
    times : (n,) array of int
        Times of reception [ns].
    data : bytes
        What their payloads are in; there may be more in it.
    starts, sizes : (n,) array of int
        Where in `data` each payload begins and how many bytes it has.

    """

    times: NDArray[np.int64]
    data: bytes
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    @classmethod
    def of(cls, times: Sequence[int] | NDArray[np.int64], payloads: Sequence[bytes]) -> MessageBlock:
        """Return messages that were one by one."""
        sizes = np.fromiter(map(len, payloads), np.int64, len(payloads))
        return cls(np.array(times, np.int64), b''.join(payloads), np.cumsum(sizes) - sizes, sizes)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.times)

    def __getitem__(self, which: slice | NDArray[np.intp]) -> MessageBlock:
        """Return some of the messages, in the same memory."""
        return MessageBlock(self.times[which], self.data, self.starts[which], self.sizes[which])

    def payload(self, index: int) -> bytes:
        """Return one message's payload."""
        start = int(self.starts[index])
        return self.data[start : start + int(self.sizes[index])]


def join(blocks: Sequence[MessageBlock]) -> MessageBlock:
    """Return the messages of several blocks in the order of reception, equal times in the order given."""
    if len(blocks) == 1:
        return blocks[0]
    times = np.concatenate([block.times for block in blocks])
    shifts = np.cumsum([0, *(len(block.data) for block in blocks[:-1])])
    starts = np.concatenate([block.starts + shift for block, shift in zip(blocks, shifts)])
    sizes = np.concatenate([block.sizes for block in blocks])
    whole = MessageBlock(times, b''.join([block.data for block in blocks]), starts, sizes)
    return whole[np.argsort(times, kind='stable')]


def gather(data: bytes, dtype: str, places: NDArray[np.int64]) -> NDArray[Any]:
    """Return what is at some places of a piece of memory."""
    kind = np.dtype(dtype)
    if not len(places):
        return np.empty(0, kind)  # the memory may be shorter than what is looked for
    everywhere: NDArray[Any] = np.ndarray(len(data) - kind.itemsize + 1, kind, data, strides=(1,))
    return everywhere[places]


def scatter(items: NDArray[Any], data: bytearray, places: NDArray[np.int64]) -> None:
    """Put items at some places of a piece of memory."""
    kind = np.dtype(f'V{items.dtype.itemsize}')
    if len(places):
        everywhere: NDArray[Any] = np.ndarray(len(data) - kind.itemsize + 1, kind, data, strides=(1,))
        everywhere[places] = items.view(kind)


class Messages(Protocol):
    """What gives the messages of a file one by one: rosbags' readers and ours for damaged files."""

    @property
    def connections(self) -> list[Connection]:
        """The topics."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some topics: topic, time of reception [ns], payload."""


@dataclass(frozen=True)
class OneByOne:
    """
    A file whose messages come one by one.

    Attributes
    ----------
    source : Messages
        What they come from.
    start_time : int
        Time of the first message [ns].
    left_out : list of Span
        Times of which messages were left out; it isn't known here.
    strays : int
        Messages that belong to no topic.

    """

    source: Messages
    start_time: int
    left_out: list[Span] = field(default_factory=list)
    strays: int = 0

    @property
    def connections(self) -> list[Connection]:
        """The topics."""
        return self.source.connections

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """Yield the messages of some topics."""
        for owners, block in put_together(self.source.messages(connections)):
            yield from by_topic(block, np.array([owner.id for owner in owners]), connections)


def put_together(messages: Iterable[tuple[Owner, int, bytes]]) -> Iterator[tuple[list[Owner], MessageBlock]]:
    """Yield messages that come one by one, each with what says whose it is, its time of reception and its payload."""
    owners: list[Owner] = []
    times: list[int] = []
    payloads: list[bytes] = []
    for owner, time, payload in messages:
        owners.append(owner)
        times.append(time)
        payloads.append(payload)
        if len(times) == TOGETHER:
            yield owners, MessageBlock.of(times, payloads)
            owners, times, payloads = [], [], []
    if owners:
        yield owners, MessageBlock.of(times, payloads)


def by_topic(
    block: MessageBlock, ids: NDArray[np.int64], connections: Collection[Connection]
) -> Iterator[tuple[Connection, MessageBlock]]:
    """Part a block whose messages are on several connections; some of these may have one topic."""
    topics: dict[str, list[Connection]] = {}
    for connection in connections:
        topics.setdefault(connection.topic, []).append(connection)
    for same in topics.values():
        yield same[0], block[np.flatnonzero(np.isin(ids, [connection.id for connection in same]))]


def earliest_after(begins: Sequence[int]) -> list[int]:
    """Return for each piece the earliest time [ns] in all later pieces, whose own earliest times are given."""
    earliest = np.minimum.accumulate([*begins, NEVER][::-1])[::-1]
    return [int(time) for time in earliest[1:]]
