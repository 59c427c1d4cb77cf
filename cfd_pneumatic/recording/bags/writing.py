# SPDX-License-Identifier: Apache-2.0
"""Write bags completely or not at all."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ADVICE, StagedOutput, check_folder, disk_errors_reported, folder_entries
from cfd_pneumatic.messages import Form, MessageBlock, join, types_with
from cfd_pneumatic.recording.bags.storages import METADATA, STORAGES, SUFFIXES, StorageName, StorageWriter

if TYPE_CHECKING:
    from typing_extensions import Self

_BAG_VERSION: Literal[8] = 8
"""Bag version that Humble's rosbag2 also reads."""

_CHUNK = 2**21  # bytes of payload in a chunk
_PORTION = 5_000  # samples of a topic in a portion


class BagWriter:
    """
    Writer of a ROS 2 bag in a staging folder, which moves into place when the bag is complete.

    As a context manager the writer closes the bag at the end, or deletes it after an error.

    Parameters
    ----------
    path : Path or str
        Folder of the bag; may be missing or empty.
    storage : str
        `mcap` or `sqlite3`.
    overwrite : bool
        Whether to replace an existing bag. Other files are never replaced.

    Raises
    ------
    InputError
        If the path exists already or cannot be written.

    """

    def __init__(self, path: Path | str, *, storage: StorageName = 'mcap', overwrite: bool = False) -> None:
        self.path = self._requested_path = Path(path)
        self._connections: dict[str, Connection] = {}
        self._pending: list[tuple[Connection, MessageBlock]] = []
        self._size = 0  # of the pending messages [bytes]
        self._overwrite = overwrite
        self._is_moved = False
        _check_free(self.path, overwrite=overwrite)
        with self._reported():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._output = StagedOutput(self.path, exclusive=True)
            self._writer = Writer(
                self._output.staged, version=_BAG_VERSION, storage_plugin=StoragePlugin[storage.upper()]
            )
            self._writer.STORAGE_PLUGINS = {StoragePlugin[storage.upper()]: STORAGES[storage].writer}
            try:
                self._writer.open()
            except BaseException:
                self._output.close()
                raise

    def add_topic(self, topic: str, msgtype: str) -> None:
        """
        Announce a topic; needed before its first message.

        Raises
        ------
        InputError
            If ROS 2 has no such message type.

        """
        types = types_with(msgtype)
        if msgtype not in types.fielddefs:
            raise InputError(f'topic {topic} cannot be recorded: its type {msgtype} is not one that ROS 2 ships')
        with self._reported():
            self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=types)

    def write(self, topic: str, block: MessageBlock) -> None:
        """
        Write serialised (CDR) messages on an announced topic.

        The messages are pending until a chunk is full; `flush` writes the pending messages.
        """
        self._pending.append((self._connections[topic], block))
        self._size += len(block.data)
        if self._size > _CHUNK:
            self.flush()

    def flush(self) -> None:
        """Write the pending messages in order of reception."""
        by_topic: dict[int, list[MessageBlock]] = {}
        connections = {connection.id: connection for connection, _ in self._pending}
        for connection, block in self._pending:
            by_topic.setdefault(connection.id, []).append(block)
        self._pending, self._size = [], 0
        blocks = [(connections[number], join(topic_blocks)) for number, topic_blocks in by_topic.items()]
        blocks = [(connection, block) for connection, block in blocks if len(block)]
        if not blocks:
            return
        with self._reported():
            cast(StorageWriter, self._writer.storage).write_chunk(blocks)
        for connection, block in blocks:
            self._writer.counts[connection.id] += len(block)
            self._writer.min_timestamp = min(self._writer.min_timestamp, int(block.times.min()))
            self._writer.max_timestamp = max(self._writer.max_timestamp, int(block.times.max()))

    def write_streams(self, streams: Sequence[Stream]) -> None:
        """Announce the topics of streams and write their messages by time; equal times keep the streams' order."""
        for stream in streams:
            self.add_topic(stream.topic, stream.form.msgtype)
        for portion in _portions(streams):
            for stream, samples in zip(streams, portion):
                self.write(stream.topic, stream.form.block(stream.times[samples], stream.values[samples]))
            self.flush()

    def remark(self, key: str, text: str) -> None:
        """Write a text into the bag's metadata."""
        self._writer.set_custom_data(key, text)

    def relocate(self) -> bool:
        """
        Find the bag after a move of its folder; return whether there was a move.

        Raises
        ------
        InputError
            If the folder cannot be reached any more.

        """
        if not self._output.relocate():
            return False
        self.path = self._output.path
        self._is_moved = self._requested_path.resolve() != self.path
        self._writer.metapath = self._output.staged / METADATA
        return True

    def check_place(self) -> None:
        """
        Check that the closed bag is at the requested path.

        Raises
        ------
        InputError
            If the folder was moved during the recording.

        """
        if self._is_moved:
            raise InputError(
                'the folder of the bag was moved while the bag was written. '
                f'The bag is complete, but not at {self._requested_path}: move or use {self.path}'
            )

    def close(self) -> None:
        """Complete the bag and move it into place, or to a numbered path if its place is taken."""
        self.flush()
        with self._reported():
            self.relocate()
            self._writer.close()
            if not self._overwrite:
                self._find_free_place()
            self._output.move_into_place(_is_of_bag, _metadata_last)
        self._output.close()

    def keep_incomplete(self) -> None:
        """Move a bag that cannot be completed into place as it is; readers see a bag that was cut off."""
        with suppress(Exception):
            self._writer.abort()
        with self._reported():
            self.relocate()
            self._find_free_place()
            self._output.move_into_place(write_through=False)
        self._output.close()

    def abort(self) -> None:
        """Delete the written files."""
        with suppress(Exception):
            self._writer.abort()
        self._output.close()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the bag, or delete it after an error."""
        if kind is not None:
            self.abort()
            return
        try:
            self.close()
        except BaseException:
            self.abort()
            raise
        self.check_place()

    def _find_free_place(self) -> None:
        """Choose a path with a number if the path of the bag is taken."""
        path, parent = self._output.path, self._output.parent
        if os.path.lexists(path) and not _is_empty(path):
            numbered = (parent / f'{path.name}_{number}' for number in count(2))
            self.path = self._output.path = next(free for free in numbered if not os.path.lexists(free))

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Convert errors of the disk or the database into an error for the user."""
        try:
            with disk_errors_reported(self.path):
                yield
        except sqlite3.Error as error:
            advice = (
                'make room, or choose another folder'
                if 'full' in str(error)
                else 'choose a folder that you may write to'
            )
            raise InputError(f'cannot write {self.path}: {error}; {advice}') from error


