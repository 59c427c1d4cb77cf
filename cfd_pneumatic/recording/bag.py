"""Bags of ROS 1 and ROS 2: their topics and their messages, from whatever files they consist of."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.layout import Serialization
from cfd_pneumatic.recording.salvage import SalvagedMcap, SalvagedSqlite, is_cut_off
from cfd_pneumatic.recording.wording import counted, reason_of

if TYPE_CHECKING:
    from typing_extensions import Self

STORAGE_SUFFIXES = ('.mcap', '.db3')
METADATA = 'metadata.yaml'
ROS1_SUFFIX = '.bag'


class Storage(Protocol):
    """One file of a bag, or a folder with its metadata: rosbags' readers and ours for damaged files."""

    @property
    def connections(self) -> list[Connection]:
        """The topics."""

    @property
    def start_time(self) -> int:
        """Time of the first message [ns]."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some topics: topic, time of reception [ns], payload."""

    def close(self) -> None:
        """Close the file."""


@dataclass(frozen=True)
class Topic:
    """
    A topic of a bag.

    Attributes
    ----------
    name, msgtype : str
        Its name and message type.
    count : int
        Number of messages.
    connection : Connection
        One of its connections, for the definition of its messages.

    """

    name: str
    msgtype: str
    count: int
    connection: Connection


class Bag:
    """
    A bag, open for reading.

    Parameters
    ----------
    path : Path
        A folder, .mcap, .db3 or .bag file.

    Attributes
    ----------
    topics : dict
        The topics by name, those without messages too.
    serialization : Serialization
        How the messages are serialised.
    notes : list of str
        What was amiss with the files, for people.

    Raises
    ------
    InputError
        If there is no bag, it holds no messages, or nothing of it can be read.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.serialization = Serialization.ROS1 if path.suffix == ROS1_SUFFIX else Serialization.CDR
        self._stack = ExitStack()
        try:
            self._storages = sorted(self._open(), key=lambda storage: storage.start_time)
            self.topics = self._list_topics()
        except BaseException:
            self.close()
            raise

    def messages(self, topics: Iterable[str]) -> Iterator[tuple[str, int, bytes]]:
        """
        Yield the messages of some topics: topic, time of reception [ns], payload.

        Raises
        ------
        InputError
            If the bag turns out damaged.

        """
        wanted = set(topics)
        for storage in self._storages:
            connections = [connection for connection in storage.connections if _full_name(connection) in wanted]
            names = {connection.id: _full_name(connection) for connection in connections}
            if not connections:
                continue
            try:
                for connection, time, payload in storage.messages(connections):
                    yield names[connection.id], time, payload
            except Exception as error:  # rosbags raises whatever damage makes it stumble over
                raise InputError(f'is damaged: {reason_of(error)}; {_remedy(self.path)}') from error

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def __enter__(self) -> Self:
        """Return the bag."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the files."""
        self.close()

    def _open(self) -> list[Storage]:
        if not self.path.exists():
            raise InputError('does not exist: give the path of a recording')
        if self.path.is_dir():
            return self._open_folder()
        if self.path.suffix == ROS1_SUFFIX:
            return [self._open_whole()]
        if self.path.suffix in STORAGE_SUFFIXES:
            return [self._open_file(self.path)]
        raise InputError(
            'is not a bag: give the folder of a ROS 2 bag, a .mcap, .db3 or ROS 1 .bag file, '
            'or a table together with its mapping file'
        )

    def _open_folder(self) -> list[Storage]:
        files = sorted(file for file in self.path.iterdir() if file.suffix in STORAGE_SUFFIXES)
        if (self.path / METADATA).exists():
            try:
                if not any(map(is_cut_off, files)):
                    reader = self._enter(Ros2Reader(self.path))
                    for file in files:
                        self._note_unmerged(file)
                    return [reader]
            except Exception as error:  # rosbags raises whatever damage makes it stumble over
                if not files:
                    raise InputError(f'cannot be read: {reason_of(error)}') from error
                self.notes.append(f'{METADATA} was not used: {reason_of(error)}')
        elif not files:
            raise InputError(self._no_bag_here())
        elif len({re.sub(r'_\d+$', '', file.stem) for file in files}) > 1:
            raise InputError(f'holds several bags without {METADATA}: give one of {", ".join(f.name for f in files)}')
        return [self._open_file(file) for file in files]

    def _no_bag_here(self) -> str:
        inside = sorted(file.parent.name for file in self.path.glob(f'*/{METADATA}'))
        inside += sorted(file.name for file in self.path.glob(f'*{ROS1_SUFFIX}'))
        if inside:
            return f'is a folder of bags: give one of {", ".join(inside)}'
        if any(self.path.glob('*.zstd')):
            return f'is compressed and has no {METADATA}: unpack its files with zstd -d'
        return f'holds no bag, neither {METADATA} nor .mcap or .db3 files'

    def _open_whole(self) -> Storage:
        try:
            return self._enter(Ros1Reader(self.path))
        except Exception as error:  # rosbags raises whatever damage makes it stumble over
            raise InputError(f'cannot be read: {reason_of(error)}; {_remedy(self.path)}') from error

    def _open_file(self, file: Path) -> Storage:
        """Open one storage file, damaged or not."""
        self._note_unmerged(file)
        try:
            if not is_cut_off(file):
                return self._enter(Ros2Reader(file))
            damage = 'is cut off'
        except PermissionError as error:
            raise InputError(f'{file.name} cannot be read: {error.strerror}') from error
        except Exception as error:  # rosbags raises whatever damage makes it stumble over
            damage = f'is damaged ({reason_of(error)})'
        storage = SalvagedMcap(file) if file.suffix == '.mcap' else SalvagedSqlite(file)
        self._stack.callback(storage.close)
        count = sum(connection.msgcount for connection in storage.connections)
        if not count and file == self.path:
            raise InputError(f'{damage} and nothing can be salvaged; {_remedy(file)}')
        self.notes.append(f'{file.name} {damage}: salvaged {counted(count, "message")}')
        return storage

    def _note_unmerged(self, file: Path) -> None:
        """Note what a recorder that was killed had not moved into a database yet."""
        log = file.with_name(f'{file.name}-wal')
        if log.exists() and log.stat().st_size:
            self.notes.append(f'{log.name} is not read: open {file.name} once with sqlite3 to merge it')

    def _enter(self, reader: Ros1Reader | Ros2Reader) -> Storage:
        reader.open()
        self._stack.callback(reader.close)
        return reader

    def _list_topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for storage in self._storages:
            for connection in storage.connections:
                name = _full_name(connection)
                seen = topics.get(name)
                if seen is not None and seen.msgtype != connection.msgtype:
                    raise InputError(
                        f'topic {name} has messages of {seen.msgtype} and of {connection.msgtype}: split the bag'
                    )
                count = connection.msgcount + (seen.count if seen else 0)
                topics[name] = Topic(name, connection.msgtype, count, connection)
        if not any(topic.count for topic in topics.values()):
            notes = f' ({"; ".join(self.notes)})' if self.notes else ''
            raise InputError(f'holds no messages{notes}: was anything published while it was recorded?')
        return topics


def _full_name(connection: Connection) -> str:
    """Return a topic's name with the leading slash that ROS 1 may leave out."""
    return '/' + connection.topic.lstrip('/')


def _remedy(path: Path) -> str:
    if path.suffix == '.db3':
        return 'sqlite3 .recover may mend it'
    if path.suffix == ROS1_SUFFIX:
        return 'rosbag reindex may mend it'
    return 'mcap recover may mend it'
