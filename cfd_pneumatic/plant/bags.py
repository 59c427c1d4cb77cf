# SPDX-License-Identifier: Apache-2.0
"""Which bags are meant: those given, and those in the folders given, at any depth."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import METADATA, ROS1_SUFFIX, SUFFIXES
from cfd_pneumatic.reporting import REPORT_FILE, is_compare_file

BAG_SUFFIXES = (*SUFFIXES, ROS1_SUFFIX, *(f'{suffix}.zstd' for suffix in SUFFIXES))
"""Files that are bags; compressed ones too, which can't be read alone: none shall be left out silently."""

TABLE_SUFFIXES = ('.csv', '.tsv', '.txt', '.dat')
"""Files that are tables, where a mapping says that tables are meant."""

_LONGEST = 60  # characters of a name, so that there is room for more in what a file system takes


@dataclass(frozen=True)
class PlantBag:
    """
    One bag of a plant.

    Attributes
    ----------
    path
        Where it is, as people gave it.
    device
        What it was recorded on: the folder in which it lies.
    folder
        Where its results go, below the folder of all results; no two bags share one.

    """

    path: Path
    device: str
    folder: Path


def find_bags(given: Sequence[Path], leave_out: Path, *, tables: bool = False) -> list[PlantBag]:
    """
    Return the bags that are meant, each once.

    A device is named by the way from the folder given down to the one in which its bags lie, or by the folder's own
    name where they lie directly in the one given or are given themselves. The same name is the same device.

    Parameters
    ----------
    given
        Bags, and folders to search at any depth. What has a hidden name is not searched for.
    leave_out
        Folder that is not searched: the results are in it.
    tables
        Whether folders are searched for tables instead of bags.

    Raises
    ------
    InputError
        If there is none.

    """
    found: dict[Path, tuple[Path, str]] = {}
    for root in given:
        for path in _below(root, TABLE_SUFFIXES if tables else BAG_SUFFIXES, _identity(leave_out)):
            found.setdefault(path.resolve(), (path, _device(path, root)))
    if not found:
        what = f'tables ({", ".join(TABLE_SUFFIXES)})' if tables else 'bags'
        raise InputError(f'{", ".join(map(str, given))}: no {what} in there; give bags, or folders that hold some')
    folders = _folders([(device, path) for path, device in found.values()])
    return [PlantBag(path, device, folder) for (path, device), folder in zip(found.values(), folders)]


def _below(path: Path, suffixes: tuple[str, ...], seen: set[tuple[int, int]]) -> Iterator[Path]:
    """
    Yield the bag that a path is, or those below it; a folder that can't be read is yielded too, and will fail.

    No folder is searched twice: links may lead back up, and by so many ways to one folder that there is no end.
    """
    waiting = [path]
    while waiting:
        path = waiting.pop()
        if not path.is_dir() or _is_bag(path):
            yield path
            continue
        identity = _identity(path)
        if identity <= seen:
            continue
        seen |= identity
        try:
            inside = sorted(path.iterdir(), reverse=True)
        except OSError:
            yield path
            continue
        waiting += [entry for entry in inside if _is_meant(entry, suffixes)]


def _identity(folder: Path) -> set[tuple[int, int]]:
    """Return by what a folder is known, whatever way leads to it; nothing where it is not there."""
    try:
        state = folder.stat()
    except OSError:
        return set()
    return {(state.st_dev, state.st_ino)}


def _is_meant(entry: Path, suffixes: tuple[str, ...]) -> bool:
    """Return whether something is to be searched or a bag: it isn't hidden, and did not come of an identification."""
    if entry.name.startswith('.') or (is_compare_file(entry) and (entry.parent / REPORT_FILE).is_file()):
        return False
    return entry.name.endswith(suffixes) or entry.is_dir()


def _is_bag(folder: Path) -> bool:
    """Return whether a folder is one bag: it has metadata, or the files that rosbag2 names after it, from 0 on."""
    try:
        names = {entry.name for entry in folder.iterdir()}
    except OSError:
        return False
    storages = {name for name in names if name.endswith(SUFFIXES)}
    if METADATA in names or not storages:
        return METADATA in names
    stem = folder.resolve().name
    return storages in ({f'{stem}_{number}{suffix}' for number in range(len(storages))} for suffix in SUFFIXES)


def _device(path: Path, root: Path) -> str:
    folder, top = path.resolve().parent, root.resolve()
    if path == root or folder == top:
        return folder.name
    return folder.relative_to(top).as_posix() if folder.is_relative_to(top) else folder.name


def _folders(bags: Sequence[tuple[str, Path]]) -> list[Path]:
    """Return a folder for each bag, named after its device and itself; where two would share one, with a digest."""
    plain = [Path(_safe(device)) / _safe(_stem(path)) for device, path in bags]
    shared = Counter(str(folder).casefold() for folder in plain)
    return [
        folder if shared[str(folder).casefold()] == 1 else folder.with_name(f'{folder.name}-{_digest(path)}')
        for folder, (_, path) in zip(plain, bags)
    ]


def _stem(path: Path) -> str:
    """Return a bag's name without what says its format."""
    name = path.resolve().name
    suffix = next((one for one in sorted((*BAG_SUFFIXES, *TABLE_SUFFIXES), key=len) if name.endswith(one)), '')
    return name.removesuffix(suffix) or name


def _safe(name: str) -> str:
    """Return a name with nothing in it that a file system or an address could trip over."""
    return re.sub(r'[^\w.-]+', '-', name).lstrip('.')[:_LONGEST] or '-'


def _digest(path: Path) -> str:
    return hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