def check_bag(path: Path, *, overwrite: bool) -> None:
    """
    Check before the work that a bag can be written; leave no file behind.

    Parameters
    ----------
    path, overwrite
        See `BagWriter`.

    Raises
    ------
    InputError
        If the path exists already or cannot be written.

    """
    _check_free(path, overwrite=overwrite)
    check_folder(path, exclusive=True)


def _check_free(path: Path, *, overwrite: bool) -> None:
    if path.parent.exists() and not path.parent.is_dir():
        raise InputError(f'cannot write {path}: {path.parent} is not a folder')
    if path.is_symlink():
        raise InputError(
            f'{path} is a symbolic link, and a bag is not written through a link: give the target of the link'
        )
    with disk_errors_reported(path):
        if not path.exists() or _is_empty(path):
            return
        if not overwrite:
            raise InputError(f'{path} exists already: choose another name, or {ADVICE}')
        if not (path / METADATA).is_file():
            raise InputError(f'{path} is not a bag and is not overwritten: choose another name')
        for entry in folder_entries(path):
            if not _is_of_bag(entry):
                raise InputError(
                    f'{path} holds {entry.name} in addition to a bag and is not overwritten: move {entry.name}'
                )


def _is_empty(path: Path) -> bool:
    return path.is_dir() and not folder_entries(path)


def _is_of_bag(path: Path) -> bool:
    return path.is_file() and (path.name == METADATA or any(suffix in path.name for suffix in SUFFIXES))


def _metadata_last(name: str) -> int:
    return int(name == METADATA)


@dataclass(frozen=True)
class Stream:
    """Data for a topic: numbers at increasing times [ns], and the form of the messages."""

    topic: str
    form: Form
    times: NDArray[np.int64]
    values: Array


def _portions(streams: Sequence[Stream]) -> Iterator[list[slice]]:
    """Yield for successive portions of time the slice of each stream's samples."""
    longest = max((stream.times for stream in streams), key=len)
    begins = [0] * len(streams)
    for edge in [*longest[_PORTION::_PORTION].tolist(), None]:
        ends = [len(stream.times) if edge is None else int(np.searchsorted(stream.times, edge)) for stream in streams]
        yield [slice(begin, end) for begin, end in zip(begins, ends)]
        begins = ends
