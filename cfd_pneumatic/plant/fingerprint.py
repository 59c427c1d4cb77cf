# SPDX-License-Identifier: Apache-2.0
"""What a result follows from: while none of it changes, doing a bag again would give the same."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cfd_pneumatic
from cfd_pneumatic.identification import Options
from cfd_pneumatic.recording import ChannelMapping


@dataclass(frozen=True)
class Settings:
    """
    How every bag is read and identified.

    Attributes
    ----------
    options
        How to identify.
    mapping, namespace
        As `read_recording` takes them.

    """

    options: Options
    mapping: ChannelMapping | None = None
    namespace: str | None = None


def fingerprint(bag: Path, settings: Settings) -> str:
    """Return a digest of a bag's files, by name, size and time of change, of the settings and of this program."""
    return hashlib.sha256(repr((_files(bag), _content(settings), program())).encode()).hexdigest()


def _content(settings: Settings) -> tuple[object, ...]:
    """Return the settings without the name of the file that the mapping stands in."""
    mapping = settings.mapping
    meaning = None if mapping is None else (mapping.channels, mapping.table, mapping.types)
    return settings.options, meaning, settings.namespace


def _files(bag: Path) -> list[tuple[str, int, int]]:
    """Return name, size [bytes] and time of change [ns] of a bag's files; none where it can't be looked at."""
    try:
        paths = sorted(path for path in bag.rglob('*') if path.is_file()) if bag.is_dir() else [bag]
        states = [(path, path.stat()) for path in paths]
    except OSError:
        return []
    return [(path.relative_to(bag).as_posix(), state.st_size, state.st_mtime_ns) for path, state in states]


@cache
def program() -> str:
    """Return a digest of this package's code: its version alone may stay the same while people work on it."""
    digest = hashlib.sha256()
    package = Path(cfd_pneumatic.__file__).parent
    for path in sorted(package.rglob('*')):
        if path.is_file() and '__pycache__' not in path.parts:
            digest.update(f'{path.relative_to(package).as_posix()}\0'.encode() + path.read_bytes())
    return digest.hexdigest()
