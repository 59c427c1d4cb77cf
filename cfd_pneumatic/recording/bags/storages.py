# SPDX-License-Identifier: Apache-2.0
"""Formats of a bag's files: how each is read, repaired and written. A further format is a row of `STORAGES`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from rosbags.interfaces import Connection

from cfd_pneumatic.messages import MessageBlock, Span
from cfd_pneumatic.recording.bags.mcap_pieces import flaw as mcap_flaw
from cfd_pneumatic.recording.bags.mcap_reading import McapFile
from cfd_pneumatic.recording.bags.mcap_writing import McapWriter
from cfd_pneumatic.recording.bags.sqlite_files import SqliteWriter, open_sqlite, salvage_sqlite
from cfd_pneumatic.recording.bags.sqlite_files import flaw as sqlite_flaw

StorageName = Literal['mcap', 'sqlite3']
StorageWriter = McapWriter | SqliteWriter


class StorageFile(Protocol):
    """A file of a bag, open for reading."""

    @property
    def connections(self) -> list[Connection]:
        """The topics."""

    @property
    def start_time(self) -> int:
        """Time of the first message [ns]."""

    @property
    def left_out(self) -> list[Span]:
        """Times of damaged messages that were left out."""

    @property
    def strays(self) -> int:
        """Number of messages that belong to no topic."""

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """Yield the messages of given topics."""


@dataclass(frozen=True)
class Storage:
    """
    A format of a bag's files.

    Attributes
    ----------
    suffix : str
        Suffix of the files.
    remedy : str
        Advice on repairing a damaged file.
    flaw : callable
        Returns a description of damage that is visible without reading the whole file; None if there is none.
    opened : callable
        Opens a whole file; raises any exception for a damaged file. A stack closes the file.
    salvaged : callable
        Opens a damaged file for its readable messages. A stack closes the file.
    writer : type
        Class that writes a file.

    """

    suffix: str
    remedy: str
    flaw: Callable[[Path], str | None]
    opened: Callable[[Path, ExitStack], StorageFile]
    salvaged: Callable[[Path, ExitStack], StorageFile]
    writer: type[McapWriter] | type[SqliteWriter]


STORAGES: Mapping[StorageName, Storage] = {
    'mcap': Storage(
        '.mcap',
        'mcap recover may mend it',
        mcap_flaw,
        lambda path, _: McapFile(path),
        lambda path, _: McapFile(path),
        McapWriter,
    ),
    'sqlite3': Storage('.db3', 'sqlite3 .recover may mend it', sqlite_flaw, open_sqlite, salvage_sqlite, SqliteWriter),
}
"""Formats by the names of rosbag2."""

SUFFIXES = tuple(storage.suffix for storage in STORAGES.values())
"""Suffixes of the files of ROS 2."""

ROS1_SUFFIX = '.bag'
ROS1_REMEDY = 'rosbag reindex may mend it'
METADATA = 'metadata.yaml'


def storage_of(path: Path) -> Storage | None:
    """Return the format of a file by its name; None for a folder and for a file of ROS 1."""
    return next((storage for storage in STORAGES.values() if path.suffix == storage.suffix), None)


def remedy_of(path: Path) -> str:
    """Return advice on repairing a damaged file or folder of a bag."""
    if path.suffix == ROS1_SUFFIX and not path.is_dir():
        return ROS1_REMEDY
    return (storage_of(path) or STORAGES['mcap']).remedy
