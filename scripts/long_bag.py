"""
Bags of any length, made in bulk: a device at 1 kHz with two cylinders, each with pressure and applied set-point.

    python scripts/long_bag.py FOLDER --samples 14400000 --storage mcap --compression zstd

The motion, which is simulated, repeats itself after 20 s; the sensors' noise doesn't.
"""

from __future__ import annotations

import argparse
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from rosbags.rosbag2 import StoragePlugin, Writer

from cfd_pneumatic.convention import (
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    pressure_topic,
    setpoint_applied_topic,
)
from cfd_pneumatic.model import DIRECTIONS, Cylinder, OperatingPoints
from cfd_pneumatic.recording import messages
from cfd_pneumatic.recording.fields import parse_path
from cfd_pneumatic.recording.layout import Layout, Serialization
from cfd_pneumatic.recording.messages import NANOSECONDS

AMBIENT = 101_325.0
GAINS = (4.33e6, 104.0, 19.4, 0.0105)
EPOCH = 1_700_000_000 * NANOSECONDS
STEP = 1_000_000  # ns
PERIOD = 20_000  # samples after which the motion repeats itself
TRANSPORT = 200_000  # ns from a sample to its reception; a topic comes a hundredth of it after the one before
PART = 1_500  # samples that are written together: a chunk of an mcap, of the size that rosbag2 makes

STORAGES = ('mcap', 'sqlite3')
COMPRESS = {'none': ('', bytes), 'zstd': ('zstd', zstandard.compress), 'lz4': ('lz4', lz4.frame.compress)}
SUFFIX = {'mcap': 'mcap', 'sqlite3': 'db3'}


class _Template:
    """Messages of one topic: all the same but for stamp and number."""

    def __init__(self, topic: str, msgtype: str, message: object, path: str) -> None:
        types = messages.standard_types()
        self.topic = f'/cfd/device/{topic}'
        self.msgtype = msgtype
        payload = bytes(types.serialize_cdr(message, msgtype))
        layout = Layout(payload, types, msgtype, Serialization.CDR)
        self._payload = np.frombuffer(payload, np.uint8)
        self._places = [layout.place(parse_path(name)) for name in ('header.stamp.sec', 'header.stamp.nanosec', path)]

    @property
    def size(self) -> int:
        return len(self._payload)

    def fill(self, rows, stamps, values) -> None:
        """Write messages into the rows of an array of bytes."""
        rows[:] = self._payload
        for place, numbers in zip(self._places, (*np.divmod(stamps, NANOSECONDS), values)):
            dtype = np.dtype(place.dtype)
            columns = slice(place.offset, place.offset + dtype.itemsize)
            rows[:, columns] = np.ascontiguousarray(numbers, dtype)[:, None].view(np.uint8)


def topics(force: bool = False) -> list[str]:
    """Return the topics of a bag."""
    return [template.topic for template in _templates(force)]


def _templates(force: bool) -> list[_Template]:
    piston = messages.joint_state(0, PISTON_JOINT, 0.0)
    templates = [_Template(PISTON_STATE, messages.JOINT_STATE, piston, 'position[0]')]
    for cylinder in CYLINDERS:
        for topic in (pressure_topic(cylinder), setpoint_applied_topic(cylinder)):
            air = messages.fluid_pressure(0, 0.0)
            templates.append(_Template(topic, messages.FLUID_PRESSURE, air, 'fluid_pressure'))
    if force:
        load = messages.wrench_stamped(0, 0.0)
        templates.append(_Template(MEASURED_FORCE, messages.WRENCH_STAMPED, load, 'wrench.force.x'))
    return templates


@cache
def _period() -> np.ndarray:
    """Return one period of the true signals in the order of `_templates`, shape (6, PERIOD)."""
    times = np.arange(PERIOD) * (STEP / NANOSECONDS)
    strokes = np.concatenate([[0.0], np.random.default_rng(1).uniform(0.0, 3e-3, 18), [0.0]])
    phase = np.clip((times % 1.0 - 0.3) / 0.05, 0.0, 1.0)
    index = times.astype(int)
    before, after = strokes[np.maximum(index - 1, 0)], strokes[index]
    displacement = before + (after - before) * 0.5 * (1.0 - np.cos(np.pi * phase))
    setpoint = AMBIENT + np.where((times > 5.0) & (times < 15.0), 60e3, 40e3)
    cylinder = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT)
    signals = [displacement]
    for name in CYLINDERS:
        signals += [cylinder.simulate(times, DIRECTIONS[name] * displacement, setpoint), setpoint]
    return np.array([*signals, 100.0 + 1e-3 * (signals[1] - signals[3])])


_NOISE = np.array([1e-6, 50.0, 0.0, 50.0, 0.0, 0.5])[:, None]


@dataclass(frozen=True)
class _Part:
    """Messages of some samples: a block of bytes for each topic, and times of reception of the first topic."""

    rows: list[np.ndarray]
    received: np.ndarray


def _parts(samples: int, templates: list[_Template], signals: np.ndarray | None) -> Iterator[_Part]:
    period = _period()[: len(templates)] if signals is None else signals
    spread = _NOISE[: len(templates)]
    noise = np.random.default_rng(2)
    for begin in range(0, samples, PART):
        index = np.arange(begin, min(begin + PART, samples))
        values = period[:, index % period.shape[1]] + spread * noise.normal(size=(len(spread), len(index)))
        stamps = EPOCH + index * STEP
        rows = [np.empty((len(index), template.size), np.uint8) for template in templates]
        for template, block, numbers in zip(templates, rows, values):
            template.fill(block, stamps, numbers)
        yield _Part(rows, stamps + TRANSPORT)


