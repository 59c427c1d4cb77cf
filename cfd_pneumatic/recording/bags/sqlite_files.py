# SPDX-License-Identifier: Apache-2.0
"""Read a sqlite3 file, whole or damaged; write many messages at a time."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import open_input
from cfd_pneumatic.messages import FORMATS, NEVER, GroupingReader, MessageBlock

_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = 32
_STORED = "typeof(timestamp) = 'integer' AND typeof(data) = 'blob'"
_INSERT = 'INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)'
_ERRORS = sqlite3.Error, UnicodeDecodeError  # the second if SQLite's message quotes damaged text
_NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, '')


def flaw(file: Path) -> str | None:
    """
    Return a description of damage to a file; None if no damage is visible.

    Raises
    ------
    InputError
        If the file computes the data instead of storing them.

    """
    with open_input(file) as stream:
        header = stream.read(_SQLITE_HEADER)
        size = stream.seek(0, os.SEEK_END)
    if not header.startswith(_SQLITE_MAGIC):
        return 'is damaged (it does not begin as a database does)'
    with closing(_opened(file)) as database, suppress(*_ERRORS):
        _refuse_computed(database)
    pages = int.from_bytes(header[28:32], 'big')
    return 'is cut off' if size < pages * _page_size(header) else None


def open_sqlite(path: Path, stack: ExitStack) -> GroupingReader:
    """
    Return the messages of a whole file in the order of their times; a stack closes the file.

    Raises
    ------
    sqlite3.Error
        If the file is damaged.

    """
    return _reader(stack.enter_context(closing(_opened(path))), salvage=False)


def salvage_sqlite(path: Path, stack: ExitStack) -> GroupingReader:
    """Return the readable messages of a damaged file in the order of writing; a stack closes the file."""
    copy = Path(stack.enter_context(TemporaryDirectory())) / 'whole_pages.db3'
    _copy_whole_pages(path, copy)
    database = stack.enter_context(closing(sqlite3.connect(copy)))
    database.execute('PRAGMA writable_schema = ON')  # otherwise SQLite refuses a file that was cut off
    with suppress(*_ERRORS):
        _refuse_computed(database)
    return _reader(database, salvage=True)


def _opened(file: Path) -> sqlite3.Connection:
    """Open a database for reading, without the log that a killed recorder may leave next to the database."""
    return sqlite3.connect(f'{file.absolute().as_uri()}?mode=ro&immutable=1', uri=True)


def _refuse_computed(database: sqlite3.Connection) -> None:
    """Refuse views, virtual tables and generated columns in a bag's tables: their rows may be endless or huge."""
    computed = database.execute(
        'SELECT tables.name FROM sqlite_master AS tables, pragma_table_xinfo(tables.name) AS columns '
        "WHERE tables.name IN ('messages', 'topics', 'schema', 'metadata', 'message_definitions') "
        "AND (tables.type != 'table' OR tables.rootpage = 0 OR columns.hidden)"
    ).fetchone()
    if computed:
        raise InputError(f'is not a bag: {computed[0]} is an SQL view or has generated columns; export it as a table')


def _reader(database: sqlite3.Connection, *, salvage: bool) -> GroupingReader:
    """Return a reader of a database that yields blocks of messages."""
    messages = _DatabaseReader(database, salvage)
    return GroupingReader(messages, messages.start_time, strays=messages.strays)


