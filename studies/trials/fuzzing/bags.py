# SPDX-License-Identifier: Apache-2.0
"""Try bags of all storages and compressions, whole and damaged, with the package and with rosbags."""

from __future__ import annotations

import re
import shutil
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
import yaml
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_typestore

from cfd_pneumatic.convention import FLOAT64, FLUID_PRESSURE, JOINT_STATE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import MessageBlock, standard_types
from cfd_pneumatic.recording import METADATA, Bag, BagWriter, Recording, read_recording
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import BINARY, TEXT, mutated

EPOCH = 1_700_000_000_000_000_000

Message = tuple[str, str, int, bytes]
"""Topic, type, time of reception [ns], payload."""

TopicMessages = dict[str, list[tuple[int, bytes]]]
"""Messages of each topic, by time of reception."""

Write = Callable[[Path, Sequence[Message], Random], bool]
"""Function that writes a bag into a folder, and returns whether a checksum covers the whole bag."""

TOPICS = {
    '/cfd/device/piston_state': JOINT_STATE,
    '/cfd/device/cylinder_a/pressure': FLUID_PRESSURE,
    '/cfd/device/cylinder_a/setpoint': FLOAT64,
    '/other': FLOAT64,
}


class Written(NamedTuple):
    """Messages of a bag, whether they are a recording, and whether a checksum covers the whole bag."""

    messages: TopicMessages
    recording: bool
    checked: bool


def contents(rng: Random, ros1: bool = False) -> tuple[list[Message], bool]:
    """Return random messages, and whether they are a recording: in order and with valid payloads."""
    messages = []
    in_order, is_valid = rng.random() < 0.8, rng.random() < 0.8
    for index in range(rng.choice((1, 2, 8, 20))):
        for topic, msgtype in TOPICS.items():
            time = EPOCH + (index * 10_000_000 if in_order else rng.randrange(10**9))
            payload = rng.randbytes(rng.choice((0, 1, 4, 40)))
            if is_valid:
                payload = (_in_ros1 if ros1 else _in_cdr)(msgtype, time, index)
            messages.append((topic, msgtype, time, payload))
    return messages, in_order and is_valid


def _in_cdr(msgtype: str, stamp: int, index: int) -> bytes:
    """Return a message in little-endian CDR."""
    if msgtype == FLOAT64:
        return b'\0\1\0\0' + struct.pack('<d', 3e4 + index)
    header = b'\0\1\0\0' + struct.pack('<iIIx3x', *divmod(stamp, 10**9), 1)
    if msgtype == FLUID_PRESSURE:
        return header + struct.pack('<dd', 2e5 + index, 0.0)
    return header + struct.pack('<II7sxI4xdII', 1, 7, b'piston', 1, 1e-4 * index, 0, 0)


def _in_ros1(msgtype: str, stamp: int, index: int) -> bytes:
    if msgtype == FLOAT64:
        return struct.pack('<d', 3e4 + index)
    header = struct.pack('<IIII', index, *divmod(stamp, 10**9), 0)
    if msgtype == FLUID_PRESSURE:
        return header + struct.pack('<dd', 2e5 + index, 0.0)
    return header + struct.pack('<II6sIdII', 1, 6, b'piston', 1, 1e-4 * index, 0, 0)


def by_rosbags(storage: str, *modes: CompressionMode, alone: float = 0.9) -> Write:
    """Return a function that writes a bag with rosbags; a share `alone` are files without metadata.yaml."""

    def write(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
        writer = Writer(folder / 'bag', version=rng.choice((8, 9)), storage_plugin=StoragePlugin[storage.upper()])
        mode = rng.choice(modes)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            topics: dict[str, Any] = {}
            for topic, msgtype, time, payload in messages:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, msgtype, typestore=standard_types())
                writer.write(topics[topic], time, payload)
        if mode in (CompressionMode.NONE, CompressionMode.STORAGE) and rng.random() < alone:
            _leave_file_alone(folder)
        return False

    return write


def _leave_file_alone(folder: Path) -> None:
    """Move the file of a bag out of its folder, because reading metadata.yaml dominates the time."""
    (file,) = (file for file in (folder / 'bag').iterdir() if file.name != METADATA)
    file.rename(folder / file.name)
    shutil.rmtree(folder / 'bag')


