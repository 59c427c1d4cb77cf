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
"""First and last time [ns]; 0 if a time is not known."""

MESSAGES_PER_BLOCK = 16_384
"""Number of messages, of all topics, in one block."""

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
        Memory that contains the payloads, perhaps among other bytes.
    starts, sizes : (n,) array of int
        Position in `data` at which each payload begins, and its number of bytes.

    """

    times: NDArray[np.int64]
    data: bytes
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    @classmethod
    def from_payloads(cls, times: Sequence[int] | NDArray[np.int64], payloads: Sequence[bytes]) -> MessageBlock:
        """Return a block of separate messages."""
        sizes = np.fromiter(map(len, payloads), np.int64, len(payloads))
        return cls(np.array(times, np.int64), b''.join(payloads), np.cumsum(sizes) - sizes, sizes)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.times)

    def __getitem__(self, indices: slice | NDArray[np.intp]) -> MessageBlock:
        """Return a selection of the messages, in the same memory."""
        return MessageBlock(self.times[indices], self.data, self.starts[indices], self.sizes[indices])

    def payload(self, index: int) -> bytes:
        """Return the payload of a message."""
        start = int(self.starts[index])
        return self.data[start : start + int(self.sizes[index])]


def join(blocks: Sequence[MessageBlock]) -> MessageBlock:
    """Return the messages of several blocks in order of reception; equal times keep the order of the blocks."""
    if len(blocks) == 1:
        return blocks[0]
    times = np.concatenate([block.times for block in blocks])
    shifts = np.cumsum([0, *(len(block.data) for block in blocks[:-1])])
    starts = np.concatenate([block.starts + shift for block, shift in zip(blocks, shifts)])
    sizes = np.concatenate([block.sizes for block in blocks])
    joined = MessageBlock(times, b''.join([block.data for block in blocks]), starts, sizes)
    return joined[np.argsort(times, kind='stable')]


def gather(data: bytes, dtype: str, places: NDArray[np.int64]) -> NDArray[Any]:
    """Return the items of a type at given places of a piece of memory."""
    kind = np.dtype(dtype)
    if not len(places):
        return np.empty(0, kind)  # the memory may be shorter than an item
    everywhere: NDArray[Any] = np.ndarray(len(data) - kind.itemsize + 1, kind, data, strides=(1,))
    return everywhere[places]


def scatter(items: NDArray[Any], data: bytearray, places: NDArray[np.int64]) -> None:
    """Write items to given places of a piece of memory."""
    kind = np.dtype(f'V{items.dtype.itemsize}')
    if len(places):
        everywhere: NDArray[Any] = np.ndarray(len(data) - kind.itemsize + 1, kind, data, strides=(1,))
        everywhere[places] = items.view(kind)


class MessageReader(Protocol):
    """Reader that yields single messages of a file: those of rosbags, and ours for damaged files."""

    @property
    def connections(self) -> list[Connection]:
        """The topics."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of given topics: topic, time of reception [ns], payload."""


@dataclass(frozen=True)
class GroupingReader:
    """
    Reader that groups the single messages of a file into blocks.

    Attributes
    ----------
    source : MessageReader
        Reader of the single messages.
    start_time : int
        Time of the first message [ns].
    left_out : list of Span
        Times of messages that were left out; not known for single messages.
    strays : int
        Number of messages that belong to no topic.

    """

    source: MessageReader
    start_time: int
    left_out: list[Span] = field(default_factory=list)
    strays: int = 0

    @property
    def connections(self) -> list[Connection]:
        """The topics."""
        return self.source.connections

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """Yield the messages of given topics."""
        for owners, block in group_messages(self.source.messages(connections)):
            yield from split_by_topic(block, np.array([owner.id for owner in owners]), connections)


def group_messages(messages: Iterable[tuple[Owner, int, bytes]]) -> Iterator[tuple[list[Owner], MessageBlock]]:
    """Group single messages (owner, time of reception, payload) into blocks; yield each with its messages' owners."""
    owners: list[Owner] = []
    times: list[int] = []
    payloads: list[bytes] = []
    for owner, time, payload in messages:
        owners.append(owner)
        times.append(time)
        payloads.append(payload)
        if len(times) == MESSAGES_PER_BLOCK:
            yield owners, MessageBlock.from_payloads(times, payloads)
            owners, times, payloads = [], [], []
    if owners:
        yield owners, MessageBlock.from_payloads(times, payloads)


def split_by_topic(
    block: MessageBlock, ids: NDArray[np.int64], connections: Collection[Connection]
) -> Iterator[tuple[Connection, MessageBlock]]:
    """Split a block of several connections by topic; connections may share a topic."""
    topics: dict[str, list[Connection]] = {}
    for connection in connections:
        topics.setdefault(connection.topic, []).append(connection)
    for same_topic in topics.values():
        yield same_topic[0], block[np.flatnonzero(np.isin(ids, [connection.id for connection in same_topic]))]


def earliest_after(begins: Sequence[int]) -> list[int]:
    """Return for each piece the earliest time [ns] in all later pieces; `begins` has each piece's earliest time."""
    earliest = np.minimum.accumulate([*begins, NEVER][::-1])[::-1]
    return [int(time) for time in earliest[1:]]
