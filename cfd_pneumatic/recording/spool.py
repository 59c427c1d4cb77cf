"""Arrays that are longer than memory: kept in files, made and gone over part by part."""

from __future__ import annotations

import errno
import math
import mmap
import os
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.wording import reason_of

PART = 65_536
"""Entries of an array that are gone over together."""

_IN_MEMORY = 250_000  # entries of an array that grows, beyond which it is kept in a file
_THINNED = 1_000_000  # entries that tell what a long array's values are like


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


class Growing:
    """
    An array that grows at its end, in memory or, once it is long, in a file that vanishes with it.

    Parameters
    ----------
    dtype : dtype
        Of its entries.

    """

    def __init__(self, dtype: DTypeLike = np.float64) -> None:
        self._dtype = np.dtype(dtype)
        self._parts: list[NDArray[Any]] = []
        self._count = 0
        self._file: IO[bytes] | None = None

    def __len__(self) -> int:
        """Return the number of entries."""
        return self._count

    def append(self, values: NDArray[Any]) -> None:
        """
        Add entries.

        Raises
        ------
        InputError
            If there is no room for them.

        """
        self._parts.append(np.array(values, self._dtype))
        self._count += len(values)
        if self._count > _IN_MEMORY:
            self._write()

    def array(self) -> NDArray[Any]:
        """Return the array."""
        if self._file is None:
            return np.concatenate(self._parts) if self._parts else np.empty(0, self._dtype)
        return np.frombuffer(mmap.mmap(self._file.fileno(), self._count * self._dtype.itemsize), self._dtype)

    def _write(self) -> None:
        folder = Path(gettempdir())
        try:
            if self._file is None:
                self._file = TemporaryFile(dir=folder)  # noqa: SIM115 - it is kept as long as the array
            for part in self._parts:
                self._file.write(part.data)
            self._file.flush()
        except OSError as error:
            raise _no_room(self._count * self._dtype.itemsize, folder, error) from error
        self._parts.clear()


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


def overlapping(count: int, size: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices that cover an array one after the other, of about some size, and each with a margin around it."""
    edges = np.linspace(0, count, max(1, round(count / size)) + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        yield slice(begin, end), slice(max(begin - margin, 0), min(end + margin, count))


def extent(values: NDArray[Any], counts: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Return the smallest and the largest value of an array, or of those that count."""
    low, high = math.inf, -math.inf
    for part in parts(values):
        here = values[part] if counts is None else values[part][counts[part]]
        low, high = min(low, float(here.min(initial=math.inf))), max(high, float(here.max(initial=-math.inf)))
    return low, high


def dot(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Return the inner product of two arrays."""
    return sum(float(one[part] @ other[part]) for part in parts(one, other))


def thinned(values: NDArray[Any], most: int = _THINNED) -> NDArray[Any]:
    """Return every so many-th value, in memory: all of a short array, so many and some of a long one."""
    every = -(-len(values) // most)
    if every <= 1:
        return values
    return np.concatenate([values[part][::every].copy() for part in parts(values)])


def taken(values: NDArray[Any], places: NDArray[np.intp]) -> NDArray[Any]:
    """Return the entries at increasing places, in memory."""
    found = np.empty(len(places), values.dtype)
    for part in parts(values):
        here = slice(*np.searchsorted(places, [part.start, part.stop]))
        found[here] = values[places[here]]
    return found
