# SPDX-License-Identifier: Apache-2.0
"""
Opening the files that users name, and the files that such files name.

The program opens all input files here. It reads regular files only, and only the bytes that a file has when it is
opened: reading a named pipe, a device or a growing file has no end.
"""

from __future__ import annotations

import io
import os
import stat
from pathlib import Path

from cfd_pneumatic.errors import InputError

MOST_HOLES = 2**30
"""Size of a file's holes [bytes]: they read as zeros and need no disk, so that anyone can make a huge file."""

_BUFFER = 2**16
_OTHER_KINDS = (
    (stat.S_ISDIR, 'is a folder'),
    (stat.S_ISFIFO, 'is a named pipe'),
    (stat.S_ISSOCK, 'is a socket'),
    (stat.S_ISCHR, 'is a device'),
    (stat.S_ISBLK, 'is a device'),
)


def open_input(path: Path, most: int | None = None) -> io.BufferedReader:
    """
    Open a regular file for reading, up to its present end.

    Parameters
    ----------
    path : Path
        The file.
    most : int, optional
        Largest accepted size [bytes].

    Raises
    ------
    InputError
        If the file cannot be read, is not a regular file, is larger than `most`, or consists of holes.

    """
    try:
        _check_kind(os.stat(path))  # some devices act when they are opened
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError as error:
        raise InputError(f'cannot be read: {error.strerror}') from error
    except ValueError as error:  # a name with a null character in it
        raise InputError('cannot be read: no file has such a name') from error
    file = _FileAsOpened(descriptor)
    try:
        _check_kind(os.fstat(descriptor))  # another file may have taken the name since
        if most is not None and file.size > most:
            raise InputError(f'has more than {f"{most // 2**20} MiB" if most >= 2**20 else f"{most // 2**10} KiB"}')
        _check_holes(descriptor, file.size)
    except BaseException:
        file.close()
        raise
    return io.BufferedReader(file, _BUFFER)


def read_input(path: Path, most: int) -> bytes:
    """
    Return the content of a regular file.

    Parameters
    ----------
    path, most
        See `open_input`.

    Raises
    ------
    InputError
        See `open_input`.

    """
    with open_input(path, most) as file:
        try:
            return file.read()
        except OSError as error:
            raise InputError(f'cannot be read: {error.strerror}') from error


def check_input(path: Path) -> None:
    """
    Check that a path leads to a regular file, before a library opens the path itself.

    Raises
    ------
    InputError
        See `open_input`.

    """
    open_input(path).close()


class _FileAsOpened(io.FileIO):
    """A file that ends where it ended at its opening."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self.size = os.fstat(descriptor).st_size

    def readinto(self, buffer: memoryview) -> int | None:  # type: ignore[override]
        return super().readinto(memoryview(buffer)[: self._remaining()])

    def readall(self) -> bytes:
        return self.read(self._remaining()) or b''

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        if whence == os.SEEK_END:
            offset, whence = self.size + offset, os.SEEK_SET
        return super().seek(offset, whence)

    def _remaining(self) -> int:
        return max(0, self.size - self.tell())


def _check_kind(state: os.stat_result) -> None:
    for is_kind, text in _OTHER_KINDS:
        if is_kind(state.st_mode):
            raise InputError(f'{text}, not a file')


def _check_holes(descriptor: int, size: int) -> None:
    """Refuse a file whose holes take more than two seconds to read; set its position to the beginning."""
    holes = position = 0
    while position < size and holes <= MOST_HOLES < size:
        hole = os.lseek(descriptor, position, os.SEEK_HOLE)
        try:
            position = os.lseek(descriptor, hole, os.SEEK_DATA)
        except OSError:  # the hole goes on to the end
            position = size
        holes += position - hole
    os.lseek(descriptor, 0, os.SEEK_SET)
    if holes > MOST_HOLES:
        raise InputError(f'has holes of more than {MOST_HOLES // 2**30} GiB: it is not a recording')
