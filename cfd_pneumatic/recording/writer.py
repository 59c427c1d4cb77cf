"""Writing bags: whole or not at all."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal

import mcap.writer
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import messages
from cfd_pneumatic.recording.bag import METADATA
from cfd_pneumatic.recording.messages import NANOSECONDS
from cfd_pneumatic.recording.signals import Recording, Signal
from cfd_pneumatic.recording.topics import resolve

if TYPE_CHECKING:
    from typing_extensions import Self

StorageName = Literal['mcap', 'sqlite3']

STORAGES: tuple[StorageName, ...] = ('mcap', 'sqlite3')

_BAG_VERSION: Literal[8] = 8
"""What Humble's rosbag2 reads, too."""

_LAST_STAMP = 2**31
"""Seconds that a stamp can't hold any more."""

_PORTION = 100_000  # samples of a topic that are sorted at a time


class _Mcap:
    """Writes the file of a bag with checksums, which rosbags' own writer leaves out."""

    def __init__(self, path: Path, _: CompressionMode) -> None:
        self.path = path / f'{path.name}.mcap'
        self._stream = self.path.open('xb')
        self._file = mcap.writer.Writer(self._stream, compression=mcap.writer.CompressionType.NONE)
        self._file.start('ros2')
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, int] = {}

    def add_msgtype(self, connection: Connection) -> None:
        kind = 'ros2msg' if connection.msgdef.format == MessageDefinitionFormat.MSG else 'ros2idl'
        definition = connection.msgdef.data.encode()
        self._schemas[connection.msgtype] = self._file.register_schema(connection.msgtype, kind, definition)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        self._channels[connection.id] = self._file.register_channel(
            connection.topic,
            'cdr',
            self._schemas[connection.msgtype],
            {'offered_qos_profiles': offered_qos_profiles},
        )

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        self._file.add_message(self._channels[connection.id], timestamp, bytes(data), timestamp)

    def close(self, _: int, metadata: str) -> None:
        self._file.add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._file.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def abort(self) -> None:
        self._stream.close()


class BagWriter:
    """
    Writes a ROS 2 bag aside and moves it to its place when it is complete.

    As a context manager it closes the bag at the end, or drops it if there was an error.

    Parameters
    ----------
    path : Path or str
        Folder of the bag.
    storage : str
        `mcap` or `sqlite3`.
    overwrite : bool
        Whether a bag that is there may be replaced; anything else there is kept in any case.

    Raises
    ------
    InputError
        If there is something at the path already or its parent can't be written.

    """

    def __init__(self, path: Path | str, *, storage: StorageName = 'mcap', overwrite: bool = False) -> None:
        self.path = Path(path)
        self._connections: dict[str, Connection] = {}
        self._check_free(overwrite)
        with self._reported():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._aside = Path(tempfile.mkdtemp(dir=self.path.parent, prefix=f'.{self.path.name}.'))
            self._writer = Writer(
                self._aside / self.path.name, version=_BAG_VERSION, storage_plugin=StoragePlugin[storage.upper()]
            )
            self._writer.STORAGE_PLUGINS = {**Writer.STORAGE_PLUGINS, StoragePlugin.MCAP: _Mcap}
            self._writer.open()

    def add_topic(self, topic: str, msgtype: str) -> None:
        """
        Announce a topic; needed before its first message.

        Raises
        ------
        InputError
            If ROS 2 has no such message type.

        """
        types = messages.standard_types()
        if msgtype not in types.fielddefs:
            raise InputError(f'topic {topic} cannot be recorded: its type {msgtype} is not one that ROS 2 ships')
        with self._reported():
            self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=types)

    def write(self, topic: str, time: int, payload: bytes | memoryview) -> None:
        """Write a serialised (CDR) message on an announced topic, received at a time [ns]."""
        with self._reported():
            self._writer.write(self._connections[topic], time, payload)

    def write_message(self, topic: str, time: int, message: object) -> None:
        """Write a message, made by `cfd_pneumatic.recording.messages`, on an announced topic at a time [ns]."""
        payload = messages.standard_types().serialize_cdr(message, self._connections[topic].msgtype)
        self.write(topic, time, payload)

    def write_streams(self, streams: Sequence[Stream]) -> None:
        """Write streams, their topics announced here, in the order of time; at equal times in their own."""
        for one in streams:
            self.add_topic(one.topic, one.msgtype)
        for portion in _portions(streams):
            times = np.concatenate([one.times[samples] for one, samples in zip(streams, portion)])
            owners = np.repeat(np.arange(len(streams)), [samples.stop - samples.start for samples in portion])
            places = np.concatenate([np.arange(samples.start, samples.stop) for samples in portion])
            order = np.argsort(times, kind='stable')
            for time, owner, place in zip(times[order].tolist(), owners[order].tolist(), places[order].tolist()):
                one = streams[owner]
                self.write_message(one.topic, time, one.message(time, float(one.values[place])))

    def remark(self, key: str, text: str) -> None:
        """Put a text into the bag's metadata."""
        self._writer.set_custom_data(key, text)

    def close(self) -> None:
        """Complete the bag and move it to its place."""
        with self._reported():
            self._writer.close()
            self._take_place()
            shutil.rmtree(self._aside, ignore_errors=True)

    def abort(self) -> None:
        """Drop what was written."""
        with suppress(Exception):
            self._writer.abort()
        shutil.rmtree(self._aside, ignore_errors=True)

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the bag, or drop it after an error."""
        if kind is not None:
            self.abort()
            return
        try:
            self.close()
        except BaseException:
            self.abort()
            raise

    def _check_free(self, overwrite: bool) -> None:
        if self.path.parent.exists() and not self.path.parent.is_dir():
            raise InputError(f'cannot write {self.path}: {self.path.parent} is not a folder')
        if not self.path.exists():
            return
        if not overwrite:
            raise InputError(f'{self.path} exists already: choose another name or let it be overwritten')
        if not (self.path / METADATA).is_file():
            raise InputError(f'{self.path} is not a bag and is not overwritten: choose another name')

    def _take_place(self) -> None:
        """Move the bag to its place; where that fails an earlier bag is put back."""
        earlier = self._aside / 'earlier'
        if self.path.exists():
            os.replace(self.path, earlier)
        try:
            os.replace(self._aside / self.path.name, self.path)
        except OSError:
            if earlier.exists():
                os.replace(earlier, self.path)
            raise

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Turn what a disk can do wrong into an error for the user."""
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            reason = getattr(error, 'strerror', None) or str(error)
            raise InputError(f'cannot write {self.path}: {reason}; choose a folder that can be written') from error


