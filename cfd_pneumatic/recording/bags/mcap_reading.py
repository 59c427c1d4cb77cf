# SPDX-License-Identifier: Apache-2.0
"""Read an mcap file chunk by chunk; its index has the places of a topic's messages in a chunk."""

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
"""Positions of the channel and of the time of reception in a message's record."""


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
        Topics according to the summary; without a summary, the topics with readable messages.
    start_time : int
        Time of the first message [ns].
    strays : int
        Number of messages that belong to no topic.
    left_out : list of Span
        Times of damaged messages that were left out.

    """

    def __init__(self, path: Path) -> None:
        self.left_out: list[Span] = []
        self._path = path
        with open_input(path) as stream:
            summary = summary_of(stream)
            self._pieces = find_pieces(stream, summary)
            connections = None if summary is None else self._summarised_topics(summary)
            self.connections, self.strays = self._scan(stream) if connections is None else (connections, 0)
        self.start_time = next((piece.start for piece in self._pieces if piece.start or piece.stop), 0)

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """
        Yield the messages of given topics; each topic's messages come in order of reception.

        If chunks overlap in time, messages wait for earlier messages in later chunks.
        """
        by_topic: dict[str, list[Connection]] = {}
        for connection in connections:
            by_topic.setdefault(connection.topic, []).append(connection)
        topics = [_TopicSorter(same_topic, self._pieces) for same_topic in by_topic.values()]
        with open_input(self._path) as stream:
            for piece in self._pieces:
                possible = [topic for topic in topics if topic.may_be_in(piece)]
                if not possible:
                    continue
                try:
                    block, channels = _read(stream, piece)
                except Exception:  # decompressors raise exceptions of any type for damaged chunks
                    self.left_out.append((piece.start, piece.stop))
                    block, channels = MessageBlock.from_payloads([], []), np.empty(0, np.int64)
                for topic in possible:
                    is_of_topic = np.isin(channels, topic.channels)
                    yield topic.connection, topic.add(block[np.flatnonzero(is_of_topic)])

    def _summarised_topics(self, summary: Summary) -> list[Connection] | None:
        """Return the topics of a summary; None if the summary is incomplete, which the format allows."""
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
        """Return the topics with readable messages, and the number of messages that belong to no topic."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        counts: Counter[int] = Counter()
        for piece in self._pieces:
            with suppress(Exception):  # `blocks` reports damaged pieces
                content = piece.content(stream)
                for opcode, begin, end in walk(content):
                    record = ReadDataStream(BytesIO(content[begin + HEAD.size : end]))
                    if opcode == Opcode.SCHEMA:
                        schema = Schema.read(record)
                        schemas[schema.id] = schema
                    elif opcode == Opcode.CHANNEL:
                        channel = Channel.read(record)
                        channels[channel.id] = channel
                _, ids = _messages(content, _find_messages(content))
                counts.update(ids.tolist())
        with_messages = {number: channel for number, channel in channels.items() if counts[number]}
        connections = self._connections(with_messages, schemas, counts)
        return connections, counts.total() - sum(connection.msgcount for connection in connections)

    def _connections(
        self, channels: Mapping[int, Channel], schemas: Mapping[int, Schema], counts: Mapping[int, int]
    ) -> list[Connection]:
        """Return channels as connections of rosbags, with the number of messages of each."""
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
    """Return the name of a type of ROS 1 or ROS 2 in the notation of ROS 2: package/msg/Name."""
    package, _, type_name = name.partition('/')
    return f'{package}/msg/{type_name}' if type_name and '/' not in type_name else name


