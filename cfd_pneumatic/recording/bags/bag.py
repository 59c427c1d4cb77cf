# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and ROS 2: topics and messages from files of any supported format."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosbags.interfaces import Connection

from cfd_pneumatic.errors import DamageError, InputError
from cfd_pneumatic.files import check_input, open_input
from cfd_pneumatic.messages import NANOSECONDS, GroupingReader, MessageBlock, Serialization, Span
from cfd_pneumatic.recording.bags.compression import most_unpacked, unpack_file, unpacked, unpacker
from cfd_pneumatic.recording.bags.metadata import Metadata, read_metadata
from cfd_pneumatic.recording.bags.storages import (
    METADATA,
    ROS1_SUFFIX,
    STORAGES,
    SUFFIXES,
    Storage,
    StorageFile,
    remedy_of,
    storage_of,
)
from cfd_pneumatic.recording.message_texts import count_of, listed, reason_of

if TYPE_CHECKING:
    from typing_extensions import Self

_MAX_LISTED = 5
_SMALLEST = 16  # bytes of a message, with its time and topic
_ROS1_MAGIC = b'#ROSBAG V2.0\n'
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_ROS1_ENCODING = 'ros1'  # of messages in an mcap file


@dataclass(frozen=True)
class Topic:
    """
    A topic of a bag.

    Attributes
    ----------
    name, msgtype : str
        Name and message type of the topic.
    count : int
        Number of messages according to the files, limited by the size of the files.
    connections : tuple of Connection
        Connections of the topic, with the definition of its messages.

    """

    name: str
    msgtype: str
    count: int
    connections: tuple[Connection, ...]


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
        Topics by name, including topics without messages.
    serialization : Serialization
        Serialisation of the messages.
    notes : list of str
        Messages to the user on damage of the files.
    remarks : dict
        Texts in the metadata by key; `BagWriter.remark` writes them.

    Raises
    ------
    InputError
        If there is no bag, the bag has no messages, or no message can be read.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.remarks: dict[str, str] = {}
        self.serialization = Serialization.CDR
        self._stack = ExitStack()
        self._packed = False  # whether each message is compressed by itself
        self._size = 0  # of the bag's files [bytes]
        try:
            self._storages = self._open()
            self._set_serialization()
            self.topics = self._list_topics()
        except BaseException:
            self.close()
            raise

    def blocks(self, topics: Iterable[str]) -> Iterator[tuple[str, MessageBlock]]:
        """
        Yield the messages of given topics, file by file; each file's messages come in order of reception.

        Damaged messages are left out, with a note.

        Raises
        ------
        InputError
            If all messages are damaged, or the extent of the damage is unknown.

        """
        wanted = set(topics)
        read_count = missing = 0
        left_out: list[Span] = []
        for storage in self._storages:
            connections = [connection for connection in storage.connections if _full_name(connection) in wanted]
            if not connections:
                continue
            try:
                count_before = read_count
                for connection, block in storage.blocks(connections):
                    read_count += len(block)
                    yield _full_name(connection), _unpacked(block) if self._packed or self._is_packed(block) else block
                expected = sum(connection.msgcount for connection in connections)
                missing += max(0, expected - (read_count - count_before))
                left_out += storage.left_out
            except Exception as error:  # readers raise exceptions of any type for damaged files
                raise InputError(f'is damaged: {reason_of(error)}; {remedy_of(self.path)}') from error
        if (missing or left_out) and not read_count:
            raise InputError(f'is damaged and nothing can be salvaged; {remedy_of(self.path)}')
        if missing or left_out:
            losses = [count_of(missing, 'message')] if missing else []
            losses += [f'messages received {self._describe_spans(left_out)} after its start'] if left_out else []
            self.notes.append(f'{self.path.name} is damaged: left out {", ".join(losses)}')

    def _is_packed(self, block: MessageBlock) -> bool:
        """Return whether each message is compressed by itself, recognised by its first bytes without metadata."""
        is_cdr = self.serialization is Serialization.CDR
        return is_cdr and len(block) > 0 and block.payload(0).startswith(_ZSTD_MAGIC)

    def _describe_spans(self, spans: Sequence[Span]) -> str:
        """Return spans of time after the start of the bag as text, for a note."""
        begin = min(storage.start_time for storage in self._storages)

        def seconds(time: int) -> str:
            return f'{max(0, time - begin) / NANOSECONDS:.3f} s'

        times = [
            f'between {seconds(start)} and {seconds(stop)}' if stop else f'later than {seconds(start)}'
            for start, stop in spans[:_MAX_LISTED]
        ]
        if len(spans) > _MAX_LISTED:
            times.append(f'at {count_of(len(spans) - _MAX_LISTED, "other time")}')
        return ' and '.join(times)

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def __enter__(self) -> Self:
        """Return the bag."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the files."""
        self.close()

    def _open(self) -> list[StorageFile]:
        if not self.path.exists():
            raise InputError('does not exist: give the path of a recording')
        if self.path.is_dir():
            return self._open_folder()
        if self.path.suffix == ROS1_SUFFIX:
            self.serialization = Serialization.ROS1
            return [self._open_ros1()]
        storage = storage_of(self.path)
        if storage is not None:
            return [self._open_file(self.path, storage)]
        raise InputError(
            'is not a bag: give the folder of a ROS 2 bag, a .mcap, .db3 or ROS 1 .bag file, '
            'or a table together with its mapping file, `--mapping FILE`; `csv_to_bag --help` shows one'
        )

    def _set_serialization(self) -> None:
        """Set the serialisation to that of ROS 1 if an mcap file records this encoding for all messages."""
        encodings = {
            getattr(connection.ext, 'serialization_format', '')
            for storage in self._storages
            for connection in storage.connections
        }
        if _ROS1_ENCODING in encodings:
            if encodings != {_ROS1_ENCODING}:
                raise InputError('holds messages of ROS 1 and of ROS 2: split it')
            self.serialization = Serialization.ROS1

    def _open_folder(self) -> list[StorageFile]:
        visible = (file for file in self.path.iterdir() if not file.name.startswith('.'))
        files = sorted(file for file in visible if file.suffix in SUFFIXES)
        metadata = self._metadata(bool(files))
        if metadata is not None:
            self.remarks |= metadata.remarks
            self._packed = metadata.compression == 'message'
            if metadata.compression == 'file':
                return self._open_packed(metadata)
            return [self._open_file(file, STORAGES[metadata.storage]) for file in metadata.files]
        if not files:
            raise InputError(self._no_bag_message())
        if not self.notes and len({re.sub(r'_\d+$', '', file.stem) for file in files}) > 1:
            names = listed([file.name for file in files])
            raise InputError(f'holds several bags without {METADATA}: give one of {names}')
        storages = [self._open_file(file, storage) for file in files if (storage := storage_of(file))]
        return sorted(storages, key=lambda storage: storage.start_time)

    def _metadata(self, dispensable: bool) -> Metadata | None:
        """Return the bag's metadata; None, with a note, if they are unusable and dispensable."""
        path = self.path / METADATA
        if not path.exists():
            return None
        try:
            check_input(path)
        except InputError as error:
            raise InputError(f'{METADATA} {error}') from error
        try:
            return read_metadata(path)
        except InputError as error:
            if not dispensable:
                raise InputError(f'{METADATA} cannot be used: {error}') from error
            self.notes.append(f'{METADATA} was not used: {error}')
            return None

    def _open_packed(self, metadata: Metadata) -> list[StorageFile]:
        """Open files that are each compressed as a whole."""
        storages = []
        for file in metadata.files:
            target = Path(self._stack.enter_context(TemporaryDirectory())) / file.stem
            try:
                unpack_file(file, target)
            except InputError as error:
                raise InputError(f'{file.name} {error}') from error
            except Exception as error:  # decompressors raise exceptions of any type for damaged files
                raise InputError(f'{file.name} cannot be unpacked: {reason_of(error)}') from error
            storages.append(self._open_file(target, STORAGES[metadata.storage]))
        return storages

    def _no_bag_message(self) -> str:
        bags = sorted(file.parent.name for file in self.path.glob(f'*/{METADATA}'))
        bags += sorted(file.name for file in self.path.glob(f'*{ROS1_SUFFIX}'))
        if bags:
            return f'is a folder of bags: give one of {listed(bags)}'
        if any(self.path.glob('*.zstd')):
            return f'is compressed and has no {METADATA}: unpack its files with zstd -d'
        return f'holds no bag, neither {METADATA} nor .mcap or .db3 files'

    def _open_ros1(self) -> StorageFile:
        from rosbags.rosbag1.reader import Reader, decompressors  # needed for few bags only

        names = {function: name for name, function in decompressors.items()}
        try:
            with open_input(self.path) as file:
                if file.read(len(_ROS1_MAGIC)) not in (b'', _ROS1_MAGIC):  # rosbags would read up to a line end
                    raise InputError(f'is not a bag of ROS 1; {remedy_of(self.path)}')
            self._size = self.path.stat().st_size
            reader = Reader(self.path)
            reader.open()
            self._stack.callback(reader.close)
            counts: Counter[int] = Counter()  # of the chunks' summaries; a chunk's index may lead to fewer messages
            for chunk in reader.chunk_infos:
                counts.update(chunk.connection_counts)
            reader.connections = [
                connection._replace(msgcount=max(connection.msgcount, counts[connection.id]))
                for connection in reader.connections
            ]
            reader.chunks = {
                position: chunk._replace(decompressor=unpacker(names[chunk.decompressor]))
                for position, chunk in reader.chunks.items()
            }
            return GroupingReader(reader, reader.start_time)
        except InputError:
            raise
        except Exception as error:  # rosbags raises exceptions of any type for damaged files
            raise InputError(f'cannot be read: {reason_of(error)}; {remedy_of(self.path)}') from error

    def _open_file(self, file: Path, storage: Storage) -> StorageFile:
        """Open a storage file, even if it is damaged."""
        self._note_unmerged(file)
        try:
            check_input(file)
        except InputError as error:
            raise InputError(str(error) if file == self.path else f'{file.name} {error}') from error
        self._size += file.stat().st_size
        damage = storage.flaw(file)
        if damage is None:
            try:
                opened = storage.opened(file, self._stack)
                _check_names(opened.connections)
            except InputError:
                raise
            except Exception as error:  # readers raise exceptions of any type for damaged files
                damage = f'is damaged ({reason_of(error)})'
            else:
                if opened.strays > 0:
                    strays = count_of(opened.strays, 'message')
                    self.notes.append(f'{file.name} is damaged: {strays} of no topic left out')
                return opened
        salvaged = storage.salvaged(file, self._stack)
        count = sum(connection.msgcount for connection in salvaged.connections)
        if not count and file == self.path:
            raise InputError(f'{damage} and nothing can be salvaged; {remedy_of(file)}')
        self.notes.append(f'{file.name} {damage}: salvaged {count_of(count, "message")}')
        return salvaged

    def _note_unmerged(self, file: Path) -> None:
        """Add a note if a killed recorder has left messages in a log next to the database."""
        log = file.with_name(f'{file.name}-wal')
        if log.exists() and log.stat().st_size:
            self.notes.append(f'{log.name} is not read: open {file.name} once with sqlite3 to merge it')

    def _list_topics(self) -> dict[str, Topic]:
        by_name: dict[str, list[Connection]] = {}
        for storage in self._storages:
            for connection in storage.connections:
                connections = by_name.setdefault(_full_name(connection), [])
                if connections and connections[0].msgtype != connection.msgtype:
                    raise InputError(
                        f'topic {_full_name(connection)} has messages of {connections[0].msgtype} and of '
                        f'{connection.msgtype}: split the bag'
                    )
                connections.append(connection)
        most = most_unpacked(self._size) // _SMALLEST
        topics = {}
        for name, connections in by_name.items():
            count = min(most, sum(connection.msgcount for connection in connections))
            topics[name] = Topic(name, connections[0].msgtype, count, tuple(connections))
        if not any(topic.count for topic in topics.values()):
            notes = f' ({"; ".join(self.notes)})' if self.notes else ''
            raise InputError(f'holds no messages{notes}: was anything published while it was recorded?')
        return topics


def _unpacked(block: MessageBlock) -> MessageBlock:
    """Return a block with each payload decompressed."""
    return MessageBlock.from_payloads(
        block.times, [unpacked(block.payload(index), 'zstd') for index in range(len(block))]
    )


def _check_names(connections: Iterable[Connection]) -> None:
    """Refuse topics without a name or type, which a damaged SQLite table may contain."""
    for connection in connections:
        if not (isinstance(connection.topic, str) and isinstance(connection.msgtype, str)):
            raise DamageError('a topic has no name or no type')


def _full_name(connection: Connection) -> str:
    """Return a topic's name with a leading slash, which ROS 1 may omit."""
    return '/' + connection.topic.lstrip('/')
