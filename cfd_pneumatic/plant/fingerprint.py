# SPDX-License-Identifier: Apache-2.0
"""Fingerprint of all that determines a bag's results: an unchanged fingerprint means unchanged results."""

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
    Settings for reading and identifying every bag.

    Attributes
    ----------
    options
        Options of the identification.
    mapping, namespace
        Arguments of `read_recording`.

    """

    options: Options
    mapping: ChannelMapping | None = None
    namespace: str | None = None


def fingerprint(bag: Path, settings: Settings) -> str:
    """Return a digest of the name, size and modification time of a bag's files, the settings and this program."""
    return hashlib.sha256(repr((_file_states(bag), _settings_content(settings), program_digest())).encode()).hexdigest()


def _settings_content(settings: Settings) -> tuple[object, ...]:
    """Return the settings without the name of the mapping file."""
    mapping = settings.mapping
    mapping_content = None if mapping is None else (mapping.channels, mapping.table, mapping.types)
    return settings.options, mapping_content, settings.namespace


def _file_states(bag: Path) -> list[tuple[str, int, int]]:
    """Return name, size [bytes] and modification time [ns] of a bag's files; empty if the bag is not accessible."""
    try:
        paths = sorted(path for path in bag.rglob('*') if path.is_file()) if bag.is_dir() else [bag]
        states = [(path, path.stat()) for path in paths]
    except OSError:
        return []
    return [(path.relative_to(bag).as_posix(), state.st_size, state.st_mtime_ns) for path, state in states]


@cache
def program_digest() -> str:
    """Return a digest of this package's code, because the version does not change with each change of the code."""
    digest = hashlib.sha256()
    package = Path(cfd_pneumatic.__file__).parent
    for path in sorted(package.rglob('*')):
        if path.is_file() and '__pycache__' not in path.parts:
            digest.update(f'{path.relative_to(package).as_posix()}\0'.encode() + path.read_bytes())
    return digest.hexdigest()
