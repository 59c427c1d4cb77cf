"""Reading an mcap file chunk by chunk: its index tells where in a chunk the messages of a topic are."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from cfd_pneumatic.recording.blocks import Block, join
from cfd_pneumatic.recording.ordering import earliest_after

_RECORD_HEAD = 9
"""Bytes of a record before its content: what it is, and the length of the content."""

_MESSAGE = np.dtype(
    [('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'), ('log', '<u8'), ('publish', '<u8')]
)
"""What a message's record begins with."""

_INDEX_HEAD = np.dtype([('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('bytes', '<u4')])
_INDEX_ENTRY = np.dtype([('log', '<u8'), ('offset', '<u8')])


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
                within = [topic for topic in topics if topic.is_in(index)]
                data = _content(stream, index) if within else b''
                for topic in within:
                    messages = _messages(data, _offsets(stream, index, topic.channels), topic.channels)
                    yield topic.connection, topic.take(messages)


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
        self.channels = {connection.id for connection in connections}
        begins = [index.message_start_time for index in indexes if self.is_in(index)]
        self._limits = iter(earliest_after(begins))
        self._waiting: list[Block] = []

    def is_in(self, index: ChunkIndex) -> bool:
        """Return whether a chunk holds messages of the topic."""
        return not self.channels.isdisjoint(index.message_index_offsets)

    def take(self, block: Block) -> Block:
        """Take the messages of the next chunk, and return all that came before those of later chunks."""
        limit = next(self._limits)
        queue = [*self._waiting, block[np.argsort(block.times, kind='stable')]]
        ready = [int(np.searchsorted(block.times, limit, side='right')) for block in queue]
        self._waiting = [block[count:] for block, count in zip(queue, ready) if count < len(block)]
        return join([block[:count] for block, count in zip(queue, ready) if count] or [block[:0]])


def _content(stream: IO[bytes], index: ChunkIndex) -> bytes:
    """Return the records of a chunk."""
    stream.seek(index.chunk_start_offset + _RECORD_HEAD)
    records, size = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    return records.read(size)


def _offsets(stream: IO[bytes], index: ChunkIndex, channels: set[int]) -> NDArray[np.int64]:
    """Return where in a chunk the records of some channels' messages are, in the order of the file."""
    offsets = []
    for channel in channels.intersection(index.message_index_offsets):
        stream.seek(index.message_index_offsets[channel])
        head = np.frombuffer(stream.read(_INDEX_HEAD.itemsize), _INDEX_HEAD)[0]
        entries = np.frombuffer(stream.read(int(head['bytes'])), _INDEX_ENTRY)
        offsets.append(entries['offset'].astype(np.int64))
    return np.sort(np.concatenate(offsets))


def _messages(data: bytes, offsets: NDArray[np.int64], channels: set[int]) -> Block:
    """Return the messages whose records are at some offsets of a chunk."""
    heads = np.ndarray(len(data) - _MESSAGE.itemsize + 1, _MESSAGE, data, strides=(1,))[offsets]
    starts = offsets + _MESSAGE.itemsize
    sizes = heads['length'].astype(np.int64) - (_MESSAGE.itemsize - _RECORD_HEAD)
    right = (heads['opcode'] == Opcode.MESSAGE) & np.isin(heads['channel'], list(channels))
    if not (right & (sizes >= 0) & (starts + sizes <= len(data))).all():
        raise ValueError('the index of a chunk does not lead to its messages')
    return Block(heads['log'].astype(np.int64), data, starts, sizes)
