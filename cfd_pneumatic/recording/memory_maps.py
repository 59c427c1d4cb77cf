# SPDX-License-Identifier: Apache-2.0
"""Arrays that exceed the memory: kept in files, written and read part by part."""

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
"""Number of array entries in a part."""


def allocate(count: int, dtype: DTypeLike, folder: Path | None) -> NDArray[Any]:
    """
    Return a new array, in memory or in a file of a folder.

    The file has no name and vanishes with the array.

    Raises
    ------
    InputError
        If memory or disk have no room for the array.

    """
    size = count * np.dtype(dtype).itemsize
    try:
        if folder is None or not size:
            return np.empty(count, dtype)
        if size > shutil.disk_usage(folder).free:  # an attempt would fill the disk
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        with TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size)  # a disk that fills up later would kill the program
            return np.frombuffer(mmap.mmap(file.fileno(), size), dtype)
    except (OSError, MemoryError, ValueError) as error:
        raise _no_room(size, folder, error) from error


def _no_room(size: int, folder: Path | None, error: Exception) -> InputError:
    return InputError(
        f'{size / 1e6:.1f} MB of it cannot be kept in {folder or "memory"}: '
        f'{getattr(error, "strerror", None) or reason_of(error)}; name a folder with more room in TMPDIR'
    )


def parts(*arrays: NDArray[Any]) -> Iterator[slice]:
    """Yield consecutive slices of arrays of equal length; release the memory of file arrays after each slice."""
    count = len(arrays[0])
    for begin in range(0, count, PART):
        yield slice(begin, min(begin + PART, count))
        give_back(*arrays)


def give_back(*arrays: NDArray[Any]) -> None:
    """Release the memory of arrays that are in files; the system reads the files again on access."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        mapping = base.obj if isinstance(base, memoryview) else base
        if isinstance(mapping, mmap.mmap):
            mapping.madvise(mmap.MADV_DONTNEED)