def write_recording(
    path: Path | str,
    recording: Recording,
    *,
    namespace: str = '/cfd/device',
    storage: StorageName = 'mcap',
    ambient_pressure: float = AMBIENT_PRESSURE,
    joint: str = PISTON_JOINT,
    overwrite: bool = False,
) -> None:
    """
    Write a recording as a bag in our convention.

    Parameters
    ----------
    path : Path or str
        Folder of the bag.
    recording : Recording
        What to write.
    namespace : str
        Namespace of the topics.
    storage : str
        `mcap` or `sqlite3`.
    ambient_pressure : float
        What the set-points, which are gauge pressures in a bag, are above [Pa].
    joint : str
        Name of the piston in JointState.
    overwrite : bool
        Whether a bag that is there may be replaced.

    Raises
    ------
    InputError
        If the bag can't be written, or the recording's times don't fit a message.

    """

    def stream(name: str, msgtype: str, signal: Signal, message: Callable[[int, float], object]) -> Stream:
        return Stream(resolve(namespace, name), msgtype, stamps_of(recording, signal.times), signal.values, message)

    def setpoint(_: int, value: float) -> object:
        return messages.float64(value - ambient_pressure)

    def piston_state(time: int, value: float) -> object:
        return messages.joint_state(time, joint, value)

    streams = [  # set-points first: at equal times they come before the samples that they act on
        stream(setpoint_topic(cylinder), messages.FLOAT64, signals.setpoint, setpoint)
        for cylinder, signals in recording.cylinders.items()
        if signals.setpoint is not None
    ]
    streams.append(stream(PISTON_STATE, messages.JOINT_STATE, recording.displacement, piston_state))
    streams += [
        stream(pressure_topic(cylinder), messages.FLUID_PRESSURE, signals.pressure, messages.fluid_pressure)
        for cylinder, signals in recording.cylinders.items()
    ]
    if recording.force is not None:
        streams.append(stream(MEASURED_FORCE, messages.WRENCH_STAMPED, recording.force, messages.wrench_stamped))
    with BagWriter(path, storage=storage, overwrite=overwrite) as bag:
        bag.write_streams(streams)


@dataclass(frozen=True)
class Stream:
    """What is written on a topic: values at increasing times [ns], and what makes a message of a time and a value."""

    topic: str
    msgtype: str
    times: NDArray[np.int64]
    values: NDArray[np.float64]
    message: Callable[[int, float], object]


def stamps_of(recording: Recording, times: NDArray[np.float64]) -> NDArray[np.int64]:
    """
    Return the stamps of times of a recording [ns].

    Raises
    ------
    InputError
        If they don't fit a message.

    """
    stamps = recording.epoch + np.rint(times * NANOSECONDS).astype(np.int64)
    if stamps[0] < 0 or stamps[-1] >= _LAST_STAMP * NANOSECONDS:
        first, last = stamps[[0, -1]] / NANOSECONDS
        raise InputError(
            f'{recording.name}: times of {first:g} to {last:g} s do not fit a stamp: check their unit and offset'
        )
    return stamps


def _portions(streams: Sequence[Stream]) -> Iterator[list[slice]]:
    """Yield which samples of each stream come next, a limited number at a time."""
    longest = max((one.times for one in streams), key=len)
    begins = [0] * len(streams)
    for edge in [*longest[_PORTION::_PORTION].tolist(), None]:
        ends = [len(one.times) if edge is None else int(np.searchsorted(one.times, edge)) for one in streams]
        yield [slice(begin, end) for begin, end in zip(begins, ends)]
        begins = ends
