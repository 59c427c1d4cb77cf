# SPDX-License-Identifier: Apache-2.0
"""Reading an mcap file chunk by chunk: its index tells where in a chunk the messages of a topic are."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.summary import Summary
from numpy.typing import NDArray
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

from cfd_pneumatic.errors import DamageError
from cfd_pneumatic.files import open_input
from cfd_pneumatic.messages import FORMATS, NEVER, MessageBlock, Span, earliest_after, gather, join
from cfd_pneumatic.recording.bags.mcap_pieces import ENTRY, HEAD, Piece, find_pieces, summary_of, walk

_MESSAGE_HEAD = HEAD.size + 22
"""Bytes of a message's record before its payload: channel, sequence, times of reception and of publishing."""

_CHANNEL, _TIME = HEAD.size, HEAD.size + 6
"""Where in a message's record the channel and the time of reception are."""


class McapFile:
    """
    An mcap file, whole or damaged.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    connections : list of Connection
        Its topics: as its summary tells, or else those of which something can be read.
    start_time : int
        Time of the first message [ns].
    strays : int
        Messages that belong to no topic.
    left_out : list of Span
        Times of which messages were left out while reading, because they are damaged.

    """

    def __init__(self, path: Path) -> None:
        self.left_out: list[Span] = []
        self._path = path
        with open_input(path) as stream:
            summary = summary_of(stream)
            self._pieces = find_pieces(stream, summary)
            told = None if summary is None else self._told(summary)
            self.connections, self.strays = self._scan(stream) if told is None else (told, 0)
        self.start_time = next((piece.start for piece in self._pieces if piece.start or piece.stop), 0)

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """
        Yield the messages of some topics, for each in the order of reception.

        Where chunks overlap in time, messages wait for those of later chunks that were received before them.
        """
        by_topic: dict[str, list[Connection]] = {}
        for connection in connections:
            by_topic.setdefault(connection.topic, []).append(connection)
        topics = [_Topic(same, self._pieces) for same in by_topic.values()]
        with open_input(self._path) as stream:
            for piece in self._pieces:
                within = [topic for topic in topics if topic.may_be_in(piece)]
                if not within:
                    continue
                try:
                    block, channels = _read(stream, piece)
                except Exception:  # whatever damage makes a decompressor stumble over
                    self.left_out.append((piece.start, piece.stop))
                    block, channels = MessageBlock.from_payloads([], []), np.empty(0, np.int64)
                for topic in within:
                    its = np.isin(channels, topic.channels)
                    yield topic.connection, topic.take(block[np.flatnonzero(its)])

    def _told(self, summary: Summary) -> list[Connection] | None:
        """Return the topics that a summary tells of; None where it leaves something out, as it may."""
        if summary.statistics is None:
            return None
        counts = summary.statistics.channel_message_counts
        total = sum(counts.get(channel, 0) for channel in summary.channels)
        if not total or total != summary.statistics.message_count:
            return None
        schemas = {channel.schema_id for channel in summary.channels.values()} - {0}
        if not schemas <= summary.schemas.keys():
            return None
        return self._connections(summary.channels, summary.schemas, counts)

    def _scan(self, stream: IO[bytes]) -> tuple[list[Connection], int]:
        """Return the topics of which something can be read, and the number of messages of no topic."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        counts: Counter[int] = Counter()
        for piece in self._pieces:
            with suppress(Exception):  # as in reading
                content = piece.content(stream)
                for opcode, begin, end in walk(content):
                    record = ReadDataStream(BytesIO(content[begin + HEAD.size : end]))
                    if opcode == Opcode.SCHEMA:
                        schema = Schema.read(record)
                        schemas[schema.id] = schema
                    elif opcode == Opcode.CHANNEL:
                        channel = Channel.read(record)
                        channels[channel.id] = channel
                _, ids = _messages(content, _walked(content))
                counts.update(ids.tolist())
        found = {number: channel for number, channel in channels.items() if counts[number]}
        connections = self._connections(found, schemas, counts)
        return connections, counts.total() - sum(connection.msgcount for connection in connections)

    def _connections(
        self, channels: Mapping[int, Channel], schemas: Mapping[int, Schema], counts: Mapping[int, int]
    ) -> list[Connection]:
        """Return channels as rosbags has them, with the number of messages of each."""
        definitions = {
            schema.id: MessageDefinition(
                FORMATS.get(schema.encoding, MessageDefinitionFormat.NONE), schema.data.decode(errors='replace')
            )
            for schema in schemas.values()
        }
        return [
            Connection(
                channel.id,
                channel.topic,
                _type_name(schemas[channel.schema_id].name) if channel.schema_id in schemas else '',
                definitions.get(channel.schema_id, MessageDefinition(MessageDefinitionFormat.NONE, '')),
                '',
                counts.get(channel.id, 0),
                ConnectionExtRosbag2(channel.message_encoding, []),
                self,
            )
            for channel in channels.values()
        ]


def _type_name(name: str) -> str:
    """Return the name of a type as ROS 2 has it, also of ROS 1's: package/msg/Name."""
    package, _, own = name.partition('/')
    return f'{package}/msg/{own}' if own and '/' not in own else name


