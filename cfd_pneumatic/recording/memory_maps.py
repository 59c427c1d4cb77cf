# SPDX-License-Identifier: Apache-2.0
"""Arrays that are longer than memory: kept in files, made and gone over part by part."""

from __future__ import annotations

import errno
import mmap
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.message_texts import reason_of

PART = 65_536
"""Entries of an array that are gone over together."""


def allocate(count: int, dtype: DTypeLike, folder: Path | None) -> NDArray[Any]:
    """
    Return a new array, in memory or in a file of a folder.

    The file has no name and vanishes with the array.

    Raises
    ------
    InputError
        If there is no room for it.

    """
    size = count * np.dtype(dtype).itemsize
    try:
        if folder is None or not size:
            return np.empty(count, dtype)
        if size > shutil.disk_usage(folder).free:  # or trying would fill the disk for everybody
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        with TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size)  # a disk that fills up later would kill the program
            return np.frombuffer(mmap.mmap(file.fileno(), size), dtype)
    except (OSError, MemoryError, ValueError) as error:
        raise _no_room(size, folder, error) from error


def _no_room(size: int, folder: Path | None, error: Exception) -> InputError:
    return InputError(
        f'{size / 1e6:.1f} MB of it cannot be kept in {folder or "memory"}: '
        f'{getattr(error, "strerror", None) or reason_of(error)}; give a folder with room for it in TMPDIR'
    )


def parts(*arrays: NDArray[Any]) -> Iterator[slice]:
    """Yield slices that cover arrays of equal length, one after the other; memory is given back behind each."""
    count = len(arrays[0])
    for begin in range(0, count, PART):
        yield slice(begin, min(begin + PART, count))
        give_back(*arrays)


def give_back(*arrays: NDArray[Any]) -> None:
    """Give back the memory of arrays that are in files; they are read again where they are needed."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        mapping = base.obj if isinstance(base, memoryview) else base
        if isinstance(mapping, mmap.mmap):
            mapping.madvise(mmap.MADV_DONTNEED)
