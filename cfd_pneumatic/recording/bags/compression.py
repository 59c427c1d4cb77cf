# SPDX-License-Identifier: Apache-2.0
"""Unpacking what is compressed, and no more of it than can be meant: a few bytes may unpack to gigabytes."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import lz4.frame
import zstandard

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
    ValueError
        If the compression is not known, or no size is given and it is more than can be meant.

    """
    if compression not in _UNPACKERS:
        raise ValueError(f'is compressed with {compression}, which is not known')
    if most is not None:
        return _UNPACKERS[compression](packed, most)
    most = most_unpacked(len(packed))
    content = _UNPACKERS[compression](packed, most + 1)
    if len(content) > most:
        raise ValueError(_TOO_MUCH)
    return content


def unpacker(compression: str) -> Callable[[bytes], bytes]:
    """Return what unpacks with one compression."""
    return partial(unpacked, compression=compression)


def check_file(file: Path) -> None:
    """
    Unpack a file that is compressed with zstd, to no place.

    Raises
    ------
    ValueError
        If it unpacks to more than can be meant.

    """
    most, count = most_unpacked(file.stat().st_size), 0
    with file.open('rb') as packed:
        pieces = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while piece := pieces.read(_PIECE):
            count += len(piece)
            if count > most:
                raise ValueError(_TOO_MUCH)
