# SPDX-License-Identifier: Apache-2.0
"""
Files of code that programs keep for their next start: machine code and compiled templates.

Such code runs with the rights of the user who starts a program. A program uses the code only if no users except this
user and root can write to its folder and its file. A checksum detects files that are incomplete after a power cut.
"""

from __future__ import annotations

import grp
import logging
import os
import pwd
import stat
import uuid
import zlib
from contextlib import suppress
from functools import cache
from pathlib import Path

from cfd_pneumatic.errors import printable

_CHECKSUM = 4  # length of a CRC-32 [bytes]
_LARGEST = 2**26  # size of a file [bytes]; the model's files have a thousandth of that
_ACCESS_LIST = 'system.posix_acl_access'
_MODE = 0o755  # rights of new folders; the user's umask may remove more

WARNED_FOLDER = 'CFD_PNEUMATIC_WARNED_FOLDER'
"""Environment variable: a folder in which cooperating processes record the kinds of warnings that they logged."""

_warned: set[str] = set()


def warn_once(kind: str, message: str) -> None:
    """Log a warning unless its kind was logged before. Programs print the warning on standard error."""
    if kind not in _warned:
        _warned.add(kind)
        if _is_first_process(kind):
            logging.getLogger(__name__).warning(printable(message))


def _is_first_process(kind: str) -> bool:
    """Return whether no cooperating process has logged a warning of this kind; record that this process logs it."""
    try:
        if WARNED_FOLDER in os.environ:
            Path(os.environ[WARNED_FOLDER], f'warned-{kind}').touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        pass
    return True


def has_warned(kind: str) -> bool:
    """Return whether a warning of a kind was logged."""
    return kind in _warned


@cache
def is_trusted(folder: Path) -> bool:
    """
    Return whether only this user and root can write to a folder; warn once if others can.

    The parent folder must be equally safe. The folders above the parent must belong to this user or root, and must
    be sticky if others can write to them. For a `__pycache__` only the folder itself is checked: a user who can
    exchange the folder can also exchange the source code next to it.
    """
    try:
        reason = _distrust_reason(folder.resolve())
    except OSError:
        return False
    if reason:
        warn_once(
            'untrusted',
            f'The cache {folder} is not used: {reason}. Its code would run with your rights. Remove the write '
            'permission, delete the folder, or name another folder in NUMBA_CACHE_DIR.',
        )
    return not reason


def _distrust_reason(folder: Path) -> str:
    """Return a sentence on another user who can change the content of a folder; '' if there is none."""
    parents = [] if folder.name == '__pycache__' else list(folder.parents)
    for path in (folder, *parents):
        state = path.stat()
        may_be_written = path in parents[1:] and state.st_mode & stat.S_ISVTX
        reason = _foreign_access(path, state, may_be_written=bool(may_be_written))
        if reason:
            return reason
    return ''


def _foreign_access(path: Path, state: os.stat_result, may_be_written: bool = False) -> str:
    """Return a sentence on another user, not root, who owns or can write to a file or folder; '' if there is none."""
    if state.st_uid not in (0, os.geteuid()):
        return f'{path} belongs to another user'
    if may_be_written:
        return ''
    if state.st_mode & stat.S_IWOTH:
        return f'every user can write to {path}'
    if state.st_mode & stat.S_IWGRP and not _is_private(state.st_gid):
        return f'other users of its group can write to {path}'
    if state.st_mode & stat.S_IWGRP and _has_access_list(path):  # with a list, the group bit is the list's mask
        return f'an access control list may let others write to {path}'
    return ''


def _has_access_list(path: Path) -> bool:
    try:
        return _ACCESS_LIST in os.listxattr(path)
    except OSError:  # a file system without access control lists
        return False


def _is_private(group: int) -> bool:
    """Return whether a group is root's or has the name of the user, and has no further member."""
    try:
        entry, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return group == 0
    return (group == 0 or entry.gr_name == user) and set(entry.gr_mem) <= {user, 'root'}


def make_folder(folder: Path) -> None:
    """Make a folder and its missing parents, with write permission for the user only."""
    if not folder.is_dir():
        make_folder(folder.parent)
        folder.mkdir(_MODE, exist_ok=True)


def read(path: Path) -> bytes | None:
    """Return the content that `write` wrote to a file; None if the file is missing, damaged or not trusted."""
    try:
        state = path.lstat()
        reason = _foreign_access(path, state) if stat.S_ISREG(state.st_mode) else f'{path} is not a file'
        reason = reason or (f'{path} is too large' if state.st_size > _LARGEST else '')
        content = b'' if reason else path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        reason, content = f'{path}: {error.strerror}', b''
    checksum, content = content[:_CHECKSUM], content[_CHECKSUM:]
    if not reason and _checksum_of(content) != checksum:
        reason = f'{path} has a wrong checksum'
    if reason:
        report_damage(path.parent, reason)
        return None
    return content


def report_damage(folder: Path, reason: str) -> None:
    """Warn once that kept code cannot be used."""
    warn_once('damaged', f'The cache {folder} is damaged: {reason}. Its code is compiled again.')


def write(path: Path, content: bytes) -> None:
    """
    Write a file completely or not at all.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    temporary = path.with_name(f'{path.name}.{uuid.uuid4().hex[:16]}.tmp')
    try:
        with open(temporary, 'xb', opener=_open_for_user) as stream:
            stream.write(_checksum_of(content) + content)
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def _open_for_user(path: str, flags: int) -> int:
    """Open a new file to which only the user can write."""
    return os.open(path, flags, _MODE & 0o666)


def _checksum_of(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_CHECKSUM, 'big')
