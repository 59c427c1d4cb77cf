# SPDX-License-Identifier: Apache-2.0
"""Bags of all storages and compressions, whole and damaged, each read by us and by rosbags."""

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

Found = dict[str, list[tuple[int, bytes]]]
"""Messages of each topic, by time of reception."""

Write = Callable[[Path, Sequence[Message], Random], bool]
"""Writes a bag into a folder; returns whether a checksum covers all of it."""

TOPICS = {
    '/cfd/device/piston_state': JOINT_STATE,
    '/cfd/device/cylinder_a/pressure': FLUID_PRESSURE,
    '/cfd/device/cylinder_a/setpoint': FLOAT64,
    '/other': FLOAT64,
}


class Written(NamedTuple):
    """What is in a bag, whether it is a recording too, and whether a checksum covers all of it."""

    messages: Found
    recording: bool
    checked: bool


def contents(rng: Random, ros1: bool = False) -> tuple[list[Message], bool]:
    """Return some messages, and whether they are a recording: in order, and payloads that are more than any bytes."""
    messages = []
    in_order, sane = rng.random() < 0.8, rng.random() < 0.8
    for index in range(rng.choice((1, 2, 8, 20))):
        for topic, msgtype in TOPICS.items():
            time = EPOCH + (index * 10_000_000 if in_order else rng.randrange(10**9))
            payload = rng.randbytes(rng.choice((0, 1, 4, 40)))
            if sane:
                payload = (_in_ros1 if ros1 else _in_cdr)(msgtype, time, index)
            messages.append((topic, msgtype, time, payload))
    return messages, in_order and sane


def _in_cdr(msgtype: str, stamp: int, index: int) -> bytes:
    """Return a message, little endian."""
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
    """Return what writes a bag with rosbags; a share of those that may be are a file alone."""

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
    """Take the file of a bag out of its folder: to read a metadata.yaml takes longer than everything else."""
    (file,) = (file for file in (folder / 'bag').iterdir() if file.name != METADATA)
    file.rename(folder / file.name)
    shutil.rmtree(folder / 'bag')