class _Topic:
    """Brings the messages of a topic, which come a piece at a time, into the order of reception."""

    def __init__(self, connections: Sequence[Connection], pieces: Sequence[Piece]) -> None:
        self.connection = connections[0]
        self.channels = np.array([connection.id for connection in connections])
        self._channels = frozenset(self.channels.tolist())
        begins = [
            piece.start if piece.places or piece.stop else NEVER  # a chunk without messages is of time 0
            for piece in pieces
            if self.may_be_in(piece)
        ]
        self._limits = iter(earliest_after(begins))
        self._waiting: list[MessageBlock] = []

    def may_be_in(self, piece: Piece) -> bool:
        """Return whether a piece holds messages of the topic, so far as it is known."""
        return not piece.places or not self._channels.isdisjoint(piece.places)

    def take(self, block: MessageBlock) -> MessageBlock:
        """Take the messages of the next piece, and return all that came before those of later pieces."""
        limit = next(self._limits)
        queue = [*self._waiting, block[np.argsort(block.times, kind='stable')]]
        ready = [int(np.searchsorted(block.times, limit, side='right')) for block in queue]
        self._waiting = [block[count:] for block, count in zip(queue, ready) if count < len(block)]
        return join([block[:count] for block, count in zip(queue, ready) if count] or [block[:0]])


def _read(stream: IO[bytes], piece: Piece) -> tuple[MessageBlock, NDArray[np.int64]]:
    """
    Return the messages of a piece in the order of the file, and their channels.

    The index of a chunk only saves time: where it is not right, and a checksum says that the chunk is, the chunk is
    gone through.
    """
    content = piece.content(stream)
    try:
        if piece.places:
            stream.seek(piece.end)
            return _indexed(content, stream.read(piece.index_end - piece.end), piece)
    except (ValueError, struct.error):
        if not piece.checked:
            raise
    return _messages(content, _walked(content))


def _indexed(content: bytes, index: bytes, piece: Piece) -> tuple[MessageBlock, NDArray[np.int64]]:
    """Return the messages of a chunk, and their channels, where its index says that they are."""
    entries = {channel: _entries(index, place - piece.end) for channel, place in piece.places.items()}
    together = np.concatenate(list(entries.values()))
    order = np.argsort(together['offset'], kind='stable')
    records = together['offset'][order].astype(np.int64)
    if records.size and not 0 <= records[0] <= records[-1] <= len(content) - _MESSAGE_HEAD:
        raise DamageError('the index of a chunk does not lead to its messages')
    block, channels = _messages(content, records)
    right = gather(content, 'u1', records) == Opcode.MESSAGE
    right &= block.times == together['time'][order].astype(np.int64)
    right &= channels == np.repeat(list(entries), [len(some) for some in entries.values()])[order]
    behind, following = np.append(0, block.starts + block.sizes), np.append(records, len(content))
    if not right.all() or (behind > following).any():
        raise DamageError('the index of a chunk does not lead to its messages')
    between = np.flatnonzero(behind < following)
    if any(len(_walked(content[behind[gap] : following[gap]])) for gap in between):
        return _messages(content, _walked(content))  # there are more messages than the index tells of
    return block, channels


def _entries(index: bytes, place: int) -> NDArray[np.void]:
    """Return the times and places of a channel's messages, from the record at a place."""
    (size,) = struct.unpack_from('<I', index, place + HEAD.size + 2)
    return np.frombuffer(index, ENTRY, size // ENTRY.itemsize, place + HEAD.size + 6)


def _walked(content: bytes) -> NDArray[np.int64]:
    """Return where messages begin, by going from record to record."""
    return np.array([begin for opcode, begin, _ in walk(content) if opcode == Opcode.MESSAGE], np.int64)


def _messages(content: bytes, records: NDArray[np.int64]) -> tuple[MessageBlock, NDArray[np.int64]]:
    """Return the messages that begin at some places, and their channels."""
    sizes = gather(content, '<u8', records + 1).astype(np.int64) + (HEAD.size - _MESSAGE_HEAD)
    if (sizes < 0).any():
        raise DamageError('a message is shorter than can be')
    times = gather(content, '<u8', records + _TIME).astype(np.int64)
    channels = gather(content, '<u2', records + _CHANNEL).astype(np.int64)
    return MessageBlock(times, content, records + _MESSAGE_HEAD, sizes), channels
