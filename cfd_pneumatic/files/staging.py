# SPDX-License-Identifier: Apache-2.0
"""
Writing results so that a reader finds the old one or the new one, never half of either, whatever ends the program.

What is new is made aside, written through to the disk, and then takes its place in one step. The files of a folder that
cannot be exchanged, as of a mount point, are made inside of it and take their places one by one. What a run that was
killed left aside is taken away by the next one at the same path.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from cfd_pneumatic.errors import InputError

_AT_FDCWD = -100
_EXCHANGE = 2  # of renameat2: both paths stay there, with each other's content
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_ASIDE = re.compile(r'\.(.+)~[a-z0-9_]{8}', re.DOTALL)
"""Names of folders aside, as `tempfile` completes them: nobody's own folder shall be taken for one."""

_OCTAL = re.compile(r'\\([0-7]{3})')
"""How the kernel writes spaces in the paths of mount points."""

_BLOCK = 4096  # bytes that are written to find out whether the disk has room


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
    with staged_output(path) as aside:
        aside.write_bytes(content)


IsEarlier = Callable[[Path], bool]
"""Returns whether what is in a folder is an earlier result, which may be replaced and removed."""


Order = Callable[[str], int]
"""Returns the rank of a file, by its name, among files that take their places one by one."""


class StagedOutput:
    """
    A folder in which the successor of a file or folder is made.

    It is beside the path, or inside of a folder that cannot be exchanged for a new one: a mount point, a folder below
    a parent that may not be written, or one of another owner, group, mode or attributes than a new one.

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
    parent : Path
        Folder that the aside is in: the path's parent, or the path itself.
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
        self.path = path.resolve() if path.is_dir() else path  # a link to a folder stays one
        name = _name_of(self.path)
        self.parent = _parent_of_aside(self.path, name)
        self._folder, self._lock = _locked_folder(self.parent, name)
        self.made = self._folder / name
        others = [remove_abandoned(folder, (name,), self._folder.name) for folder in (self.path.parent, self.path)]
        if any(others) and alone:
            self.close()
            raise InputError(f'{path} is being written by another run: wait for it, or choose another name')

    def take_place(
        self, is_earlier: IsEarlier = lambda _: False, order: Order = lambda _: 0, *, write_through: bool = True
    ) -> None:
        """
        Let what was made take its place.

        A folder is exchanged in one step if it holds nothing but earlier results and the file system can exchange it.
        Otherwise the files take their places one by one, and earlier results that were not made anew are removed.

        Parameters
        ----------
        is_earlier
            What in the folder is an earlier result; by default nothing.
        order
            In which order they take their places one by one; by default by their names.
        write_through
            Whether the disk has to hold everything before.

        """
        if write_through:
            _write_through(self.made)
        if not (self.made.is_dir() and self.path.is_dir()):
            os.replace(self.made, self.path)
            _fsync(self.path.parent)
            return
        inside = content(self.path)
        if all(map(is_earlier, inside)) and not self.path.samefile('.') and _exchanged(self.made, self.path):
            _fsync(self.path.parent)
            return
        names = sorted(os.listdir(self.made), key=lambda name: (order(name), name))
        for name in names:
            os.replace(self.made / name, self.path / name)
        for path in inside:
            if path.name not in names and is_earlier(path):
                path.unlink()
        _fsync(self.path)

    def follow(self) -> bool:
        """
        Find the folder again by its lock, which stays open; return whether somebody moved it, or a folder above it.

        What is made takes a place in the folder that was moved.

        Raises
        ------
        InputError
            If it cannot be reached any more.

        """
        if self._is_at(self._folder):
            return False
        found = Path(os.readlink(f'/proc/self/fd/{self._lock}'))
        if not self._is_at(found):
            raise InputError(
                f'cannot write {self.path}: {self.parent} was removed, moved to another disk, or hidden by a mount. '
                f'What was written is lost, unless {self._folder.name} is still in it: look for it, and start again'
            )
        self._folder, self.parent = found, found.parent
        self.made = found / self.made.name
        self.path = self.parent / self.path.name
        return True

    def _is_at(self, folder: Path) -> bool:
        try:
            return os.path.samestat(folder.stat(), os.fstat(self._lock))
        except OSError:
            return False

    def close(self) -> None:
        """Take away what is left, what was there before in it."""
        with suppress(InputError):
            self.follow()
        _remove_aside(self._folder, self._lock)


@contextmanager
def staged_output(path: Path, is_earlier: IsEarlier = lambda _: False, order: Order = lambda _: 0) -> Iterator[Path]:
    """
    Yield where the successor of a file or folder is made; it takes its place at the end, but not after an error.

    Parameters
    ----------
    path
        Of a file or folder, which may be there already.
    is_earlier, order
        As `Aside.take_place` takes them.

    Raises
    ------
    InputError
        If it can't be written.

    """
    with disk_errors_reported(path):
        aside = StagedOutput(path)
        try:
            yield aside.made
            aside.take_place(is_earlier, order)
        finally:
            aside.close()


def content(folder: Path) -> list[Path]:
    """Return what a folder holds, without the asides of runs that write it or were killed."""
    name = _name_of(folder.resolve())
    return [entry for entry in folder.iterdir() if _successor(entry.name) != name or not _is_folder(entry)]


def _is_folder(path: Path) -> bool:
    """Return whether a path is that of a folder, and no link to one."""
    return path.is_dir() and not path.is_symlink()


@contextmanager
def disk_errors_reported(path: Path) -> Iterator[None]:
    """Turn what a disk can do wrong into an error for the user."""
    try:
        yield
    except OSError as error:
        advice = (
            'make room, or choose another folder' if error.errno in _FULL else 'choose a folder that you may write to'
        )
        raise InputError(f'cannot write {_destination(path)}: {error.strerror or error}; {advice}') from error


def _destination(path: Path) -> Path:
    """Return the file or folder that the user named, for a path in the folder in which its successor is made."""
    for part in (*reversed(path.parents), path):
        if (name := _successor(part.name)) is not None:
            return part.with_name(name)
    return path


@contextmanager
def exclusive_access(folder: Path) -> Iterator[None]:
    """
    Be the only one who writes results into a folder.

    Raises
    ------
    InputError
        If somebody else does.

    """
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
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
    with disk_errors_reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def check_folder(folder: Path, *, alone: bool = False) -> None:
    """
    Find out whether an output folder can be made and written, before the work is done, and leave none behind.

    It does in an aside what writing the results will do: it makes the folders that are missing, and writes a block to
    the disk.

    Parameters
    ----------
    folder
        Where results are to be written; need not be there.
    alone
        Whether nobody else may be making the same folder.

    Raises
    ------
    InputError
        If it can't, or another run writes results into it.

    """
    with disk_errors_reported(folder):
        path = folder if os.path.lexists(folder) else Path(os.path.realpath(folder))
        missing = [one for one in (path, *path.parents) if not os.path.lexists(one)]
        with nullcontext() if missing else exclusive_access(folder):
            top = missing[-1] if missing else path
            aside = StagedOutput(top, alone=alone)
            try:
                made = aside.made / path.relative_to(top)
                made.mkdir(parents=True)
                StagedOutput(made).close()  # there is room for its name
                (made / 'block').write_bytes(bytes(_BLOCK))
                _write_through(made)
            finally:
                aside.close()


def remove_abandoned(folder: Path, names: Collection[str], own: str = '') -> bool:
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
            lock = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
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
    """Return the name of what is made in a folder aside, by its name; None if no folder aside is called so."""
    found = _ASIDE.fullmatch(aside)
    return None if found is None else found[1]


def _name_of(path: Path) -> str:
    """Return the name by which asides of a path are known; the root has none of its own."""
    return path.name or 'root'


def _parent_of_aside(path: Path, name: str) -> Path:
    """Return in which folder an aside of a path is made: beside it, or in a folder that cannot be exchanged."""
    return path if path.is_dir() and not _is_exchangeable(path, name) else path.parent


def _is_exchangeable(path: Path, name: str) -> bool:
    """Return whether a folder that is made beside one can be moved there, and is the same to everybody."""
    try:
        aside, lock = _locked_folder(path.parent, name)
    except OSError:  # the parent may not be written
        return False
    probe, moved = aside / name, path / aside.name
    try:
        probe.mkdir()
        alike = _rights(probe) == _rights(path)
        os.rename(probe, moved)  # a mount refuses it, even one of the same file system
        moved.rmdir()
    except OSError:
        return False
    finally:
        _remove_aside(aside, lock)
    return alike


def _rights(folder: Path) -> tuple[object, ...]:
    """Return what a new folder has to have in common; access control lists are attributes."""
    found = folder.stat()
    attributes = {name: os.getxattr(folder, name) for name in os.listxattr(folder)}
    return found.st_dev, found.st_uid, found.st_gid, found.st_mode, attributes


def _remove_aside(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)


def _locked_folder(parent: Path, name: str) -> tuple[Path, int]:
    """Return a new folder for the successor of what has a name, and its lock, which tells others that it is in use."""
    while True:
        folder = Path(tempfile.mkdtemp(dir=parent, prefix=f'.{name}~'))
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
    """Exchange what is at two paths; return whether the file system could."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    if rename is None:
        return False
    failed: int = rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), ctypes.c_uint(_EXCHANGE))
    return failed == 0


def is_mount_point(path: Path) -> bool:
    """Return whether something is mounted at a path, perhaps a file or folder of the same file system."""
    if os.path.ismount(path):
        return True
    place = os.path.join(os.path.realpath(path.parent), path.name)
    with suppress(OSError), open('/proc/self/mountinfo', encoding='utf-8', errors='surrogateescape') as mounts:
        return any(_OCTAL.sub(lambda one: chr(int(one[1], 8)), line.split()[4]) == place for line in mounts)
    return False


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    found = hashlib.sha256()
    with path.open('rb') as stream:
        while part := stream.read(2**20):
            found.update(part)
    return found.hexdigest()


def _write_through(path: Path) -> None:
    """Have the disk hold a file, or a folder with all that is in it."""
    if path.is_dir():
        for inside in path.iterdir():
            _write_through(inside)
    _fsync(path)


def _fsync(path: Path) -> None:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # a folder may be written, but not read
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system that can't do that with folders
            raise
    finally:
        os.close(descriptor)
