# SPDX-License-Identifier: Apache-2.0
"""
Files of code that programs keep for their next start: machine code and compiled templates.

Such code runs with the rights of the user who starts a program. It is used only if nobody but this user and root can
write to its folder and its file. A checksum detects files that a power cut left empty or in part.
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
_LARGEST = 2**26  # of a file [bytes]; the model's have a thousandth of that
_ACCESS_LIST = 'system.posix_acl_access'
_MODE = 0o755  # of new folders; the user's umask may take away more

WARNED_FOLDER = 'CFD_PNEUMATIC_WARNED_FOLDER'
"""Environment variable: a folder in which processes that work together note of what they have warned."""

_warned: set[str] = set()


def warn_once(kind: str, message: str) -> None:
    """Log a warning, the first time that there is one of its kind. Programs print it on standard error."""
    if kind not in _warned:
        _warned.add(kind)
        if _is_first_of_all(kind):
            logging.getLogger(__name__).warning(printable(message))


def _is_first_of_all(kind: str) -> bool:
    """Return whether no other process noted in the common folder, if there is one, that it logs such a warning."""
    try:
        if WARNED_FOLDER in os.environ:
            Path(os.environ[WARNED_FOLDER], f'warned-{kind}').touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        pass
    return True


def has_warned(kind: str) -> bool:
    """Return whether there was a warning of a kind."""
    return kind in _warned


@cache
def is_trusted(folder: Path) -> bool:
    """
    Return whether only this user and root can write to a folder; warn once if others can.

    The folder above must be as safe, and nobody else may exchange one of those above it: its owner is this user or
    root, and others cannot write to it unless it is sticky. Of a `__pycache__` only the folder itself is examined: who
    can exchange it can also exchange the source code beside it.
    """
    try:
        reason = _distrust(folder.resolve())
    except OSError:
        return False
    if reason:
        warn_once(
            'untrusted',
            f'The cache {folder} is not used: {reason}, and its code would run with your rights. Take the permission '
            'away, delete the folder, or name another one in NUMBA_CACHE_DIR.',
        )
    return not reason


def _distrust(folder: Path) -> str:
    """Return who else can change what a folder holds, or ''."""
    above = [] if folder.name == '__pycache__' else list(folder.parents)
    for place in (folder, *above):
        state = place.stat()
        is_only_passed = place in above[1:] and state.st_mode & stat.S_ISVTX
        reason = _stranger(place, state, may_be_written=bool(is_only_passed))
        if reason:
            return reason
    return ''


def _stranger(path: Path, state: os.stat_result, may_be_written: bool = False) -> str:
    """Return who besides this user and root owns a file or folder, or can write to it; or ''."""
    if state.st_uid not in (0, os.geteuid()):
        return f'{path} belongs to another user'
    if may_be_written:
        return ''
    if state.st_mode & stat.S_IWOTH:
        return f'every user can write to {path}'
    if state.st_mode & stat.S_IWGRP and not _is_private(state.st_gid):
        return f'other users of its group can write to {path}'
    if state.st_mode & stat.S_IWGRP and _has_access_list(path):  # then the bit speaks for whoever is in it
        return f'an access control list may let others write to {path}'
    return ''


def _has_access_list(path: Path) -> bool:
    try:
        return _ACCESS_LIST in os.listxattr(path)
    except OSError:  # a file system without
        return False


def _is_private(group: int) -> bool:
    """Return whether a group is root's, or has the user's own name, and has no other member."""
    try:
        found, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return group == 0
    return (group == 0 or found.gr_name == user) and set(found.gr_mem) <= {user, 'root'}


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, to which only the user can write."""
    if not folder.is_dir():
        make_folder(folder.parent)
        folder.mkdir(_MODE, exist_ok=True)


def read(path: Path) -> bytes | None:
    """Return what `write` wrote to a file, or None if there is no such file, or if it is damaged."""
    try:
        state = path.lstat()
        reason = _stranger(path, state) if stat.S_ISREG(state.st_mode) else f'{path} is not a file'
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
    Write a file whole or not at all.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    aside = path.with_name(f'{path.name}.{uuid.uuid4().hex[:16]}.tmp')
    try:
        with open(aside, 'xb', opener=_open_for_user) as stream:
            stream.write(_checksum_of(content) + content)
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        os.replace(aside, path)
    except BaseException:
        with suppress(OSError):
            aside.unlink()
        raise


def _open_for_user(path: str, flags: int) -> int:
    """Open a new file to which only the user can write."""
    return os.open(path, flags, _MODE & 0o666)


def _checksum_of(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_CHECKSUM, 'big')
