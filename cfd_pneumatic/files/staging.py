# SPDX-License-Identifier: Apache-2.0
"""
Writing results so that a reader finds the complete old or the complete new result, even if the program is killed.

New results are made in a staging folder, written through to the disk, and moved into place in one step. If a folder
cannot be exchanged, such as a mount point, the staging folder is inside that folder and the files are moved singly. The
next run at the same path removes the staging folder of a killed run.
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
_EXCHANGE = 2  # flag of renameat2: the two paths exchange their contents
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_STAGING_NAME = re.compile(r'\.(.+)~[a-z0-9_]{8}', re.DOTALL)
"""Names of staging folders, as `tempfile` completes them: a folder of the user must not match."""

_OCTAL = re.compile(r'\\([0-7]{3})')
"""The kernel's notation for spaces in the paths of mount points."""

_BLOCK = 4096  # bytes that are written to test whether the disk has room


def write_text(path: Path, text: str) -> None:
    """
    Write a text file completely or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.

    """
    write_bytes(path, text.encode(errors='backslashreplace'))


def write_bytes(path: Path, content: bytes) -> None:
    """
    Write a file completely or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.

    """
    with staged_output(path) as staged:
        staged.write_bytes(content)


IsEarlier = Callable[[Path], bool]
"""Returns whether an entry of a folder is an earlier result, which may be replaced and removed."""


Order = Callable[[str], int]
"""Returns the rank of a file name among files that are moved into place singly."""


class StagedOutput:
    """
    A staging folder in which the successor of a file or folder is made.

    The staging folder is in the parent of the path, or inside a folder that cannot be exchanged for a new folder: a
    mount point, a folder in a parent without write permission, or a folder with other rights than a new folder.

    Parameters
    ----------
    path
        Path of a file or folder, which may exist.
    exclusive
        Whether to refuse the path if another run is making its successor.

    Attributes
    ----------
    path : Path
        Path of the result.
    parent : Path
        Parent of the staging folder: the parent of the path, or the path itself.
    staged : Path
        Path at which the caller makes the successor.

    Raises
    ------
    OSError
        If nothing can be written there.
    InputError
        If `exclusive`, and another run is making the successor.

    """

    def __init__(self, path: Path, *, exclusive: bool = False) -> None:
        self.path = path.resolve() if path.is_dir() else path  # a link to a folder stays a link
        name = _staging_key(self.path)
        self.parent = _parent_of_staging(self.path, name)
        self._folder, self._lock = _new_staging_folder(self.parent, name)
        self.staged = self._folder / name
        is_in_use = [remove_abandoned(folder, (name,), self._folder.name) for folder in (self.path.parent, self.path)]
        if any(is_in_use) and exclusive:
            self.close()
            raise InputError(f'{path} is being written by another run: wait for it, or choose another name')

    def move_into_place(
        self, is_earlier: IsEarlier = lambda _: False, order: Order = lambda _: 0, *, write_through: bool = True
    ) -> None:
        """
        Move the successor to its path.

        A folder is exchanged in one step if all its entries are earlier results and the file system can exchange it.
        Otherwise the files are moved singly, and earlier results without a successor are removed.

        Parameters
        ----------
        is_earlier
            Recognises earlier results in the folder; by default none.
        order
            Order in which files are moved singly; by default by name.
        write_through
            Whether to write the successor through to the disk first.

        """
        if write_through:
            _write_through(self.staged)
        if not (self.staged.is_dir() and self.path.is_dir()):
            os.replace(self.staged, self.path)
            _fsync(self.path.parent)
            return
        entries = folder_entries(self.path)
        if all(map(is_earlier, entries)) and not self.path.samefile('.') and _exchange(self.staged, self.path):
            _fsync(self.path.parent)
            return
        names = sorted(os.listdir(self.staged), key=lambda name: (order(name), name))
        for name in names:
            os.replace(self.staged / name, self.path / name)
        for path in entries:
            if path.name not in names and is_earlier(path):
                path.unlink()
        _fsync(self.path)

    def relocate(self) -> bool:
        """
        Find the staging folder after a move of the folder or of its parents; return whether there was a move.

        The path of the result moves with the staging folder. The open lock leads to the new place.

        Raises
        ------
        InputError
            If the folder cannot be reached any more.

        """
        if self._is_at(self._folder):
            return False
        folder = Path(os.readlink(f'/proc/self/fd/{self._lock}'))
        if not self._is_at(folder):
            raise InputError(
                f'cannot write {self.path}: {self.parent} was removed, moved to another disk, or hidden by a mount. '
                f'The written data are lost, unless {self._folder.name} is still there. Look for it, and start again'
            )
        self._folder, self.parent = folder, folder.parent
        self.staged = folder / self.staged.name
        self.path = self.parent / self.path.name
        return True

    def _is_at(self, folder: Path) -> bool:
        try:
            return os.path.samestat(folder.stat(), os.fstat(self._lock))
        except OSError:
            return False

    def close(self) -> None:
        """Remove the staging folder, which may contain the exchanged earlier result."""
        with suppress(InputError):
            self.relocate()
        _remove_staging_folder(self._folder, self._lock)


