# SPDX-License-Identifier: Apache-2.0
"""
Writing results so that a reader finds the old one or the new one, never half of either, whatever ends the program.

What is new is made aside, written through to the disk, and then takes its place in one step. What a run that was killed
left aside is taken away by the next one at the same path.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import hashlib
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cfd_pneumatic.errors import InputError

_AT_FDCWD = -100
_EXCHANGE = 2  # of renameat2: both paths stay there, with each other's content
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_UNSUPPORTED = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM)


def write_text(path: Path, text: str) -> None:
    """
    Write a text file aside and let it take its place.

    Raises
    ------
    InputError
        If it can't be written.

    """
    write_bytes(path, text.encode(errors='backslashreplace'))


def write_bytes(path: Path, content: bytes) -> None:
    """
    Write a file aside and let it take its place.

    Raises
    ------
    InputError
        If it can't be written.

    """
    with made_aside(path) as aside:
        aside.write_bytes(content)


class Aside:
    """
    A folder beside a path, in which the path's successor is made.

    Parameters
    ----------
    path
        Of a file or folder, which may be there already.
    alone
        Whether nobody else may be making the same.

    Attributes
    ----------
    path : Path
        The place that it will take.
    made : Path
        What is to take the path's place; not there yet.

    Raises
    ------
    OSError
        If nothing can be written there.
    InputError
        If somebody else is making the same, who should be alone.

    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        self.path = path
        self._folder, self._lock = _locked_folder(path)
        self.made = self._folder / path.name
        if take_away_left(path.parent, (path.name,), self._folder.name) and alone:
            self.close()
            raise InputError(f'{path} is being written by another run: wait for it, or choose another name')

    def take_place(self) -> None:
        """Let what was made take its place: where the system can, there is no moment without the one or the other."""
        write_through(self.made)
        if not (self.path.is_dir() and _exchanged(self.made, self.path)):
            if self.path.is_dir():
                os.replace(self.path, self._folder / 'earlier')
            try:
                os.replace(self.made, self.path)
            except OSError:
                if (self._folder / 'earlier').exists():
                    os.replace(self._folder / 'earlier', self.path)
                raise
        _fsync(self.path.parent)

    def close(self) -> None:
        """Take away what is left, what was there before in it."""
        shutil.rmtree(self._folder, ignore_errors=True)
        os.close(self._lock)


@contextmanager
def made_aside(path: Path) -> Iterator[Path]:
    """
    Yield where the successor of a file or folder is made; it takes its place at the end, but not after an error.

    Raises
    ------
    InputError
        If it can't be written.

    """
    with reported(path):
        aside = Aside(path)
        try:
            yield aside.made
            aside.take_place()
        finally:
            aside.close()


@contextmanager
def reported(path: Path) -> Iterator[None]:
    """Turn what a disk can do wrong into an error for the user."""
    try:
        yield
    except OSError as error:
        advice = (
            'make room, or choose another folder' if error.errno in _FULL else 'choose a folder that you may write to'
        )
        raise InputError(f'cannot write {path}: {error.strerror or error}; {advice}') from error


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """
    Be the only one who writes results into a folder.

    Raises
    ------
    InputError
        If somebody else does.

    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        if not _locked(lock):
            raise InputError(f'{folder} is being written by another run: wait for it, or choose another folder')
        yield
    finally:
        os.close(lock)


def make_folder(folder: Path) -> None:
    """
    Make an output folder.

    Raises
    ------
    InputError
        If it can't be made or written.

    """
    with reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def check_folder(folder: Path) -> None:
    """
    Find out whether an output folder can be made and written, before the work is done, and leave none behind.

    Raises
    ------
    InputError
        If it can't.

    """
    with reported(folder):
        missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        make_folder(folder)
    finally:
        for one in missing:
            with suppress(OSError):
                one.rmdir()


def take_away_left(folder: Path, names: Collection[str], own: str = '') -> bool:
    """
    Take away what runs that were killed left aside.

    Parameters
    ----------
    folder, names
        Where, and of the files and folders whose successors they made.
    own
        Name of a folder aside that stays.

    Returns
    -------
    bool
        Whether a run that lives makes one of them.

    """
    somebody = False
    for left in _entries(folder):
        if left.name == own or _successor(left.name) not in names:
            continue
        with suppress(OSError):
            lock = os.open(left, os.O_RDONLY | os.O_NOFOLLOW)
            try:
                if _locked(lock):
                    shutil.rmtree(left)
                else:
                    somebody = True
            finally:
                os.close(lock)
    return somebody


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # it is not there, or one may not look into it
        return []


def _successor(aside: str) -> str | None:
    """Return the name of what is made in a folder aside, by its name."""
    return aside[1:].rpartition('~')[0] if aside.startswith('.') else None


def _locked_folder(path: Path) -> tuple[Path, int]:
    """Return a new folder beside a path, and its lock, which tells others that it is in use."""
    while True:
        folder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}~'))
        with suppress(FileNotFoundError):  # somebody took it for one that was left
            lock = os.open(folder, os.O_RDONLY)
            if _locked(lock) and folder.exists():
                return folder, lock
            os.close(lock)


def _locked(descriptor: int) -> bool:
    """Lock a folder as long as it is open; return whether nobody else had it. A system without locks has no others."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange what is at two paths; return whether the file system can."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), ctypes.c_uint(_EXCHANGE)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:
        return False
    raise OSError(number, os.strerror(number), str(other))


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    found = hashlib.sha256()
    with path.open('rb') as stream:
        while part := stream.read(2**20):
            found.update(part)
    return found.hexdigest()


def write_through(path: Path) -> None:
    """Have the disk hold a file, or a folder with all that is in it."""
    if path.is_dir():
        for inside in path.iterdir():
            write_through(inside)
    _fsync(path)


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system that can't do that with folders
            raise
    finally:
        os.close(descriptor)
