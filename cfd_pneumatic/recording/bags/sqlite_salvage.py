# SPDX-License-Identifier: Apache-2.0
"""What can still be read of a sqlite3 file that was cut off or damaged."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.definitions import FORMATS

_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = 32
_MESSAGES = "FROM messages NOT INDEXED WHERE typeof(data) = 'blob'"


def flaw(file: Path) -> str | None:
    """
    Return what is wrong with a file, None if nothing is.

    Raises
    ------
    InputError
        If it computes what a bag stores.

    """
    with (
        closing(sqlite3.connect(f'{file.absolute().as_uri()}?mode=ro&immutable=1', uri=True)) as database,
        suppress(sqlite3.Error),
    ):
        _refuse_computed(database)
    with file.open('rb') as stream:
        header = stream.read(_SQLITE_HEADER)
    pages = int.from_bytes(header[28:32], 'big')
    cut = header.startswith(_SQLITE_MAGIC) and os.path.getsize(file) < pages * _page_size(header)
    return 'is cut off' if cut else None


def _refuse_computed(database: sqlite3.Connection) -> None:
    """Refuse views and generated columns in the place of a bag's tables: they have no end, or are of any size."""
    computed = database.execute(
        'SELECT tables.name FROM sqlite_master AS tables, pragma_table_xinfo(tables.name) AS columns '
        "WHERE tables.name IN ('messages', 'topics', 'schema', 'metadata', 'message_definitions') "
        "AND (tables.type != 'table' OR columns.hidden)"
    ).fetchone()
    if computed:
        raise InputError(f'is no bag: its {computed[0]} are not stored, but computed')


class SalvagedSqlite:
    """
    The messages of a sqlite3 file that can still be read, in the order of writing.

    Attributes
    ----------
    connections : list of Connection
        The topics, with the number of messages that can be read.
    start_time : int
        Time of the first message [ns].

    """

    def __init__(self, path: Path) -> None:
        self.start_time = 0
        self.connections: list[Connection] = []
        self._folder = tempfile.TemporaryDirectory()
        copy = Path(self._folder.name) / 'whole_pages.db3'
        _copy_whole_pages(path, copy)
        self._database = sqlite3.connect(copy)
        self._database.execute('PRAGMA writable_schema = ON')  # or SQLite refuses a file shorter than it should be
        with suppress(sqlite3.Error):
            _refuse_computed(self._database)
        self._scan()

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some topics in the order of writing: topic, time of reception [ns], payload."""
        wanted = {connection.id: connection for connection in connections}
        for topic, time, payload in self._rows(f'SELECT topic_id, timestamp, data {_MESSAGES}'):
            if topic in wanted:
                yield wanted[topic], time, payload

    def close(self) -> None:
        """Close the database."""
        self._database.close()
        self._folder.cleanup()

    def _scan(self) -> None:
        counts: dict[int, int] = {}
        for topic, time in self._rows(f'SELECT topic_id, timestamp {_MESSAGES}'):
            self.start_time = self.start_time or time
            counts[topic] = counts.get(topic, 0) + 1
        definitions = {
            name: MessageDefinition(FORMATS.get(encoding, MessageDefinitionFormat.NONE), text)
            for name, encoding, text in self._rows(
                'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
            )
        }
        none = MessageDefinition(MessageDefinitionFormat.NONE, '')
        self.connections = [
            Connection(
                id=topic,
                topic=name,
                msgtype=msgtype,
                msgdef=definitions.get(msgtype, none),
                digest='',
                msgcount=counts[topic],
                ext=ConnectionExtRosbag2(encoding, []),
                owner=self,
            )
            for topic, name, msgtype, encoding in self._rows('SELECT id, name, type, serialization_format FROM topics')
            if topic in counts and isinstance(name, str) and isinstance(msgtype, str)
        ]

    def _rows(self, query: str) -> Iterator[tuple]:  # type: ignore[type-arg]
        try:
            yield from self._database.execute(query)
        except sqlite3.Error:  # here the damage begins
            return


def _page_size(header: bytes) -> int:
    size = int.from_bytes(header[16:18], 'big')
    return 65_536 if size == 1 else size


def _copy_whole_pages(file: Path, copy: Path) -> None:
    """Copy a database without the page in which it was cut off: the half of a row would be read as numbers."""
    with file.open('rb') as stream:
        header = stream.read(_SQLITE_HEADER)
    size = _page_size(header)
    if size and header.startswith(_SQLITE_MAGIC):  # else there is nothing that SQLite would read
        shutil.copyfile(file, copy)
        os.truncate(copy, os.path.getsize(copy) // size * size)
