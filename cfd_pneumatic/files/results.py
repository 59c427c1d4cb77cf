# SPDX-License-Identifier: Apache-2.0
"""
Replace results of earlier runs, and keep files that this program did not write.

Each writer defines a mark in its files by which its results are recognised. A checksum does not suffice: a run that
was killed while it moved its files into place must be repeatable.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files.staging import (
    check_folder,
    disk_errors_reported,
    exclusive_access,
    is_mount_point,
    make_folder,
    staged_output,
)

_HEAD = 2**16  # bytes that are searched for a mark

ADVICE = 'replace it with --overwrite (in Python: overwrite=True)'
"""How a user replaces a file that this program did not write."""

Recognition = Callable[[Path], bool]
"""Returns whether this program wrote a file."""


def marked(pattern: str) -> Recognition:
    """Return a recognition that searches the first 64 KiB of a file for a regular expression."""
    return partial(_has_mark, re.compile(pattern.encode()))


def _has_mark(mark: re.Pattern[bytes], path: Path) -> bool:
    try:
        with path.open('rb') as stream:
            return mark.search(stream.read(_HEAD)) is not None
    except OSError:
        return False


def never(_: Path) -> bool:
    """Recognise no file: the results are meant to be edited, or to be kept."""
    return False


class ResultFiles:
    """
    The files that a program writes into a folder.

    Parameters
    ----------
    recognitions
        Recognition for each regular expression of file names, in the order in which the files are moved into place if
        the folder cannot be exchanged.

    """

    def __init__(self, recognitions: Mapping[str, Recognition]) -> None:
        self.recognitions = dict(recognitions)

    def is_earlier(self, path: Path) -> bool:
        """Return whether a file is a result of an earlier run."""
        patterns = self._patterns_of(path.name)
        return bool(patterns) and _is_file(path) and self.recognitions[patterns[0]](path)

    def check(self, folder: Path, names: Collection[str] | None = None, *, overwrite: bool) -> None:
        """
        Check before the work that results can be written into a folder.

        Parameters
        ----------
        folder
            Folder for the results; may be missing.
        names
            Names of the files that may be written; by default all.
        overwrite
            Whether to replace also files that this program did not write.

        Raises
        ------
        InputError
            If the folder cannot be written, or has a file with such a name that this program did not write.

        """
        check_folder(folder)
        self.check_files(folder, names, overwrite=overwrite)

    def check_files(self, folder: Path, names: Collection[str] | None = None, *, overwrite: bool) -> None:
        """Check the files of a folder as `check` does, without checking the folder."""
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if self._patterns_of(path.name) and (names is None or path.name in names):
                check_replaceable(path, self.is_earlier, overwrite=overwrite)

    @contextmanager
    def made_for(self, folder: Path, *, overwrite: bool) -> Iterator[Path]:
        """
        Make the folder, get exclusive access, and yield a staging folder as `staged_output` does.

        Raises
        ------
        InputError
            If another run writes into the folder; else see `staged_output`.

        """
        is_new = not folder.exists()
        make_folder(folder)
        try:
            with exclusive_access(folder), self.staged_output(folder, overwrite=overwrite) as staged:
                yield staged
        except BaseException:
            if is_new:
                with suppress(OSError):  # another run has meanwhile written into the folder
                    folder.rmdir()
            raise

    @contextmanager
    def staged_output(self, folder: Path, *, overwrite: bool) -> Iterator[Path]:
        """
        Yield a new folder for the results; at the end, but not after an error, move the results into place.

        Earlier results without a successor are removed; all other files of the folder stay.

        Raises
        ------
        InputError
            If the folder cannot be written, or has a file that must not be replaced.

        """
        with staged_output(folder, self.is_earlier, self._rank) as staged:
            staged.mkdir()
            yield staged
            self.check_files(folder, os.listdir(staged), overwrite=overwrite)

    def _rank(self, name: str) -> int:
        return list(self.recognitions).index(self._patterns_of(name)[0])

    def _patterns_of(self, name: str) -> list[str]:
        """Return the patterns that a name matches."""
        return [pattern for pattern in self.recognitions if re.fullmatch(pattern, name)]


def check_replaceable(path: Path, is_ours: Recognition, *, overwrite: bool) -> None:
    """
    Refuse to replace a file that this program did not write.

    Parameters
    ----------
    path
        Path of a file to be written; may be free.
    is_ours
        Recognises files that this program wrote. A link always counts as a file of the user.
    overwrite
        Whether to replace also a file that this program did not write.

    Raises
    ------
    InputError
        If the file must not or cannot be replaced.

    """
    if not os.path.lexists(path):
        return
    with disk_errors_reported(path):
        if path.is_dir() and not path.is_symlink():
            raise InputError(f'{path} is a folder and is not replaced: move it, or choose another folder')
        if is_mount_point(path) or not _may_be_removed(path):
            raise InputError(
                f"{path} is a mount point, immutable or another user's and cannot be replaced: choose another folder"
            )
        if not overwrite and not (_is_file(path) and is_ours(path)):
            raise InputError(f'{path} exists and may be yours: move it, choose another folder, or {ADVICE}')


def _is_file(path: Path) -> bool:
    """Return whether a path is a regular file and not a link."""
    return stat.S_ISREG(path.lstat().st_mode)


def _may_be_removed(path: Path) -> bool:
    """Return whether the user may remove a file: not an immutable file, nor another user's in a sticky folder."""
    folder, file = path.parent.stat(), path.lstat()
    is_ours = os.geteuid() in (0, file.st_uid)
    if not is_ours and (not folder.st_mode & stat.S_ISVTX or os.geteuid() == folder.st_uid):
        return True
    try:
        os.utime(path, ns=(file.st_atime_ns, file.st_mtime_ns), follow_symlinks=False)  # only the owner may
    except OSError:
        return False
    return True
