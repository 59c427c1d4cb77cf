# SPDX-License-Identifier: Apache-2.0
"""Places of the messages in an mcap file, whole or damaged: in chunks and outside of chunks."""

from __future__ import annotations

import os
import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, Footer
from mcap.summary import Summary

from cfd_pneumatic.errors import DamageError
from cfd_pneumatic.files import open_input
from cfd_pneumatic.recording.bags.compression import most_unpacked, unpacked

MAGIC = b'\x89MCAP0\r\n'

HEAD = struct.Struct('<BQ')
"""Head of a record: opcode, and length of the content."""

CHUNK = struct.Struct('<QQQII')
"""Begin of a chunk's content: first and last time, unpacked size and checksum, length of the compression's name."""

ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
"""Entry of an index for a message: time of reception, and position of the record."""

_MESSAGE = struct.Struct('<HIQ')
"""Begin of a message's content: channel, sequence, time of reception."""

_DATA_END = struct.Struct('<BQI')
"""Record after all data: opcode, length, and checksum of all preceding bytes."""

_FOOTER = HEAD.size + 20 + len(MAGIC)
"""Length of the footer and the final magic [bytes]."""

_BEGINNING = 128
"""Bytes of a record's beginning that are sufficient to classify the record."""

_RESERVED = range(0x10, 0x80)
"""Opcodes without a record; opcodes from 0x80 on are private extensions."""

_RUN = 2**20
"""Largest run of records outside of chunks [bytes]."""


@dataclass
class Piece:
    """
    A piece of an mcap file: a chunk, a run of records outside of chunks, or a damaged span.

    Attributes
    ----------
    begin, end : int
        Position in the file [bytes].
    start, stop : int
        Times of the first and last message [ns]; 0 if not known.
    chunk : bool
        Whether the piece is a chunk.
    checked : bool
        Whether the piece has a checksum.
    damaged : bool
        Whether the piece is unusable.
    index_end : int
        End of the index records that follow a chunk.
    places : dict
        Position of each channel's index record, by channel; empty if the channels are not known.

    """

    begin: int
    end: int
    start: int = 0
    stop: int = 0
    chunk: bool = False
    checked: bool = False
    damaged: bool = False
    index_end: int = 0
    places: dict[int, int] = field(default_factory=dict)

    def content(self, stream: IO[bytes]) -> bytes:
        """
        Return the records of the piece.

        Raises
        ------
        Exception
            If the records are damaged: a DamageError for a wrong size or checksum, or any error of a decompressor.

        """
        if self.damaged:
            raise DamageError('is damaged')
        stream.seek(self.begin)
        if not self.chunk:
            return stream.read(self.end - self.begin)
        stream.seek(HEAD.size, os.SEEK_CUR)
        chunk = Chunk.read(ReadDataStream(stream))
        content = _unpacked(chunk)
        if len(content) != chunk.uncompressed_size:
            raise DamageError('has a wrong size')
        if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
            raise DamageError('has a wrong checksum')
        return content


def _unpacked(chunk: Chunk) -> bytes:
    """Return the unpacked content of a chunk, at most one byte more than its declared size."""
    packed, size = chunk.data, chunk.uncompressed_size
    if size > most_unpacked(len(packed)):
        raise DamageError('declares an impossible size')
    if chunk.compression == 'zstd' and zstandard.frame_content_size(packed) not in (-1, size):
        raise DamageError('has a wrong size')
    return unpacked(packed, chunk.compression, size + 1)


def flaw(file: Path) -> str | None:
    """Return a description of damage to the beginning or the end of a file; None if both are sound."""
    with open_input(file) as stream:
        return _flaw(stream)


def _flaw(stream: IO[bytes]) -> str | None:
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        return f'is damaged (it {"does not begin as an mcap file does" if size else "is empty"})'
    stream.seek(max(0, size - _FOOTER))
    end = stream.read()
    if not end.endswith(MAGIC):
        return 'is cut off'
    footer, end_of_summary = _footer(end), size - len(MAGIC) - 4
    if footer.summary_start > end_of_summary:
        return 'is damaged (its summary begins behind its end)'
    checked = footer.summary_start and footer.summary_crc
    if checked and _checksum(stream, footer.summary_start, end_of_summary) != footer.summary_crc:
        return 'is damaged (the checksum of its summary is wrong)'
    return None


def summary_of(stream: IO[bytes]) -> Summary | None:
    """Return the summary of a file; None if the summary is missing or damaged."""
    with suppress(Exception):  # the reader raises exceptions of any type for damaged files
        if _flaw(stream) is None:
            stream.seek(0)
            return make_reader(stream).get_summary()
    return None


