# SPDX-License-Identifier: Apache-2.0
"""Files cut and flipped anywhere: what a checksum can tell never becomes a wrong number, and losses are told."""

from __future__ import annotations

import random
import shutil

import made
import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from recording_cases import (
    EPOCH,
    SECOND,
    by_time,
    piston,
    pressure,
    setpoint,
    write_bag,
    write_mcap_bag,
    write_ros1_bag,
)

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import BagWriter, read_recording

SAMPLES = 150


def contents():
    """Return messages of three topics, no two of one topic alike."""
    found = []
    for index in range(SAMPLES):
        time = EPOCH + index * SECOND // 100
        found.append(setpoint(1e5 + index, time))
        found.append(piston(1e-4 * np.sin(index / 7), time + 1))
        found.append(pressure(2e5 + index, time + 2))
    return found


def ours(path):
    """Write a bag as all of our programs do."""
    with BagWriter(path.parent / path.stem) as bag:
        for topic, msgtype in {message.topic: message.msgtype for message in contents()}.items():
            bag.add_topic(topic, msgtype)
        for message in contents():
            made.write_message(bag, message.topic, message.time, message.content)
    shutil.move(path.parent / path.stem / f'{path.stem}.mcap', path)


def by_mcap(**options):
    return lambda path: write_mcap_bag(path, contents(), **{'chunk_size': 4000, **options})


def by_rosbags(storage):
    def write(path):
        folder = write_bag(path.parent / f'{path.stem}_folder', contents(), storage=storage)
        shutil.move(folder / f'{folder.name}{path.suffix}', path)

    return write


def cut(data, rng):
    return data[: rng.randrange(len(data))]


def flip(data, rng):
    data = bytearray(data)
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def blank(data, rng):
    begin = rng.randrange(len(data))
    return data[:begin] + bytes(min(64, len(data) - begin)) + data[begin + 64 :]


def cut_and_flip(data, rng):
    return flip(cut(data, rng) or data, rng)


CHECKED = (cut, flip, blank, cut_and_flip)
FILES = {
    'ours.mcap': (ours, CHECKED),
    'plain.mcap': (by_mcap(compression=CompressionType.NONE), CHECKED),
    'zstd.mcap': (by_mcap(), CHECKED),
    'lz4.mcap': (by_mcap(compression=CompressionType.LZ4), CHECKED),
    'no_index.mcap': (by_mcap(index_types=IndexType.NONE), CHECKED),
    'no_chunks.mcap': (by_mcap(use_chunking=False, enable_data_crcs=True), (cut, flip, blank)),
    'no_checksums.mcap': (by_rosbags('mcap'), (cut,)),
    'rows.db3': (by_rosbags('sqlite3'), (cut,)),
    'ros1.bag': (write_ros1_bag, (cut,)),
}


@pytest.mark.parametrize('name', FILES)
def test_damage_anywhere(tmp_path, name):
    write, damages = FILES[name]
    write(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    truth = by_time(read_recording(tmp_path / name))
    rng = random.Random(f'{name} 2')
    file = tmp_path / f'bad.{name.rpartition(".")[2]}'
    for damage in damages * (24 // len(damages)):
        file.write_bytes(damage(data, rng))
        try:
            recorded = read_recording(file)
        except InputError:
            continue
        found = by_time(recorded)
        for signal, values in found.items():
            assert values.items() <= truth[signal].items()
        if sum(map(len, found.values())) < sum(map(len, truth.values())):
            assert any('is damaged' in note or 'is cut off' in note for note in recorded.health)
