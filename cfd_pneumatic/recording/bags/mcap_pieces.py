# SPDX-License-Identifier: Apache-2.0
"""Where in an mcap file its messages are, whatever is left of the file: in chunks, and outside of them."""

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
"""What a record is, and the length of its content."""

CHUNK = struct.Struct('<QQQII')
"""What a chunk's content begins with: first and last time, size and checksum unpacked, length of the next word."""

ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
"""What an index tells of a message: when it was received and where its record begins."""

_MESSAGE = struct.Struct('<HIQ')
"""What a message's content begins with: channel, sequence, time of reception."""

_DATA_END = struct.Struct('<BQI')
"""The record behind all data: what it is, its length, and the checksum of everything before."""

_FOOTER = HEAD.size + 20 + len(MAGIC)
"""Bytes with which a file ends."""

_BEGINNING = 128
"""Bytes of a record that tell all that has to be known of it."""

_RESERVED = range(0x10, 0x80)
"""No records are these; from 0x80 on they are somebody's own."""

_RUN = 2**20
"""Bytes of records outside of chunks that are read together."""


@dataclass
class Piece:
    """
    A chunk, a run of records outside of chunks, or something that is too damaged to say.

    Attributes
    ----------
    begin, end : int
        Where in the file it is.
    start, stop : int
        Times of its first and last message [ns], so far as they are known, else 0.
    chunk : bool
        Whether it is a chunk.
    checked : bool
        Whether it has a checksum of its own.
    damaged : bool
        Whether nothing of it is to be used.
    index_end : int
        Where the records end that follow a chunk and say where in it the messages of a channel are.
    places : dict
        By channel, where these records begin; empty where it's not known what channels there are.

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
        Return the records in it.

        Raises
        ------
        DamageError, or whatever else damage makes a decompressor raise
            If they are not what was written, so far as a checksum or the size can tell.

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
            raise DamageError('does not have the size that it should have')
        if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
            raise DamageError('does not have the checksum that it should have')
        return content


def _unpacked(chunk: Chunk) -> bytes:
    """Return what a chunk holds, a byte more than it declares at most."""
    packed, size = chunk.data, chunk.uncompressed_size
    if size > most_unpacked(len(packed)):
        raise DamageError('declares more than it can hold')
    if chunk.compression == 'zstd' and zstandard.frame_content_size(packed) not in (-1, size):
        raise DamageError('does not have the size that it should have')
    return unpacked(packed, chunk.compression, size + 1)


def flaw(file: Path) -> str | None:
    """Return what is wrong with the beginning and the end of a file, None if nothing is."""
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
    """Return the summary of a file, None where there is no sound one."""
    with suppress(Exception):  # whatever damage makes its reader stumble over
        if _flaw(stream) is None:
            stream.seek(0)
            return make_reader(stream).get_summary()
    return None


def walk(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield what each record is, and where it begins and ends."""
    begin = 0
    while begin < len(content):
        opcode, end = _record(content[begin : begin + HEAD.size], begin, len(content))
        yield opcode, begin, end
        begin = end


def find_pieces(stream: IO[bytes], summary: Summary | None) -> list[Piece]:
    """
    Return the pieces of a file, in its order.

    Where the length of a record is damaged it goes on with the next chunk that the summary knows of. Without a sound
    summary all that follows is lost.
    """
    size = stream.seek(0, os.SEEK_END)
    known: dict[int, ChunkIndex] = {}
    if summary is not None:
        stream.seek(-_FOOTER, os.SEEK_END)
        size = _footer(stream.read()).summary_start or size
        known = {index.chunk_start_offset: index for index in summary.chunk_indexes}
    walk = _Walk(stream, known)
    walk.along(size)
    return walk.pieces


class _Walk:
    """Goes along the records of a file, of which some chunks may be known, and collects its pieces."""

    def __init__(self, stream: IO[bytes], known: Mapping[int, ChunkIndex]) -> None:
        self.pieces: list[Piece] = []
        self._stream = stream
        self._known = known
        self._indexed: Piece | None = None  # the chunk that the records around here tell of
        self._data_end = 0

    def along(self, size: int) -> None:
        """Go along so many bytes."""
        barriers = [*sorted(self._known), size]
        position = len(MAGIC)
        while position < size and not self._data_end:
            barrier = barriers[bisect_right(barriers, position)]
            self._stream.seek(position)
            try:
                position = self._take(position, self._stream.read(_BEGINNING), barrier)
            except (ValueError, struct.error):
                self._lose(position, barrier)
                position = barrier
        if self._indexed is not None and not self._data_end:
            self._indexed.places.clear()  # the file may be cut off among the records that tell of it
        self._check(self._data_end or size - _DATA_END.size)

    def _take(self, begin: int, head: bytes, barrier: int) -> int:
        """Take a record, and return where it ends."""
        opcode, end = _record(head, begin, barrier)
        if opcode == Opcode.CHUNK:
            self._indexed = self._chunk(begin, end, head)
            self._add(self._indexed)
        elif begin in self._known:
            raise DamageError('is no chunk')
        elif opcode == Opcode.MESSAGE_INDEX:
            self._index(begin, end, head)
        elif opcode in _RESERVED:
            self._lose(begin, end)
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
            self._lose(begin, end)  # its chunk was not known for one
        else:
            self._indexed.places[channel] = begin
            self._indexed.index_end = end

    def _extend(self, begin: int, end: int, time: int) -> None:
        """Add a record to the run of those before it."""
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

    def _lose(self, begin: int, end: int) -> None:
        """Note that something is damaged; where the summary knows the chunks it tells whether it was one."""
        if self._indexed is not None:
            self._indexed.places.clear()
            self._indexed = None
        if begin in self._known:
            index = self._known[begin]
            self._add(Piece(begin, end, index.message_start_time, index.message_end_time, damaged=True))
        elif not self._known and not (self.pieces and self.pieces[-1].damaged):
            self._add(Piece(begin, end, self.pieces[-1].stop if self.pieces else 0, damaged=True))

    def _check(self, end: int) -> None:
        """
        Trust nothing without a checksum of its own where that of all data, if there is one, is wrong.

        Nor messages outside of chunks where chunks have checksums and something is damaged: they may be out of a chunk
        the head of which is gone.
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
    """Return what a record is and where it ends."""
    opcode, length = HEAD.unpack_from(head)
    end = begin + HEAD.size + length
    if not opcode or end > barrier:
        raise DamageError('has a length that cannot be')
    return opcode, end


def _footer(end: bytes) -> Footer:
    footer: Footer = Footer.read(ReadDataStream(BytesIO(end[HEAD.size :])))
    return footer


def _checksum(stream: IO[bytes], begin: int, end: int) -> int:
    """Return the checksum of some bytes of a file."""
    stream.seek(begin)
    checksum = 0
    while begin < end and (part := stream.read(min(_RUN, end - begin))):
        checksum = zlib.crc32(part, checksum)
        begin += len(part)
    return checksum