class _DatabaseReader:
    """Reader of the messages and topics of a database, whole or damaged."""

    def __init__(self, database: sqlite3.Connection, salvage: bool) -> None:
        self._database = database
        self._salvage = salvage
        self.start_time, counts = self._count()
        topics = list(self._rows('SELECT id, name, type, serialization_format FROM topics'))
        definitions = self._definitions()
        self.connections = [
            Connection(
                id=number,
                topic=name,
                msgtype=msgtype,
                msgdef=definitions.get(msgtype, _NO_DEFINITION),
                digest='',
                msgcount=counts.pop(number, 0),
                ext=ConnectionExtRosbag2(encoding, []),
                owner=self,
            )
            for number, name, msgtype, encoding in topics
            if not salvage or (isinstance(name, str) and isinstance(msgtype, str))
        ]
        self.strays = sum(counts.values())

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of given topics: topic, time of reception [ns], payload."""
        wanted = {connection.id: connection for connection in connections}
        if self._salvage:
            query = f'SELECT topic_id, timestamp, data FROM messages NOT INDEXED WHERE {_STORED}'
        else:
            ids = ', '.join(str(int(number)) for number in wanted)
            query = (
                'SELECT topic_id, timestamp, data FROM messages '
                f'WHERE {_STORED} AND topic_id IN ({ids}) ORDER BY timestamp'
            )
        for number, time, payload in self._rows(query):
            if number in wanted:
                yield wanted[number], time, payload

    def _count(self) -> tuple[int, dict[int, int]]:
        """Return the time of the first message [ns], and the number of messages of each topic."""
        counts: dict[int, int] = {}
        if not self._salvage:
            start = NEVER
            query = 'SELECT topic_id, COUNT(*), MIN(timestamp) FROM messages GROUP BY topic_id'
            for number, count, time in self._rows(query):
                counts[number] = count
                start = min(start, time) if isinstance(time, int) else start
            return start, counts
        start = 0
        for number, time in self._rows(f'SELECT topic_id, timestamp FROM messages NOT INDEXED WHERE {_STORED}'):
            start = start or time
            counts[number] = counts.get(number, 0) + 1
        return start, counts

    def _definitions(self) -> dict[str, MessageDefinition]:
        """Return the definitions of messages by type; ROS 2 Humble and earlier versions store no definitions."""
        query = "SELECT name FROM sqlite_master WHERE name = 'message_definitions'"
        if not list(self._rows(query)):
            return {}
        return {
            name: MessageDefinition(FORMATS.get(encoding, MessageDefinitionFormat.NONE), text)
            for name, encoding, text in self._rows(
                'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions '
                "WHERE typeof(encoded_message_definition) = 'text' ORDER BY id DESC"  # the first row of a type wins
            )
        }

    def _rows(self, query: str) -> Iterator[tuple]:  # type: ignore[type-arg]
        try:
            yield from self._database.execute(query)
        except _ERRORS:  # the rows up to the damage are salvaged
            if not self._salvage:
                raise


def _page_size(header: bytes) -> int:
    size = int.from_bytes(header[16:18], 'big')
    return 65_536 if size == 1 else size


def _copy_whole_pages(file: Path, copy: Path) -> None:
    """Copy a database without an incomplete last page: SQLite would read half a row as numbers."""
    with open_input(file) as stream:
        header = stream.read(_SQLITE_HEADER)
        size = _page_size(header)
        if not size or not header.startswith(_SQLITE_MAGIC):  # SQLite cannot read such a file
            return
        stream.seek(0)
        with copy.open('wb') as target:
            shutil.copyfileobj(stream, target)
    os.truncate(copy, os.path.getsize(copy) // size * size)


class SqliteWriter(Sqlite3Writer):
    """Writer of a bag's sqlite3 file, with the interface of a storage for rosbags' `Writer`."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        """Begin the file, with the journal in memory: a journal file would be lost if the folder is moved."""
        try:
            super().__init__(path, compression)
            self.conn.execute('PRAGMA journal_mode = MEMORY')
        except sqlite3.Error:
            with suppress(AttributeError):  # the file could not be opened
                self.conn.close()
            raise

    def write_chunk(self, blocks: Sequence[tuple[Connection, MessageBlock]]) -> None:
        """Write messages of several topics, topic by topic."""
        for connection, block in blocks:
            payloads = (block.payload(index) for index in range(len(block)))
            self.cursor.executemany(_INSERT, zip([connection.id] * len(block), block.times.tolist(), payloads))
