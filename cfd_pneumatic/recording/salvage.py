"""What can still be read of a storage file that was cut off or damaged."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.reader import NonSeekingReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = 32
_MESSAGES = "FROM messages NOT INDEXED WHERE typeof(data) = 'blob'"

_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}


def is_cut_off(file: Path) -> bool:
    """Return whether a storage file lacks its end; rosbags may notice only while reading."""
    with file.open('rb') as stream:
        header = stream.read(_SQLITE_HEADER)
        if file.suffix == '.mcap':
            stream.seek(max(0, os.path.getsize(file) - len(_MCAP_MAGIC)))
            return header.startswith(_MCAP_MAGIC) and stream.read() != _MCAP_MAGIC
    pages = int.from_bytes(header[28:32], 'big')
    return header.startswith(_SQLITE_MAGIC) and os.path.getsize(file) < pages * _page_size(header)


class SalvagedMcap:
    """
    The messages of an mcap file up to where it is damaged.

    Attributes
    ----------
    connections : list of Connection
        The topics, with the number of messages that can be read.
    start_time : int
        Time of the first message [ns].

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.start_time = 0
        self.connections: list[Connection] = []
        self._scan()

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some topics in the order of the file: topic, time of reception [ns], payload."""
        wanted = {connection.id: connection for connection in connections}
        for channel, time, payload, _ in self._records():
            if channel in wanted:
                yield wanted[channel], time, payload

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    def _scan(self) -> None:
        counts: dict[int, int] = {}
        found: dict[int, Connection] = {}
        for channel, time, _, connection in self._records():
            self.start_time = self.start_time or time
            counts[channel] = counts.get(channel, 0) + 1
            found.setdefault(channel, connection)
        self.connections = [found[channel]._replace(msgcount=count) for channel, count in counts.items()]

    def _records(self) -> Iterator[tuple[int, int, bytes, Connection]]:
        known: dict[int, Connection] = {}
        with self.path.open('rb') as stream:
            try:
                for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    if channel.id not in known:
                        text = schema.data.decode() if schema else ''
                        kind = _FORMATS.get(schema.encoding if schema else '', MessageDefinitionFormat.NONE)
                        known[channel.id] = Connection(
                            channel.id,
                            channel.topic,
                            schema.name if schema else '',
                            MessageDefinition(kind, text),
                            '',
                            0,
                            ConnectionExtRosbag2(channel.message_encoding, []),
                            self,
                        )
                    yield channel.id, message.log_time, message.data, known[channel.id]
            except Exception:  # whatever damage makes the reader stumble over: here it ends
                return


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
            name: MessageDefinition(_FORMATS.get(encoding, MessageDefinitionFormat.NONE), text)
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
            if topic in counts
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
        size = _page_size(stream.read(_SQLITE_HEADER))
    shutil.copyfile(file, copy)
    if size:
        os.truncate(copy, os.path.getsize(copy) // size * size)