class _TopicSorter:
    """Sorter of a topic's messages, which come piece by piece, by their times of reception."""

    def __init__(self, connections: Sequence[Connection], pieces: Sequence[Piece]) -> None:
        self.connection = connections[0]
        self.channels = np.array([connection.id for connection in connections])
        self._channels = frozenset(self.channels.tolist())
        begins = [
            piece.start if piece.places or piece.stop else NEVER  # a chunk without messages has time 0
            for piece in pieces
            if self.may_be_in(piece)
        ]
        self._limits = iter(earliest_after(begins))
        self._waiting: list[MessageBlock] = []

    def may_be_in(self, piece: Piece) -> bool:
        """Return whether a piece may hold messages of the topic."""
        return not piece.places or not self._channels.isdisjoint(piece.places)

    def add(self, block: MessageBlock) -> MessageBlock:
        """Add the messages of the next piece; return all messages that are earlier than those of later pieces."""
        limit = next(self._limits)
        queue = [*self._waiting, block[np.argsort(block.times, kind='stable')]]
        ready = [int(np.searchsorted(block.times, limit, side='right')) for block in queue]
        self._waiting = [block[count:] for block, count in zip(queue, ready) if count < len(block)]
        return join([block[:count] for block, count in zip(queue, ready) if count] or [block[:0]])


def _read(stream: IO[bytes], piece: Piece) -> tuple[MessageBlock, NDArray[np.int64]]:
    """
    Return the messages of a piece in the order of the file, and their channels.

    The index of a chunk only saves time. If the index is wrong but the chunk has a checksum, the function walks
    through the chunk's records.
    """
    content = piece.content(stream)
    try:
        if piece.places:
            stream.seek(piece.end)
            return _indexed(content, stream.read(piece.index_end - piece.end), piece)
    except (ValueError, struct.error):
        if not piece.checked:
            raise
    return _messages(content, _find_messages(content))


def _indexed(content: bytes, index: bytes, piece: Piece) -> tuple[MessageBlock, NDArray[np.int64]]:
    """Return the messages at the places in a chunk's index, and their channels."""
    entries = {channel: _entries(index, place - piece.end) for channel, place in piece.places.items()}
    all_entries = np.concatenate(list(entries.values()))
    order = np.argsort(all_entries['offset'], kind='stable')
    records = all_entries['offset'][order].astype(np.int64)
    if records.size and not 0 <= records[0] <= records[-1] <= len(content) - _MESSAGE_HEAD:
        raise DamageError('the index of a chunk does not lead to its messages')
    block, channels = _messages(content, records)
    is_right = gather(content, 'u1', records) == Opcode.MESSAGE
    is_right &= block.times == all_entries['time'][order].astype(np.int64)
    is_right &= channels == np.repeat(list(entries), [len(rows) for rows in entries.values()])[order]
    ends, next_begins = np.append(0, block.starts + block.sizes), np.append(records, len(content))
    if not is_right.all() or (ends > next_begins).any():
        raise DamageError('the index of a chunk does not lead to its messages')
    gaps = np.flatnonzero(ends < next_begins)
    if any(len(_find_messages(content[ends[gap] : next_begins[gap]])) for gap in gaps):
        return _messages(content, _find_messages(content))  # the index lacks some messages
    return block, channels


def _entries(index: bytes, place: int) -> NDArray[np.void]:
    """Return the times and offsets of a channel's messages, from the index record at a place."""
    (size,) = struct.unpack_from('<I', index, place + HEAD.size + 2)
    return np.frombuffer(index, ENTRY, size // ENTRY.itemsize, place + HEAD.size + 6)


def _find_messages(content: bytes) -> NDArray[np.int64]:
    """Return the positions of message records, found by walking from record to record."""
    return np.array([begin for opcode, begin, _ in walk(content) if opcode == Opcode.MESSAGE], np.int64)


def _messages(content: bytes, records: NDArray[np.int64]) -> tuple[MessageBlock, NDArray[np.int64]]:
    """Return the messages whose records begin at given positions, and their channels."""
    sizes = gather(content, '<u8', records + 1).astype(np.int64) + (HEAD.size - _MESSAGE_HEAD)
    if (sizes < 0).any():
        raise DamageError('a message is shorter than possible')
    times = gather(content, '<u8', records + _TIME).astype(np.int64)
    channels = gather(content, '<u2', records + _CHANNEL).astype(np.int64)
    return MessageBlock(times, content, records + _MESSAGE_HEAD, sizes), channels
