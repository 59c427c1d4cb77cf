"""Reading an mcap file chunk by chunk: its index tells where in a chunk the messages of a topic are."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from cfd_pneumatic.recording.blocks import Block, gather, join
from cfd_pneumatic.recording.ordering import earliest_after

_RECORD_HEAD = 9
"""Bytes of a record before its content: what it is, and the length of the content."""

_MESSAGE_HEAD = 22
"""Bytes of a message's record before its payload: channel, sequence, times of reception and of publishing."""

_TIME = _RECORD_HEAD + 6
"""Where in a message's record the time of reception is."""

_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
"""What an index tells of a message: when it was received and where its record begins."""


@dataclass(frozen=True)
class ChunkedMcap:
    """
    An mcap file whose chunks and messages are indexed.

    Attributes
    ----------
    path : Path
        The file.
    connections : list of Connection
        Its topics.
    start_time : int
        Time of the first message [ns].
    indexes : list of ChunkIndex
        Where its chunks are, in the order of the file.

    """

    path: Path
    connections: list[Connection]
    start_time: int
    indexes: list[ChunkIndex]

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, Block]]:
        """
        Yield the messages of some topics, for each in the order of reception.

        Where chunks overlap in time, messages wait for those of later chunks that were received before them.
        """
        by_topic: dict[str, list[Connection]] = {}
        for connection in connections:
            by_topic.setdefault(connection.topic, []).append(connection)
        with self.path.open('rb') as stream:
            topics = [_Topic(same, self.indexes) for same in by_topic.values()]
            for index in self.indexes:
                within = [(topic, places) for topic in topics if (places := topic.places(index))]
                content, behind = _read(stream, index) if within else (b'', b'')
                for topic, positions in within:
                    entries = np.concatenate([_entries(behind, position) for position in positions])
                    yield topic.connection, topic.take(_messages(content, entries))


def chunk_indexes(path: Path) -> list[ChunkIndex]:
    """Return where the chunks of a file are, in its order; empty where not every one tells where its messages are."""
    with path.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    indexes = summary.chunk_indexes if summary else []
    complete = all(index.message_index_offsets for index in indexes)
    return sorted(indexes, key=lambda index: index.chunk_start_offset) if complete else []


class _Topic:
    """Brings the messages of a topic, which come a chunk at a time, into the order of reception."""

    def __init__(self, connections: Sequence[Connection], indexes: Sequence[ChunkIndex]) -> None:
        self.connection = connections[0]
        self._channels = [connection.id for connection in connections]
        begins = [index.message_start_time for index in indexes if self.places(index)]
        self._limits = iter(earliest_after(begins))
        self._waiting: list[Block] = []

    def places(self, index: ChunkIndex) -> list[int]:
        """Return where in what follows a chunk the records about its messages are; empty where it holds none."""
        end = index.chunk_start_offset + index.chunk_length
        offsets = index.message_index_offsets
        return [offsets[channel] - end for channel in self._channels if channel in offsets]

    def take(self, block: Block) -> Block:
        """Take the messages of the next chunk, and return all that came before those of later chunks."""
        limit = next(self._limits)
        queue = [*self._waiting, block[np.argsort(block.times, kind='stable')]]
        ready = [int(np.searchsorted(block.times, limit, side='right')) for block in queue]
        self._waiting = [block[count:] for block, count in zip(queue, ready) if count < len(block)]
        return join([block[:count] for block, count in zip(queue, ready) if count] or [block[:0]])


def _read(stream: IO[bytes], index: ChunkIndex) -> tuple[bytes, bytes]:
    """Return what is in a chunk, and what follows it: the records that tell where in it the messages are."""
    stream.seek(index.chunk_start_offset + _RECORD_HEAD)
    content, size = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    stream.seek(index.chunk_start_offset + index.chunk_length)
    return content.read(size), stream.read(index.message_index_length)


def _entries(records: bytes, position: int) -> NDArray[Any]:
    """Return the times and places of a channel's messages, from the record at a position."""
    (size,) = struct.unpack_from('<I', records, position + _RECORD_HEAD + 2)
    return np.frombuffer(records, _ENTRY, size // _ENTRY.itemsize, position + _RECORD_HEAD + 6)


def _messages(content: bytes, entries: NDArray[Any]) -> Block:
    """Return some messages of a chunk, in the order of the file."""
    records = entries['offset'].astype(np.int64)
    order = np.argsort(records, kind='stable')
    records, times = records[order], entries['time'].astype(np.int64)[order]
    sizes = gather(content, '<u8', records + 1).astype(np.int64) - _MESSAGE_HEAD
    starts = records + _RECORD_HEAD + _MESSAGE_HEAD
    right = (gather(content, 'u1', records) == Opcode.MESSAGE) & (gather(content, '<u8', records + _TIME) == times)
    if not (right & (sizes >= 0) & (starts + sizes <= len(content))).all():
        raise ValueError('the index of a chunk does not lead to its messages')
    return Block(times, content, starts, sizes)
