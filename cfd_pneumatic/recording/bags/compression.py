# SPDX-License-Identifier: Apache-2.0
"""Unpack compressed data up to a limit: a few bytes may unpack to gigabytes."""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import lz4.frame
import zstandard

from cfd_pneumatic.errors import DamageError
from cfd_pneumatic.files import open_input

_MOST = 64 * 2**20  # unpacked size that is always accepted [bytes]
_RATIO = 32  # further unpacked bytes per packed byte; recorded numbers seldom shrink to a tenth
_PIECE = 2**20  # [bytes]
_TOO_MUCH = 'unpacks to more data than a recording can hold'


def most_unpacked(packed: int) -> int:
    """Return the largest accepted number of unpacked bytes for a number of packed bytes."""
    return _MOST + _RATIO * packed


def _unpacked_zstd(packed: bytes, most: int) -> bytes:
    content: bytes = zstandard.ZstdDecompressor().stream_reader(packed).read(most)
    return content


_UNPACKERS: Mapping[str, Callable[[bytes, int], bytes]] = {
    '': lambda packed, most: packed,
    'none': lambda packed, most: packed,
    'bz2': lambda packed, most: bz2.BZ2Decompressor().decompress(packed, most),
    'lz4': lambda packed, most: bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=most)),
    'zstd': _unpacked_zstd,
}


def unpacked(packed: bytes, compression: str, most: int | None = None) -> bytes:
    """
    Return unpacked data, or only the first `most` bytes.

    Raises
    ------
    DamageError
        If the compression is not known, or `most` is None and the unpacked data exceed the limit.

    """
    if compression not in _UNPACKERS:
        raise DamageError('has an unknown compression')
    if most is not None:
        return _UNPACKERS[compression](packed, most)
    most = most_unpacked(len(packed))
    content = _UNPACKERS[compression](packed, most + 1)
    if len(content) > most:
        raise DamageError(_TOO_MUCH)
    return content


def unpacker(compression: str) -> Callable[[bytes], bytes]:
    """Return a function that unpacks data of a compression."""
    return partial(unpacked, compression=compression)


def unpack_file(file: Path, target: Path) -> None:
    """
    Unpack a file that is compressed with zstd.

    Raises
    ------
    DamageError
        If the unpacked data exceed the limit.

    """
    with open_input(file) as packed, target.open('wb') as unpacked_file:
        remaining = most_unpacked(packed.seek(0, os.SEEK_END))
        packed.seek(0)
        pieces = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while piece := pieces.read(_PIECE):
            remaining -= len(piece)
            if remaining < 0:
                raise DamageError(_TOO_MUCH)
            unpacked_file.write(piece)
