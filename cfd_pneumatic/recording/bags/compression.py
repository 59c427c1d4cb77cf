# SPDX-License-Identifier: Apache-2.0
"""Unpacking what is compressed, and no more of it than can be meant: a few bytes may unpack to gigabytes."""

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

_MOST = 64 * 2**20  # what anything may unpack to, [bytes]
_RATIO = 32  # and more than that, in times of what is packed; numbers seldom shrink to a tenth
_PIECE = 2**20  # [bytes]
_TOO_MUCH = 'unpacks to more than can be meant'


def most_unpacked(packed: int) -> int:
    """Return to how many bytes a number of packed bytes may unpack."""
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
    Return what is packed, or the beginning of it where that is longer than `most` bytes.

    Raises
    ------
    DamageError
        If the compression is not known, or no size is given and it is more than can be meant.

    """
    if compression not in _UNPACKERS:
        raise DamageError('is compressed in a way that is not known')
    if most is not None:
        return _UNPACKERS[compression](packed, most)
    most = most_unpacked(len(packed))
    content = _UNPACKERS[compression](packed, most + 1)
    if len(content) > most:
        raise DamageError(_TOO_MUCH)
    return content


def unpacker(compression: str) -> Callable[[bytes], bytes]:
    """Return what unpacks with one compression."""
    return partial(unpacked, compression=compression)


def unpack_file(file: Path, target: Path) -> None:
    """
    Unpack a file that is compressed with zstd.

    Raises
    ------
    DamageError
        If it unpacks to more than can be meant.

    """
    with open_input(file) as packed, target.open('wb') as unpacked_file:
        left = most_unpacked(packed.seek(0, os.SEEK_END))
        packed.seek(0)
        pieces = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while piece := pieces.read(_PIECE):
            left -= len(piece)
            if left < 0:
                raise DamageError(_TOO_MUCH)
            unpacked_file.write(piece)
