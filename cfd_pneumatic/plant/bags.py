# SPDX-License-Identifier: Apache-2.0
"""The bags of a plant: those given, and those in the given folders at any depth."""

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
"""Suffixes of bags. Compressed files cannot be read alone; they are included so that the table reports them."""

TABLE_SUFFIXES = ('.csv', '.tsv', '.txt', '.dat')
"""Suffixes of tables, which are searched for if the mapping is for tables."""

_LONGEST = 60  # characters of a name; file systems allow 255, and a digest and suffixes follow


@dataclass(frozen=True)
class PlantBag:
    """
    A bag of a plant.

    Attributes
    ----------
    path
        Path of the bag, as the user gave it.
    device
        Device on which the bag was recorded: the name of the folder that contains the bag.
    folder
        Folder of the bag's results, relative to the folder of all results. No two bags share a folder.

    """

    path: Path
    device: str
    folder: Path


def find_bags(given: Sequence[Path], leave_out: Path, *, tables: bool = False) -> list[PlantBag]:
    """
    Return the given bags and the bags in the given folders, each once.

    The name of a device is the path from the given folder to the folder of its bags. If a bag is given itself or is
    directly in the given folder, the device has the name of the bag's folder. Equal names mean the same device.

    Parameters
    ----------
    given
        Bags, and folders to search at any depth. Hidden files and folders are ignored.
    leave_out
        Folder that is not searched: the folder of the results.
    tables
        Whether folders are searched for tables instead of bags.

    Raises
    ------
    InputError
        If there are no bags.

    """
    found: dict[Path, tuple[Path, str]] = {}
    for root in given:
        for path in _below(root, TABLE_SUFFIXES if tables else BAG_SUFFIXES, _identity(leave_out)):
            found.setdefault(path.resolve(), (path, _device_name(path, root)))
    if not found:
        kind = f'tables ({", ".join(TABLE_SUFFIXES)})' if tables else 'bags'
        raise InputError(f'{", ".join(map(str, given))}: no {kind} in there. Give {kind}, or folders that contain them')
    folders = _result_folders([(device, path) for path, device in found.values()])
    return [PlantBag(path, device, folder) for (path, device), folder in zip(found.values(), folders)]


def _below(path: Path, suffixes: tuple[str, ...], seen: set[tuple[int, int]]) -> Iterator[Path]:
    """
    Yield the bag at a path, or the bags below the path; unreadable folders are yielded too, so that they are reported.

    `seen` has the identities of searched folders, which are not searched again: links may form a loop.
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
            entries = sorted(path.iterdir(), reverse=True)
        except OSError:
            yield path
            continue
        waiting += [entry for entry in entries if _is_searched(entry, suffixes)]


def _identity(folder: Path) -> set[tuple[int, int]]:
    """Return the device and inode number of a folder, which do not depend on its path; empty if it is missing."""
    try:
        status = folder.stat()
    except OSError:
        return set()
    return {(status.st_dev, status.st_ino)}


def _is_searched(entry: Path, suffixes: tuple[str, ...]) -> bool:
    """Return whether an entry may be a bag or contain bags: it is neither hidden nor a result of an identification."""
    if entry.name.startswith('.') or (is_compare_file(entry) and (entry.parent / REPORT_FILE).is_file()):
        return False
    return entry.name.endswith(suffixes) or entry.is_dir()


def _is_bag(folder: Path) -> bool:
    """Return whether a folder is a bag: it has metadata, or the numbered files that rosbag2 names after the folder."""
    try:
        names = {entry.name for entry in folder.iterdir()}
    except OSError:
        return False
    storages = {name for name in names if name.endswith(SUFFIXES)}
    if METADATA in names or not storages:
        return METADATA in names
    stem = folder.resolve().name
    return storages in ({f'{stem}_{number}{suffix}' for number in range(len(storages))} for suffix in SUFFIXES)


def _device_name(path: Path, root: Path) -> str:
    folder, top = path.resolve().parent, root.resolve()
    if path == root or folder == top:
        return folder.name
    return folder.relative_to(top).as_posix() if folder.is_relative_to(top) else folder.name


def _result_folders(bags: Sequence[tuple[str, Path]]) -> list[Path]:
    """Return a folder for each bag, named after device and bag, with a digest if two bags would share a folder."""
    folders = [Path(_safe_name(device)) / _safe_name(_stem(path)) for device, path in bags]
    counts = Counter(str(folder).casefold() for folder in folders)
    return [
        folder if counts[str(folder).casefold()] == 1 else folder.with_name(f'{folder.name}-{_digest(path)}')
        for folder, (_, path) in zip(folders, bags)
    ]


def _stem(path: Path) -> str:
    """Return the name of a bag without the suffix of its format."""
    name = path.resolve().name
    suffix = next((known for known in sorted((*BAG_SUFFIXES, *TABLE_SUFFIXES), key=len) if name.endswith(known)), '')
    return name.removesuffix(suffix) or name


def _safe_name(name: str) -> str:
    """Return a name without characters that are special in a file system or a URL."""
    return re.sub(r'[^\w.-]+', '-', name).lstrip('.')[:_LONGEST] or '-'


def _digest(path: Path) -> str:
    return hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