def write_long_bag(
    path: Path,
    samples: int,
    storage: str = 'mcap',
    compression: str = 'none',
    force: bool = False,
    signals: np.ndarray | None = None,
) -> Path:
    """Write a bag of so many samples of each topic, of `signals` (topics, n) over and over; return its file's path."""
    templates = _templates(force)
    with Writer(path, version=8, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for template in templates:
            writer.add_connection(template.topic, template.msgtype, typestore=messages.standard_types())
    (path / 'metadata.yaml').unlink()  # it says that there is nothing
    file = path / f'{path.name}.{SUFFIX[storage]}'
    if storage == 'mcap':
        _write_mcap(file, templates, _parts(samples, templates, signals), *COMPRESS[compression])
    else:
        _fill_sqlite(file, _parts(samples, templates, signals))
    return file


def _write_mcap(file: Path, templates: list[_Template], parts: Iterator[_Part], compression: str, compress) -> None:
    types = messages.standard_types()
    builder = RecordBuilder()
    schemas = {}
    channels = []
    for number, template in enumerate(templates, start=1):
        text = types.generate_msgdef(template.msgtype, ros_version=2)[0]
        schema = records.Schema(len(schemas) + 1, text.encode(), 'ros2msg', template.msgtype)
        schema = schemas.setdefault(template.msgtype, schema)
        channels.append(records.Channel(number, template.topic, 'cdr', {}, schema.id))
    indexes = []
    with file.open('wb') as stream:

        def write(*written) -> int:
            begin = stream.tell()
            for record in written:
                record.write(builder)
            stream.write(builder.end())
            return begin

        magic = b'\x89MCAP0\r\n'
        stream.write(magic)
        write(records.Header('ros2', 'long_bag'), *schemas.values(), *channels)
        begin = end = count = 0
        for part in parts:
            chunk, offsets = _chunk_of(part)
            times = [part.received + _delay(topic) for topic in range(len(channels))]
            first, last = int(times[0][0]), int(times[-1][-1])
            compressed = compress(chunk)
            at = write(records.Chunk(compression, compressed, last, first, 0, len(chunk)))
            length = stream.tell() - at
            index = {
                channel.id: write(records.MessageIndex(channel.id, list(zip(times[k].tolist(), offsets[k].tolist()))))
                for k, channel in enumerate(channels)
            }
            past = stream.tell() - at - length
            indexes.append(
                records.ChunkIndex(length, at, compression, len(compressed), last, past, index, first, len(chunk))
            )
            begin, end, count = begin or first, last, count + len(part.received)
        write(records.DataEnd(0))
        counts = {channel.id: count for channel in channels}
        total = count * len(channels)
        statistics = records.Statistics(
            attachment_count=0,
            channel_message_counts=counts,
            channel_count=len(channels),
            chunk_count=len(indexes),
            message_count=total,
            message_end_time=end,
            message_start_time=begin,
            metadata_count=0,
            schema_count=len(schemas),
        )
        summary = write(*schemas.values(), *channels, *indexes, statistics)
        write(records.Footer(summary, 0, 0))
        stream.write(magic)


def _delay(topic: int) -> int:
    """Return by what a topic's messages come after the first topic's [ns]."""
    return topic * TRANSPORT // 100


def _chunk_of(part: _Part) -> tuple[bytes, list[np.ndarray]]:
    """Return the message records of a part, in the order of reception, and where those of each topic begin."""
    head = np.dtype([('op', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'), ('times', '<u8', 2)])
    pieces, offsets, width = [], [], 0
    for topic, rows in enumerate(part.rows):
        heads = np.zeros(len(rows), head)
        heads['op'], heads['channel'], heads['length'] = 5, topic + 1, 22 + rows.shape[1]
        heads['times'] = (part.received + _delay(topic))[:, None]
        pieces += [heads.view(np.uint8).reshape(len(rows), -1), rows]
        offsets.append(width)
        width += head.itemsize + rows.shape[1]
    ticks = width * np.arange(len(part.received))
    return np.concatenate(pieces, axis=1).tobytes(), [ticks + offset for offset in offsets]


def _fill_sqlite(file: Path, parts: Iterator[_Part]) -> None:
    with sqlite3.connect(file) as database:
        for part in parts:
            topics = [
                zip([number] * len(rows), (part.received + _delay(number - 1)).tolist(), map(bytes, rows))
                for number, rows in enumerate(part.rows, start=1)
            ]
            for rows in zip(*topics):
                database.executemany('INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)', rows)
    database.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path, help='folder of the new bag')
    parser.add_argument('--samples', type=int, default=3_600_000, help='samples of each topic (default: an hour)')
    parser.add_argument('--storage', choices=STORAGES, default='mcap')
    parser.add_argument('--compression', choices=COMPRESS, default='none', help='of the chunks of an mcap')
    parser.add_argument('--force', action='store_true', help='with the measured force')
    options = parser.parse_args()
    print(write_long_bag(options.folder, options.samples, options.storage, options.compression, options.force))


if __name__ == '__main__':
    main()
