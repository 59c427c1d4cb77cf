# SPDX-License-Identifier: Apache-2.0
"""Write an mcap file in whole chunks with checksums; NumPy assembles the records."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode

from cfd_pneumatic.messages import FORMATS, MessageBlock, gather, scatter
from cfd_pneumatic.recording.bags.mcap_pieces import CHUNK, ENTRY, HEAD, MAGIC

_HEAD_OF_MESSAGE = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('received', '<u8'),
        ('published', '<u8'),
    ]
)
"""Fields of a message's record before its payload."""

_INDEX = struct.Struct('<BQHI')
"""Fields of a message index before its entries: opcode, length, channel, bytes of the entries."""

_HEAD_LENGTH = 2 + 4 + 8 + 8  # bytes of a message's record between its length and its payload


class McapWriter:
    """
    Writer of a bag's mcap file, with the interface of a storage for rosbags' `Writer`.

    Parameters
    ----------
    path : Path
        Folder of the bag.
    compression : CompressionMode
        Not used: chunks are not compressed.

    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        self.path = path / f'{path.name}.mcap'
        self._stream = self.path.open('xb')
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}
        self._chunks: list[ChunkIndex] = []
        self._announced = b''
        self._write(MAGIC, _bytes(Header(profile='ros2', library='cfd_pneumatic')))

    def add_msgtype(self, connection: Connection) -> None:
        """Add the definition of a message type."""
        encoding = next(name for name, format_ in FORMATS.items() if format_ is connection.msgdef.format)
        definition = connection.msgdef.data.encode()
        schema = Schema(id=len(self._schemas) + 1, name=connection.msgtype, encoding=encoding, data=definition)
        self._schemas[connection.msgtype] = schema
        self._announced += _bytes(schema)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic."""
        channel = Channel(
            id=connection.id,
            schema_id=self._schemas[connection.msgtype].id,
            topic=connection.topic,
            message_encoding='cdr',
            metadata={'offered_qos_profiles': offered_qos_profiles},
        )
        self._channels[channel.id] = channel
        self._counts[channel.id] = 0
        self._announced += _bytes(channel)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write a message as a separate chunk."""
        self.write_chunk([(connection, MessageBlock.from_payloads([timestamp], [bytes(data)]))])

    def write_chunk(self, blocks: Sequence[tuple[Connection, MessageBlock]]) -> None:
        """Write messages of several topics as one chunk, in order of reception."""
        records, indexes = _interleaved(blocks)
        content = self._announced + records
        times = np.concatenate([block.times for _, block in blocks])
        start, stop = int(times.min()), int(times.max())
        begin = self._stream.tell()
        size = len(content)
        head = CHUNK.pack(start, stop, size, zlib.crc32(content), 0) + struct.pack('<Q', size)
        self._write(HEAD.pack(Opcode.CHUNK, len(head) + size), head, content)
        end = self._stream.tell()
        offsets = {}
        for channel, entries in indexes.items():
            entries['offset'] += len(self._announced)
            offsets[channel] = self._stream.tell()
            head = _INDEX.pack(Opcode.MESSAGE_INDEX, 2 + 4 + entries.nbytes, channel, entries.nbytes)
            self._write(head, entries.tobytes())
            self._counts[channel] += entries.size
        self._announced = b''
        self._chunks.append(
            ChunkIndex(
                chunk_length=end - begin,
                chunk_start_offset=begin,
                compression='',
                compressed_size=size,
                message_end_time=stop,
                message_index_length=self._stream.tell() - end,
                message_index_offsets=offsets,
                message_start_time=start,
                uncompressed_size=size,
            )
        )

    def close(self, version: int, metadata: str) -> None:
        """Write the metadata and the summary with the indexes, and close the file."""
        if self._announced:
            self._write(self._announced)  # topics without messages
        begin = self._stream.tell()
        bag_metadata = Metadata(name='rosbag2', metadata={'serialized_metadata': metadata})
        self._write(_bytes(bag_metadata))
        length = self._stream.tell() - begin
        self._write(_bytes(DataEnd(data_section_crc=self._crc)))
        summary_start = self._stream.tell()
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=1,
            schema_count=len(self._schemas),
        )
        index = MetadataIndex(offset=begin, length=length, name='rosbag2')
        records = [*self._schemas.values(), *self._channels.values(), statistics, *self._chunks, index]
        summary = b''.join(map(_bytes, records))
        footer = struct.pack('<BQQQ', Opcode.FOOTER, 8 + 8 + 4, summary_start, 0)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        end = Footer(summary_start=summary_start, summary_offset_start=0, summary_crc=crc)
        self._write(summary, _bytes(end), MAGIC)
        self._stream.close()

    def abort(self) -> None:
        """Close the file without completing it."""
        self._stream.close()

    def _write(self, *parts: bytes) -> None:
        for part in parts:
            self._stream.write(part)
            self._crc = zlib.crc32(part, self._crc)


def _interleaved(blocks: Sequence[tuple[Connection, MessageBlock]]) -> tuple[bytes, dict[int, NDArray[np.void]]]:
    """Return the records of messages, the earliest first, and by channel an index of each record's position."""
    order = np.argsort(np.concatenate([block.times for _, block in blocks]), kind='stable')
    sizes = (_HEAD_OF_MESSAGE.itemsize + np.concatenate([block.sizes for _, block in blocks]))[order]
    places = np.empty_like(sizes)
    places[order] = np.cumsum(sizes) - sizes
    content = bytearray(int(sizes.sum()))
    indexes, first = {}, 0
    for connection, block in blocks:
        index = np.empty(len(block), ENTRY)
        index['time'], index['offset'] = block.times, places[first : first + len(block)]
        for size in np.unique(block.sizes).tolist():
            has_size = block.sizes == size
            payloads = gather(block.data, f'V{size}', block.starts[has_size])
            records = _records(connection.id, block.times[has_size], payloads)
            scatter(records, content, index['offset'][has_size])
        indexes[connection.id], first = index, first + len(block)
    return bytes(content), indexes


def _records(channel: int, times: NDArray[np.int64], payloads: NDArray[np.void]) -> NDArray[np.void]:
    """Return the records of messages of equal size."""
    records = np.empty(times.size, [('head', _HEAD_OF_MESSAGE), ('payload', payloads.dtype)])
    head = records['head']
    head['opcode'], head['length'] = Opcode.MESSAGE, _HEAD_LENGTH + payloads.dtype.itemsize
    head['channel'], head['sequence'] = channel, 0
    head['received'] = head['published'] = times
    records['payload'] = payloads
    return records


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