def walk(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode, the begin and the end of each record."""
    begin = 0
    while begin < len(content):
        opcode, end = _record(content[begin : begin + HEAD.size], begin, len(content))
        yield opcode, begin, end
        begin = end


def find_pieces(stream: IO[bytes], summary: Summary | None) -> list[Piece]:
    """
    Return the pieces of a file in the order of the file.

    After a record with a damaged length, the search continues at the next chunk of the summary. Without a sound summary
    the following records are lost.
    """
    size = stream.seek(0, os.SEEK_END)
    known: dict[int, ChunkIndex] = {}
    if summary is not None:
        stream.seek(-_FOOTER, os.SEEK_END)
        size = _footer(stream.read()).summary_start or size
        known = {index.chunk_start_offset: index for index in summary.chunk_indexes}
    collector = _PieceCollector(stream, known)
    collector.collect(size)
    return collector.pieces


class _PieceCollector:
    """Collector of the pieces of a file; the positions of its chunks may be known from a summary."""

    def __init__(self, stream: IO[bytes], known: Mapping[int, ChunkIndex]) -> None:
        self.pieces: list[Piece] = []
        self._stream = stream
        self._known = known
        self._indexed: Piece | None = None  # the chunk to which the next index records belong
        self._data_end = 0

    def collect(self, size: int) -> None:
        """Collect the pieces in the first bytes of the file, `size` in number."""
        barriers = [*sorted(self._known), size]
        position = len(MAGIC)
        while position < size and not self._data_end:
            barrier = barriers[bisect_right(barriers, position)]
            self._stream.seek(position)
            try:
                position = self._add_record(position, self._stream.read(_BEGINNING), barrier)
            except (ValueError, struct.error):
                self._add_damaged(position, barrier)
                position = barrier
        if self._indexed is not None and not self._data_end:
            self._indexed.places.clear()  # the file may be cut off among the chunk's index records
        self._reject_unchecked(self._data_end or size - _DATA_END.size)

    def _add_record(self, begin: int, head: bytes, barrier: int) -> int:
        """Add a record to the pieces, and return its end."""
        opcode, end = _record(head, begin, barrier)
        if opcode == Opcode.CHUNK:
            self._indexed = self._chunk(begin, end, head)
            self._add(self._indexed)
        elif begin in self._known:
            raise DamageError('is not a chunk')
        elif opcode == Opcode.MESSAGE_INDEX:
            self._index(begin, end, head)
        elif opcode in _RESERVED:
            self._add_damaged(begin, end)
        else:
            self._indexed = None
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            self._extend(begin, end, _MESSAGE.unpack_from(head, HEAD.size)[2] if opcode == Opcode.MESSAGE else 0)
        elif opcode == Opcode.DATA_END and end - begin == _DATA_END.size:
            self._data_end = begin
        return end

    def _chunk(self, begin: int, end: int, head: bytes) -> Piece:
        start, stop, _, crc, length = CHUNK.unpack_from(head, HEAD.size)
        before = HEAD.size + CHUNK.size + length
        (size,) = struct.unpack_from('<Q', head, before)
        if before + 8 + size != end - begin:
            raise DamageError('has lengths that contradict each other')
        if begin in self._known:
            start, stop = self._known[begin].message_start_time, self._known[begin].message_end_time
        return Piece(begin, end, start, stop, chunk=True, checked=crc != 0, index_end=end)

    def _index(self, begin: int, end: int, head: bytes) -> None:
        (channel,) = struct.unpack_from('<H', head, HEAD.size)
        if self._indexed is None or channel in self._indexed.places:
            self._add_damaged(begin, end)  # the record's chunk was not recognised
        else:
            self._indexed.places[channel] = begin
            self._indexed.index_end = end

    def _extend(self, begin: int, end: int, time: int) -> None:
        """Add a record to the preceding run of records."""
        run = self.pieces[-1] if self.pieces else None
        if run is None or run.chunk or run.damaged or run.end != begin or end - run.begin > _RUN:
            run = Piece(begin, begin, time, time)
            self._add(run)
        run.end = end
        if time:
            run.start = min(run.start or time, time)
            run.stop = max(run.stop, time)

    def _add(self, piece: Piece) -> None:
        if self.pieces and self.pieces[-1].damaged:
            self.pieces[-1].stop = self.pieces[-1].stop or piece.start
        self.pieces.append(piece)

    def _add_damaged(self, begin: int, end: int) -> None:
        """Add a damaged piece; with a summary, only if the piece is a chunk of the summary."""
        if self._indexed is not None:
            self._indexed.places.clear()
            self._indexed = None
        if begin in self._known:
            index = self._known[begin]
            self._add(Piece(begin, end, index.message_start_time, index.message_end_time, damaged=True))
        elif not self._known and not (self.pieces and self.pieces[-1].damaged):
            self._add(Piece(begin, end, self.pieces[-1].stop if self.pieces else 0, damaged=True))

    def _reject_unchecked(self, end: int) -> None:
        """
        Mark pieces without a checksum as damaged if the checksum of all data is wrong.

        If chunks have checksums and a piece is damaged, messages outside of chunks are marked, too: they may belong to
        a chunk with a damaged head.
        """
        unchecked = [piece for piece in self.pieces if not piece.checked]
        if len(unchecked) < len(self.pieces) and any(piece.damaged for piece in unchecked):
            for piece in unchecked:
                piece.damaged |= not piece.chunk and piece.stop > 0
        self._stream.seek(max(0, end))
        record = self._stream.read(_DATA_END.size)
        if not unchecked or len(record) < _DATA_END.size:
            return
        opcode, length, crc = _DATA_END.unpack(record)
        if (opcode, length) == (Opcode.DATA_END, 4) and crc and _checksum(self._stream, 0, end) != crc:
            for piece in unchecked:
                piece.damaged = True


def _record(head: bytes, begin: int, barrier: int) -> tuple[int, int]:
    """Return the opcode and the end of a record."""
    opcode, length = HEAD.unpack_from(head)
    end = begin + HEAD.size + length
    if not opcode or end > barrier:
        raise DamageError('has an impossible length')
    return opcode, end


def _footer(end: bytes) -> Footer:
    footer: Footer = Footer.read(ReadDataStream(BytesIO(end[HEAD.size :])))
    return footer


def _checksum(stream: IO[bytes], begin: int, end: int) -> int:
    """Return the checksum of a span of a file."""
    stream.seek(begin)
    checksum = 0
    while begin < end and (part := stream.read(min(_RUN, end - begin))):
        checksum = zlib.crc32(part, checksum)
        begin += len(part)
    return checksum
