# SPDX-License-Identifier: Apache-2.0
"""
Results of earlier runs may be replaced; files that this program did not write are kept.

Each writer states by which mark in the file its results are recognised. A checksum would not do: a run that was killed
while its files took their places has to be repeatable.
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

_HEAD = 2**16  # bytes in which a mark is looked for

ADVICE = 'replace it with --overwrite (in Python: overwrite=True)'
"""What to do about a file that is to be replaced in any case."""

Recognition = Callable[[Path], bool]
"""Returns whether this program wrote a file."""


def marked(pattern: str) -> Recognition:
    """Return a recognition by a regular expression that the first 64 KiB of a file match somewhere."""
    return partial(_has_mark, re.compile(pattern.encode()))


def _has_mark(mark: re.Pattern[bytes], path: Path) -> bool:
    try:
        with path.open('rb') as stream:
            return mark.search(stream.read(_HEAD)) is not None
    except OSError:
        return False


def never(_: Path) -> bool:
    """Recognise no file: what is written is meant to be edited, or to be kept."""
    return False


class ResultFiles:
    """
    The files that a program writes into a folder.

    Parameters
    ----------
    recognitions
        By regular expressions for the names of the files, in the order in which the files take their places one by one
        if the folder cannot be exchanged.

    """

    def __init__(self, recognitions: Mapping[str, Recognition]) -> None:
        self.recognitions = dict(recognitions)

    def is_earlier(self, path: Path) -> bool:
        """Return whether a file is a result of an earlier run."""
        patterns = self._patterns_of(path.name)
        return bool(patterns) and _is_file(path) and self.recognitions[patterns[0]](path)

    def check(self, folder: Path, names: Collection[str] | None = None, *, overwrite: bool) -> None:
        """
        Find out before the work whether results can be written into a folder.

        Parameters
        ----------
        folder
            Where to; need not be there.
        names
            Of the files that may be written; by default all.
        overwrite
            Whether files of these names are replaced that this program did not write.

        Raises
        ------
        InputError
            If the folder can't be written, or holds a file of one of the names that this program did not write.

        """
        check_folder(folder)
        self.check_files(folder, names, overwrite=overwrite)

    def check_files(self, folder: Path, names: Collection[str] | None = None, *, overwrite: bool) -> None:
        """Do as `check`, but find out nothing about the folder."""
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if self._patterns_of(path.name) and (names is None or path.name in names):
                check_replaceable(path, self.is_earlier, overwrite=overwrite)

    @contextmanager
    def made_for(self, folder: Path, *, overwrite: bool) -> Iterator[Path]:
        """
        Make the folder, be the only one who writes into it, and do as `staged_output`.

        Raises
        ------
        InputError
            As `staged_output`, or if another run writes into the folder.

        """
        is_new = not folder.exists()
        make_folder(folder)
        try:
            with exclusive_access(folder), self.staged_output(folder, overwrite=overwrite) as made:
                yield made
        except BaseException:
            if is_new:
                with suppress(OSError):  # another run has written into it meanwhile
                    folder.rmdir()
            raise

    @contextmanager
    def staged_output(self, folder: Path, *, overwrite: bool) -> Iterator[Path]:
        """
        Yield a new folder for the results; they take their places in a folder at the end, but not after an error.

        Earlier results that were not made anew are removed; everything else in the folder stays.

        Raises
        ------
        InputError
            If the folder can't be written, or a file in it is not to be replaced.

        """
        with staged_output(folder, self.is_earlier, self._rank) as made:
            made.mkdir()
            yield made
            self.check_files(folder, os.listdir(made), overwrite=overwrite)

    def _rank(self, name: str) -> int:
        return list(self.recognitions).index(self._patterns_of(name)[0])

    def _patterns_of(self, name: str) -> list[str]:
        """Return the pattern that a name matches, if any."""
        return [one for one in self.recognitions if re.fullmatch(one, name)]


def check_replaceable(path: Path, is_ours: Recognition, *, overwrite: bool) -> None:
    """
    Refuse to replace a file that this program did not write.

    Parameters
    ----------
    path
        Of a file to be written; nothing may be there.
    is_ours
        Recognises files that this program wrote. Links are nobody's but the user's.
    overwrite
        Whether a file may be replaced in any case.

    Raises
    ------
    InputError
        If it is not to be replaced, or can't be.

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
    """Return whether a path is that of a regular file, and no link."""
    return stat.S_ISREG(path.lstat().st_mode)


def _may_be_removed(path: Path) -> bool:
    """Return whether a file may be removed: it is not immutable, and in a sticky folder it or the folder is ours."""
    folder, found = path.parent.stat(), path.lstat()
    is_ours = os.geteuid() in (0, found.st_uid)
    if not is_ours and (not folder.st_mode & stat.S_ISVTX or os.geteuid() == folder.st_uid):
        return True
    try:
        os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns), follow_symlinks=False)  # only the owner may
    except OSError:
        return False
    return True