@contextmanager
def staged_output(path: Path, is_earlier: IsEarlier = lambda _: False, order: Order = lambda _: 0) -> Iterator[Path]:
    """
    Yield the path for the successor of a file or folder; move it into place at the end, but not after an error.

    Parameters
    ----------
    path
        Path of a file or folder, which may exist.
    is_earlier, order
        See `StagedOutput.move_into_place`.

    Raises
    ------
    InputError
        If the path cannot be written.

    """
    with disk_errors_reported(path):
        output = StagedOutput(path)
        try:
            yield output.staged
            output.move_into_place(is_earlier, order)
        finally:
            output.close()


def folder_entries(folder: Path) -> list[Path]:
    """Return the files and folders in a folder, without its staging folders."""
    name = _staging_key(folder.resolve())
    return [entry for entry in folder.iterdir() if _staged_name(entry.name) != name or not _is_folder(entry)]


def _is_folder(path: Path) -> bool:
    """Return whether a path is a folder and not a link."""
    return path.is_dir() and not path.is_symlink()


@contextmanager
def disk_errors_reported(path: Path) -> Iterator[None]:
    """Convert disk errors into an error for the user."""
    try:
        yield
    except OSError as error:
        advice = (
            'make room, or choose another folder' if error.errno in _FULL else 'choose a folder that you may write to'
        )
        raise InputError(f'cannot write {_destination(path)}: {error.strerror or error}; {advice}') from error


def _destination(path: Path) -> Path:
    """Return the file or folder that the user named, for a path in its staging folder."""
    for part in (*reversed(path.parents), path):
        if (name := _staged_name(part.name)) is not None:
            return part.with_name(name)
    return path


