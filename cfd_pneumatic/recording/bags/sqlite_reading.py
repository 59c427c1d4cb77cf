"""Reading a sqlite3 file row by row."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from cfd_pneumatic.recording.bags.blocks import MessageBlock, Span, by_topic, put_together


@dataclass(frozen=True)
class SqliteRows:
    """
    A sqlite3 file that rosbags has opened.

    Attributes
    ----------
    database
        Its connection to SQLite.
    connections : list of Connection
        Its topics.
    start_time : int
        Time of the first message [ns].
    left_out : list of Span
        Times of which messages were left out; it isn't known here.

    """

    database: Any
    connections: list[Connection]
    start_time: int
    left_out: list[Span] = field(default_factory=list)

    def blocks(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, MessageBlock]]:
        """Yield the messages of some topics, for each in the order of reception."""
        wanted = ', '.join(str(connection.id) for connection in connections)
        rows = self.database.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({wanted}) ORDER BY timestamp'
        )
        for ids, block in put_together(rows):
            yield from by_topic(block, np.array(ids), connections)
