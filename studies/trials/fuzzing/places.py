# SPDX-License-Identifier: Apache-2.0
"""Try output paths with mounts, links, unusual rights, or runs of another user."""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import Random
from subprocess import DEVNULL, CalledProcessError, check_call
from tempfile import TemporaryDirectory

from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.untrusted_inputs import ResultFolders, folder_of

_FOREIGN_USER = 1234
_LIST = struct.pack('<I', 2) + b''.join(
    struct.pack('<HHi', *entry)
    for entry in ((0x01, 7, -1), (0x02, 5, _FOREIGN_USER), (0x04, 5, -1), (0x10, 5, -1), (0x20, 5, -1))
)
"""An access control list that lets another user read; the mode is that of a new folder."""

_LISTS = {'list': 'system.posix_acl_access', 'inherited list': 'system.posix_acl_default'}
_WRITABLE = ('nothing', 'nothing above', 'folder', 'link to a folder', 'mode', 'owner', *_LISTS)
_WITHOUT_FOLDER = ('nothing', 'nothing above', 'file', 'file above', 'pipe', 'link to nowhere')
_MOUNTS = ('disk', 'disk below a read-only folder', 'bound folder')
_REFUSED = (
    'file',
    'file above',
    'pipe',
    'link to nowhere',
    'other run',
    'read-only disk',
    'full disk',
    'read-only parent',
)


class ResultPlaces(ResultFolders):
    """Places of output folders; each must keep its kind and rights, with written or refused results."""

    name = 'places of results'

    def start(self, folder: Path) -> None:
        """Find the places that can be made on this machine."""
        super().start(folder)
        self._origin = folder
        self._places: list[str] = []
        for place in (*_WRITABLE, *_MOUNTS, *_REFUSED):
            with suppress(OSError, CalledProcessError), self._made(place, folder_of({})):
                self._places.append(place)

    def valid(self, rng: Random) -> Input:
        """Return a writable place and the entries of the folder."""
        places = [place for place in self._places if place not in _REFUSED]
        return _input_at(rng.choice(places), super().valid(rng), whole=True)

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a place, sometimes with changed entries of the folder."""
        entries = super().changed(parent, rng) if rng.random() < 0.5 else parent
        return _input_at(rng.choice(self._places), entries, whole=False)

    def give(self, case: Input) -> str:
        """Write results to the place."""
        place = case.files['place'].decode()
        with self._made(place, case):
            before = _state_of(self.folder)
            try:
                self.write(case)
            finally:
                if before is not None and _state_of(self.folder) != before:
                    raise Fault(f'{place}: kind or rights of the place have changed')
        return place

    @contextmanager
    def _made(self, place: str, case: Input) -> Iterator[None]:
        with TemporaryDirectory(dir=self._origin) as top, ExitStack() as ending:
            self.top = Path(top)
            self.folder = self.top / 'parent' / 'out'
            self.folder.parent.mkdir()
            self._make(place, case, ending)
            yield

    def _make(self, place: str, case: Input, ending: ExitStack) -> None:
        folder, self.real = self.folder, self.top / 'real'
        if place.startswith('file'):
            folder.write_text('mine', encoding='utf-8')
        elif place == 'pipe':
            os.mkfifo(folder)
        elif place.startswith('link'):
            folder.symlink_to(self.real)
            folder = self.real
        if place.endswith('above'):
            self.folder = folder / 'out'
        if place in _WITHOUT_FOLDER:
            return
        folder.mkdir()
        if place == 'disk below a read-only folder':
            _mount_read_only(folder.parent, ending)
        if 'disk' in place:
            _mount(folder, ending, '-t', 'tmpfs', '-o', 'size=64k', 'tmpfs')
        elif place == 'bound folder':
            self.real.mkdir()
            _mount(folder, ending, '--bind', str(self.real))
        self.fill(folder, case)
        if place == 'full disk':
            with suppress(OSError):
                (folder / 'ballast').write_bytes(bytes(2**17))
        elif place == 'read-only disk':
            check_call(['mount', '-o', 'remount,ro', str(folder)], stderr=DEVNULL)
        elif place == 'read-only parent':
            _mount_read_only(folder.parent, ending)
        elif place == 'other run':
            lock = os.open(folder, os.O_RDONLY)
            ending.callback(os.close, lock)
            fcntl.flock(lock, fcntl.LOCK_EX)
        elif place == 'mode':
            folder.chmod(0o2770)
        elif place == 'owner':
            os.chown(folder, _FOREIGN_USER, -1)
        elif place in _LISTS:
            os.setxattr(folder, _LISTS[place], _LIST)


def _mount(folder: Path, ending: ExitStack, *options: str) -> None:
    check_call(['mount', *options, str(folder)], stderr=DEVNULL)
    ending.callback(check_call, ['umount', '-l', str(folder)])


def _mount_read_only(folder: Path, ending: ExitStack) -> None:
    _mount(folder, ending, '--bind', str(folder))
    check_call(['mount', '-o', 'remount,bind,ro', str(folder)], stderr=DEVNULL)


def _state_of(path: Path) -> tuple[object, ...] | None:
    """Return kind, owner and rights of a path; None if the path does not exist."""
    if not os.path.lexists(path):
        return None
    status, names = path.lstat(), os.listxattr(path, follow_symlinks=False)
    lists = [os.getxattr(path, name) for name in _LISTS.values() if name in names]
    return status.st_mode, status.st_uid, status.st_gid, os.path.ismount(path), lists


def _input_at(place: str, entries: Input, *, whole: bool) -> Input:
    about = {} if place in _WITHOUT_FOLDER else entries.about
    return Input({**folder_of(about).files, 'place': place.encode()}, about, whole)


def kinds() -> list[Kind]:
    """Return the kinds of this module."""
    return [ResultPlaces()]