@contextmanager
def exclusive_access(folder: Path) -> Iterator[None]:
    """
    Prevent other runs from writing results into a folder.

    Raises
    ------
    InputError
        If another run is writing into the folder.

    """
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if not _lock(lock):
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
        If the folder cannot be made or written.

    """
    with disk_errors_reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def check_folder(folder: Path, *, exclusive: bool = False) -> None:
    """
    Check before the work that an output folder can be made and written; leave no folder behind.

    The check makes the missing folders in a staging folder and writes a block to the disk.

    Parameters
    ----------
    folder
        Folder for the results; may be missing.
    exclusive
        Whether to refuse the folder if another run is making it.

    Raises
    ------
    InputError
        If the folder cannot be written, or another run writes results into it.

    """
    with disk_errors_reported(folder):
        path = folder if os.path.lexists(folder) else Path(os.path.realpath(folder))
        missing = [parent for parent in (path, *path.parents) if not os.path.lexists(parent)]
        with nullcontext() if missing else exclusive_access(folder):
            top = missing[-1] if missing else path
            output = StagedOutput(top, exclusive=exclusive)
            try:
                staged = output.staged / path.relative_to(top)
                staged.mkdir(parents=True)
                StagedOutput(staged).close()  # the path has room for the name of a staging folder
                (staged / 'block').write_bytes(bytes(_BLOCK))
                _write_through(staged)
            finally:
                output.close()


def remove_abandoned(folder: Path, names: Collection[str], kept: str = '') -> bool:
    """
    Remove the staging folders of killed runs.

    Parameters
    ----------
    folder
        Folder that is searched for staging folders.
    names
        Names of results; their staging folders are removed.
    kept
        Name of a staging folder that stays.

    Returns
    -------
    bool
        Whether a running program uses such a staging folder.

    """
    is_in_use = False
    for staging in _list_folder(folder):
        if staging.name == kept or _staged_name(staging.name) not in names:
            continue
        with suppress(OSError):
            lock = os.open(staging, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                if _lock(lock):
                    shutil.rmtree(staging)
                else:
                    is_in_use = True
            finally:
                os.close(lock)
    return is_in_use


def _list_folder(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # the folder is missing, or the user has no permission to list it
        return []


def _staged_name(folder_name: str) -> str | None:
    """Return the name of the result that a staging folder is for; None if it is not the name of a staging folder."""
    match = _STAGING_NAME.fullmatch(folder_name)
    return None if match is None else match[1]


def _staging_key(path: Path) -> str:
    """Return the name of a path in the names of its staging folders; the root of the file system has no name."""
    return path.name or 'root'


def _parent_of_staging(path: Path, name: str) -> Path:
    """Return the parent for a staging folder: that of the path, or the path if it cannot be exchanged."""
    return path if path.is_dir() and not _is_exchangeable(path, name) else path.parent


def _is_exchangeable(path: Path, name: str) -> bool:
    """Return whether a new folder in the parent can be moved into a folder and has the same rights."""
    try:
        staging, lock = _new_staging_folder(path.parent, name)
    except OSError:  # the user may not write into the parent
        return False
    probe, moved = staging / name, path / staging.name
    try:
        probe.mkdir()
        has_same_rights = _rights(probe) == _rights(path)
        os.rename(probe, moved)  # a mount refuses the move, even within a file system
        moved.rmdir()
    except OSError:
        return False
    finally:
        _remove_staging_folder(staging, lock)
    return has_same_rights


def _rights(folder: Path) -> tuple[object, ...]:
    """Return the device, owner, group, mode and attributes (with access control lists) of a folder."""
    state = folder.stat()
    attributes = {name: os.getxattr(folder, name) for name in os.listxattr(folder)}
    return state.st_dev, state.st_uid, state.st_gid, state.st_mode, attributes


def _remove_staging_folder(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)


def _new_staging_folder(parent: Path, name: str) -> tuple[Path, int]:
    """Make a staging folder for a result with a name; return the folder and its lock, which marks it as in use."""
    while True:
        folder = Path(tempfile.mkdtemp(dir=parent, prefix=f'.{name}~'))
        with suppress(FileNotFoundError):  # another run removed the folder before it was locked
            lock = os.open(folder, os.O_RDONLY)
            if _lock(lock) and folder.exists():
                return folder, lock
            os.close(lock)


def _lock(descriptor: int) -> bool:
    """Lock an open folder; return whether it was free. A system without locks counts as free."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _exchange(first: Path, second: Path) -> bool:
    """Exchange the contents of two paths; return whether the file system supports the exchange."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    if rename is None:
        return False
    status: int = rename(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), ctypes.c_uint(_EXCHANGE))
    return status == 0


def is_mount_point(path: Path) -> bool:
    """Return whether a path is a mount point, even of a file or folder of the same file system."""
    if os.path.ismount(path):
        return True
    place = os.path.join(os.path.realpath(path.parent), path.name)
    with suppress(OSError), open('/proc/self/mountinfo', encoding='utf-8', errors='surrogateescape') as mounts:
        return any(_OCTAL.sub(lambda match: chr(int(match[1], 8)), line.split()[4]) == place for line in mounts)
    return False


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open('rb') as stream:
        while part := stream.read(2**20):
            digest.update(part)
    return digest.hexdigest()


def _write_through(path: Path) -> None:
    """Write a file, or a folder with its entries, through to the disk."""
    if path.is_dir():
        for entry in path.iterdir():
            _write_through(entry)
    _fsync(path)


def _fsync(path: Path) -> None:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # a folder may have write permission without read permission
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system that cannot synchronise folders
            raise
    finally:
        os.close(descriptor)
