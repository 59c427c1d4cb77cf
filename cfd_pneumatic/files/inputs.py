# SPDX-License-Identifier: Apache-2.0
"""
Opening the files that people name, and those that such files name.

This is the only door through which files come in. It lets regular files pass, and no more of them than they hold when
they are opened: reading a named pipe, a device or a file that grows has no end.
"""

from __future__ import annotations

import io
import os
import stat
from pathlib import Path

from cfd_pneumatic.errors import InputError

MOST_HOLES = 2**30
"""Bytes of a file that are stored nowhere and read as zeros; they cost whoever makes the file nothing."""

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
    Open a regular file for reading, as long as it is now.

    Parameters
    ----------
    path : Path
        The file.
    most : int, optional
        Bytes that it may have.

    Raises
    ------
    InputError
        If it can't be read, is something else than a regular file, has more bytes, or consists of holes.

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
    Return what a regular file holds.

    Parameters
    ----------
    path, most
        As `open_input` takes them.

    Raises
    ------
    InputError
        As `open_input`.

    """
    with open_input(path, most) as file:
        try:
            return file.read()
        except OSError as error:
            raise InputError(f'cannot be read: {error.strerror}') from error


def check_input(path: Path) -> None:
    """
    Make sure that a library which opens a file by its name finds a regular file there.

    Raises
    ------
    InputError
        As `open_input`.

    """
    open_input(path).close()


class _FileAsOpened(io.FileIO):
    """A file that ends where it ended when it was opened."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self.size = os.fstat(descriptor).st_size

    def readinto(self, buffer: memoryview) -> int | None:  # type: ignore[override]
        return super().readinto(memoryview(buffer)[: self._rest()])

    def readall(self) -> bytes:
        return self.read(self._rest()) or b''

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        if whence == os.SEEK_END:
            offset, whence = self.size + offset, os.SEEK_SET
        return super().seek(offset, whence)

    def _rest(self) -> int:
        return max(0, self.size - self.tell())


def _check_kind(state: os.stat_result) -> None:
    for is_kind, text in _OTHER_KINDS:
        if is_kind(state.st_mode):
            raise InputError(f'{text}, not a file')


def _check_holes(descriptor: int, size: int) -> None:
    """Refuse a file with more holes than can be read in a second or two; leave its position at the beginning."""
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
        raise InputError(f'has holes of more than {MOST_HOLES // 2**30} GiB, which nobody recorded')