def by_us(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
    """Write a bag as our programs do."""
    with BagWriter(folder / 'bag', storage=rng.choice(('mcap', 'sqlite3'))) as bag:
        for topic, msgtype in TOPICS.items():
            bag.add_topic(topic, msgtype)
        for topic, _, time, payload in messages:
            bag.write(topic, MessageBlock.from_payloads([time], [payload]))
    if rng.random() < 0.9:
        _leave_file_alone(folder)
    return False


def by_mcap(folder: Path, messages: Sequence[Message], rng: Random) -> bool:
    """Write an mcap file with the mcap library and any of its options, sometimes in two parts."""
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


def ours(bag: Bag) -> Found:
    """Return what we read."""
    found: Found = defaultdict(list)
    for topic, block in bag.blocks(list(bag.topics)):
        found[topic] += [(int(time), block.payload(index)) for index, time in enumerate(block.times)]
    return by_time(found)


def theirs(path: Path) -> Found | None:
    """Return what rosbags reads, None where it stumbles."""
    found: Found = defaultdict(list)
    try:
        with (Ros1Reader if path.suffix == '.bag' else Ros2Reader)(path) as reader:
            for connection, time, payload in reader.messages():
                found[f'/{connection.topic.lstrip("/")}'].append((int(time), bytes(payload)))  # SQLite takes any type
    except Exception:  # whatever damage makes it stumble over
        return None
    return by_time(found)


def by_time(found: Found) -> Found:
    """Return messages of equal times in an order of their own."""
    return {topic: sorted(messages) for topic, messages in found.items() if messages}


def check(recording: Recording) -> None:
    """Raise a fault where a recording holds what none may."""
    for role, _, signal in recording.signals():
        if not (np.isfinite(signal.values).all() and np.isfinite(signal.times).all()):
            raise Fault(f'the {role} has numbers that are none')
        if not (np.diff(signal.times) > 0.0).all():
            raise Fault(f'the times of the {role} do not increase')


class Bags(Kind):
    """
    Bags that one program writes.

    Parameters
    ----------
    name
        Of the kind.
    writers
        What writes one.
    changes
        What is changed: files whose names end so.

    """

    def __init__(self, name: str, *writers: Write, changes: str = '') -> None:
        self.name = name
        self._writers, self._changes = writers, changes

    def start(self, folder: Path) -> None:
        """Choose where all are written."""
        self._folder = folder
        self._opened = False

    def valid(self, rng: Random) -> Input:
        """Write a bag."""
        made = _emptied(self._folder / 'made')
        messages, recording = contents(rng, ros1=by_ros1 in self._writers)
        checked = rng.choice(self._writers)(made, messages, rng)
        written: Found = defaultdict(list)
        for topic, _, time, payload in messages:
            written[topic].append((time, payload))
        files = {str(file.relative_to(made)): file.read_bytes() for file in made.rglob('*') if file.is_file()}
        return Input(files, Written(by_time(written), recording and len(messages) > len(TOPICS), checked))

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a bag one file of which is changed."""
        name = rng.choice(sorted(name for name in parent.files if name.endswith(self._changes)))
        return parent.changed(name, mutated(parent.files[name], rng, TEXT if name.endswith(METADATA) else BINARY))

    def give(self, one: Input) -> str:
        """Let it be read by rosbags and by us, as messages and as a recording."""
        path, written = self._place(one), one.about
        expected = theirs(path)
        self._opened = False
        try:
            with Bag(path) as bag:
                self._opened = True
                found, notes = ours(bag), bag.notes
        except InputError as error:
            if expected == written.messages and self._changes and not _MAY_BE_REFUSED.search(str(error)):
                raise Fault('refused, though the bag is whole and rosbags reads it') from None
            raise
        if one.whole and notes:
            raise Fault(f'a whole bag is said to be damaged: {notes}')
        if one.whole and found != written.messages:
            raise Fault('of a whole bag something else is read than was written')
        if (
            not notes
            and found != written.messages
            and any(Counter(messages) - Counter(found.get(topic, ())) for topic, messages in (expected or {}).items())
        ):
            raise Fault(f'{_count(found)} messages where rosbags reads {_count(expected or {})}, and nothing is said')
        if written.checked and not all(
            set(messages) <= set(written.messages.get(topic, ())) for topic, messages in found.items()
        ):
            raise Fault('something else is read than was written, which a checksum covers')
        if one.whole or sum(map(len, one.files.values())) % 16 == 0:  # not all, for it takes long
            try:
                check(read_recording(path))
            except InputError:
                if written.recording or not one.whole:
                    raise
        return ' '.join(notes)

    def parses(self, one: Input) -> bool:
        """Return whether it was opened, or what is changed of it is YAML."""
        if self._changes and not self._opened:
            with suppress(Exception):  # whatever the parser has for it
                return yaml.safe_load(one.files[f'bag/{METADATA}']) is not None
        return self._opened

    def _place(self, one: Input) -> Path:
        """Write it, and return the path that a user would give."""
        given = _emptied(self._folder / 'given')
        one.save(given)
        files = list(one.files)
        if 'bag/' in files[0]:
            return given / 'bag'
        return given if len(files) > 1 else given / files[0]


_MAY_BE_REFUSED = re.compile('unfolds to more than|is not YAML')
"""Of what rosbags may read: a value that holds itself, which it need not follow, and YAML 1.2, such as empty keys."""


def _emptied(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def _count(found: Found) -> int:
    return len(list(chain(*found.values())))


def kinds() -> list[Kind]:
    """Return all kinds of bags."""
    none, by_file, by_message = CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE
    return [
        Bags('bags: mcap, by its library', by_mcap),
        Bags('bags: mcap, by rosbags', by_rosbags('mcap', *[none, CompressionMode.STORAGE] * 8, by_file, by_message)),
        Bags('bags: sqlite3, by rosbags', by_rosbags('sqlite3', *[none] * 16, by_file, by_message)),
        Bags('bags: mcap and sqlite3, by us', by_us),
        Bags('bags: ROS 1', by_ros1),
        Bags(
            'metadata.yaml of bags',
            *[by_rosbags(storage, none, by_file, by_message, alone=0.0) for storage in ('mcap', 'sqlite3')],
            changes=METADATA,
        ),
    ]