def by_package(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
    """Write a bag with the package."""
    with BagWriter(folder / 'bag', storage=rng.choice(('mcap', 'sqlite3'))) as bag:
        for topic, msgtype in TOPICS.items():
            bag.add_topic(topic, msgtype)
        for topic, _, time, payload in messages:
            bag.write(topic, MessageBlock.from_payloads([time], [payload]))
    if rng.random() < 0.9:
        _leave_file_alone(folder)
    return False


def by_mcap(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
    """Write an mcap file with the mcap library and random options, sometimes in two parts."""
    checked = rng.random() < 0.7
    options = {
        'compression': rng.choice(list(CompressionType)),
        'chunk_size': rng.choice((1, 300, 4000, 2**20)),
        'index_types': rng.choice((IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE)),
        'use_chunking': rng.random() < 0.8,
        'repeat_channels': rng.random() < 0.5,
        'repeat_schemas': rng.random() < 0.5,
        'use_statistics': rng.random() < 0.8,
        'use_summary_offsets': rng.random() < 0.5,
        'enable_crcs': checked,
        'enable_data_crcs': rng.random() < 0.5,
    }
    middle = rng.randrange(1, len(messages)) if rng.random() < 0.1 else len(messages)
    for number, part in enumerate(filter(None, (messages[:middle], messages[middle:]))):
        _write_mcap(folder / f'bag_{number}.mcap', part, options)
    return bool(checked and (options['use_chunking'] or options['enable_data_crcs']))


def _write_mcap(file: Path, messages: Sequence[Message], options: dict[str, Any]) -> None:
    with file.open('wb') as stream:
        writer = McapWriter(stream, **options)
        writer.start('ros2')
        channels: dict[str, int] = {}
        for topic, msgtype, time, payload in messages:
            if topic not in channels:
                definition, _ = standard_types().generate_msgdef(msgtype, ros_version=2)
                schema = writer.register_schema(msgtype, 'ros2msg', definition.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channels[topic], time, payload, time)
        writer.finish()


def by_ros1(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
    """Write a bag of ROS 1."""
    types = get_typestore(Stores.ROS1_NOETIC)
    writer = Ros1Writer(folder / 'bag.bag')
    compression = rng.choice((None, *Ros1Writer.CompressionFormat))
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        topics: dict[str, Any] = {}
        for topic, msgtype, time, payload in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, msgtype, typestore=types)
            writer.write(topics[topic], time, payload)
    return False


def read_by_package(bag: Bag) -> TopicMessages:
    """Return the messages that the package reads."""
    found: TopicMessages = defaultdict(list)
    for topic, block in bag.blocks(list(bag.topics)):
        found[topic] += [(int(time), block.payload(index)) for index, time in enumerate(block.times)]
    return by_time(found)


def read_by_rosbags(path: Path) -> TopicMessages | None:
    """Return the messages that rosbags reads; None if rosbags fails."""
    found: TopicMessages = defaultdict(list)
    try:
        with (Ros1Reader if path.suffix == '.bag' else Ros2Reader)(path) as reader:
            for connection, time, payload in reader.messages():
                found[f'/{connection.topic.lstrip("/")}'].append((int(time), bytes(payload)))  # SQLite takes any type
    except Exception:  # rosbags raises many types of exceptions on damaged bags
        return None
    return by_time(found)


def by_time(found: TopicMessages) -> TopicMessages:
    """Sort the messages of each topic, so that the order at equal times does not matter."""
    return {topic: sorted(messages) for topic, messages in found.items() if messages}


def check(recording: Recording) -> None:
    """Raise a fault if a recording has non-finite numbers, or times that do not increase."""
    for role, _, signal in recording.signals():
        if not (np.isfinite(signal.values).all() and np.isfinite(signal.times).all()):
            raise Fault(f'the {role} has numbers that are not finite')
        if not (np.diff(signal.times) > 0.0).all():
            raise Fault(f'the times of the {role} do not increase')


class Bags(Kind):
    """
    Bags of a program.

    Parameters
    ----------
    name
        Name of the kind.
    writers
        Functions that write a bag.
    changes
        End of the names of files that are changed.

    """

    def __init__(self, name: str, *writers: Write, changes: str = '') -> None:
        self.name = name
        self._writers, self._changes = writers, changes

    def start(self, folder: Path) -> None:
        """Set the folder of the bags."""
        self._folder = folder
        self._opened = False

    def valid(self, rng: Random) -> Input:
        """Write a bag."""
        target = _emptied(self._folder / 'made')
        messages, recording = contents(rng, ros1=by_ros1 in self._writers)
        checked = rng.choice(self._writers)(target, messages, rng)
        written: TopicMessages = defaultdict(list)
        for topic, _, time, payload in messages:
            written[topic].append((time, payload))
        files = {str(file.relative_to(target)): file.read_bytes() for file in target.rglob('*') if file.is_file()}
        return Input(files, Written(by_time(written), recording and len(messages) > len(TOPICS), checked))

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a bag with a changed file."""
        name = rng.choice(sorted(name for name in parent.files if name.endswith(self._changes)))
        return parent.changed(name, mutated(parent.files[name], rng, TEXT if name.endswith(METADATA) else BINARY))

    def give(self, case: Input) -> str:
        """Read the bag with rosbags and with the package, as messages and as a recording."""
        path, written = self._place(case), case.about
        expected = read_by_rosbags(path)
        self._opened = False
        try:
            with Bag(path) as bag:
                self._opened = True
                found, notes = read_by_package(bag), bag.notes
        except InputError as error:
            if expected == written.messages and self._changes and not _MAY_BE_REFUSED.search(str(error)):
                raise Fault('the package refuses a whole bag that rosbags reads') from None
            raise
        if case.whole and notes:
            raise Fault(f'a whole bag is reported as damaged: {notes}')
        if case.whole and found != written.messages:
            raise Fault('the messages read from a whole bag differ from the written messages')
        if (
            not notes
            and found != written.messages
            and any(Counter(messages) - Counter(found.get(topic, ())) for topic, messages in (expected or {}).items())
        ):
            raise Fault(f'{_count(found)} messages are read without a note; rosbags reads {_count(expected or {})}')
        if written.checked and not all(
            set(messages) <= set(written.messages.get(topic, ())) for topic, messages in found.items()
        ):
            raise Fault('read messages differ from written messages, although a checksum covers them')
        if case.whole or sum(map(len, case.files.values())) % 16 == 0:  # only some, because a recording takes long
            try:
                check(read_recording(path))
            except InputError:
                if written.recording or not case.whole:
                    raise
        return ' '.join(notes)

    def parses(self, case: Input) -> bool:
        """Return whether the bag was opened, or its changed file is YAML."""
        if self._changes and not self._opened:
            with suppress(Exception):  # the parser raises many types of exceptions
                return yaml.safe_load(case.files[f'bag/{METADATA}']) is not None
        return self._opened

    def _place(self, case: Input) -> Path:
        """Write the bag, and return its path for a user."""
        given = _emptied(self._folder / 'given')
        case.save(given)
        files = list(case.files)
        if 'bag/' in files[0]:
            return given / 'bag'
        return given if len(files) > 1 else given / files[0]


_MAY_BE_REFUSED = re.compile('unfolds to more than|is not YAML')
"""Refusals of bags that rosbags reads: values that contain themselves, and YAML 1.2, such as empty keys."""


def _emptied(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def _count(found: TopicMessages) -> int:
    return len(list(chain(*found.values())))


def kinds() -> list[Kind]:
    """Return all kinds of bags."""
    none, by_file, by_message = CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE
    return [
        Bags('bags: mcap, by its library', by_mcap),
        Bags('bags: mcap, by rosbags', by_rosbags('mcap', *[none, CompressionMode.STORAGE] * 8, by_file, by_message)),
        Bags('bags: sqlite3, by rosbags', by_rosbags('sqlite3', *[none] * 16, by_file, by_message)),
        Bags('bags: mcap and sqlite3, by us', by_package),
        Bags('bags: ROS 1', by_ros1),
        Bags(
            'metadata.yaml of bags',
            *[by_rosbags(storage, none, by_file, by_message, alone=0.0) for storage in ('mcap', 'sqlite3')],
            changes=METADATA,
        ),
    ]
