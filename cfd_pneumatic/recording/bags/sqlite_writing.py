# SPDX-License-Identifier: Apache-2.0
"""Writing a sqlite3 file many messages at a time."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from cfd_pneumatic.messages import MessageBlock

_INSERT = 'INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)'


class SqliteWriter(Sqlite3Writer):
    """A sqlite3 file of a bag that is written, as rosbags' `Writer` takes a storage."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        """Begin the file; without a journal next to it, whose name would be wrong once somebody moves the folder."""
        try:
            super().__init__(path, compression)
            self.conn.execute('PRAGMA journal_mode = MEMORY')
        except sqlite3.Error:
            with suppress(AttributeError):  # the file could not be opened
                self.conn.close()
            raise

    def write_chunk(self, blocks: Sequence[tuple[Connection, MessageBlock]]) -> None:
        """Write messages of several topics, each topic's together."""
        for connection, block in blocks:
            payloads = (block.payload(index) for index in range(len(block)))
            self.cursor.executemany(_INSERT, zip([connection.id] * len(block), block.times.tolist(), payloads))
