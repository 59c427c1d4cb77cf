# SPDX-License-Identifier: Apache-2.0
"""Bags that recorders and converters leave: packed without metadata, of ROS 1 in mcap, with odd clocks of reception."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from recording_cases import EPOCH, SECOND, piston, plain_messages, pressure, setpoint, write_bag, write_mcap_bag
from rosbags.rosbag2 import CompressionMode

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_mapping, read_recording

MILLISECOND = SECOND // 1000


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_messages_that_are_packed_one_by_one_are_unpacked_without_metadata(tmp_path, storage):
    write_bag(tmp_path / 'bag', plain_messages(), storage=storage, compression=CompressionMode.MESSAGE)
    with_metadata = read_recording(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    (file,) = (tmp_path / 'bag').iterdir()
    for path in (tmp_path / 'bag', file):
        found = read_recording(path)
        np.testing.assert_array_equal(found.displacement.values, with_metadata.displacement.values)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_folder_with_the_suffix_of_ros_1_is_read_as_its_files_are(tmp_path, storage):
    for name in ('press', 'press.bag'):
        write_bag(tmp_path / name, plain_messages(), storage=storage)
    plain, suffixed = (read_recording(tmp_path / name) for name in ('press', 'press.bag'))
    np.testing.assert_array_equal(suffixed.displacement.values, plain.displacement.values)


def write_ros1_in_mcap(path, names=('acme/Press', 'acme/Press')):
    """Write a file as converters from ROS 1 do: packed numbers, definitions of ROS 1, names without `msg`."""
    writer = McapWriter(str(path))
    writer.start('ros1')
    channels = [
        writer.register_channel(
            f'/press/{number}', 'ros1', writer.register_schema(name, 'ros1msg', b'time t\nfloat32[] v\nstring s\n')
        )
        for number, name in enumerate(names)
    ]
    for index in range(50):
        time = EPOCH + index * 10 * MILLISECOND
        payload = struct.pack('<II', *divmod(time, SECOND)) + struct.pack('<Iff', 2, 0.1 * index, 200.0 + index)
        payload += struct.pack('<I', 3) + b'one'
        for channel in channels:
            writer.add_message(channel, time, payload, time)
    writer.finish()


MAPPING = """\
displacement: {topic: /press/0, field: 'v[0]', unit: mm, stamp: t}
cylinder_a: {pressure: {topic: /press/1, field: 'v[1]', unit: kPa, reference: absolute, stamp: t}}
"""


def test_messages_of_ros_1_in_an_mcap_file_are_read(tmp_path):
    write_ros1_in_mcap(tmp_path / 'x.mcap')
    (tmp_path / 'm.yaml').write_text(MAPPING)
    found = read_recording(tmp_path / 'x.mcap', mapping=read_mapping(tmp_path / 'm.yaml'))
    np.testing.assert_allclose(found.displacement.values, 1e-4 * np.arange(50), rtol=1e-6)
    np.testing.assert_allclose(found.cylinders['cylinder_a'].pressure.values, 2e5 + 1e3 * np.arange(50))
    assert found.epoch == EPOCH


def drifting(rate, count=300, offset=10**15):
    """Return messages of 3 s whose times of reception are by another clock, set-points among them each 0.5 s."""
    found = []
    for index in range(count):
        stamp = EPOCH + index * 10 * MILLISECOND
        received = int(stamp + offset + rate * (stamp - EPOCH))
        found += [piston(1e-4 * (index % 9), stamp, received=received), pressure(2e5 + index, stamp, received=received)]
        if index % 50 == 0:
            found.append(setpoint(1e4 * (1 + index // 50 % 2), received))
    return found


@pytest.mark.parametrize('rate', [-0.5, 0.03, 1.0, 0.0])
@pytest.mark.parametrize('offset', [0, -(10**15), 10**15])
def test_set_points_without_a_stamp_are_placed_by_the_rate_of_the_clocks(tmp_path, rate, offset):
    found = read_recording(write_mcap_bag(tmp_path / 'x.mcap', drifting(rate, offset=offset)))
    times = found.cylinders['cylinder_a'].setpoint.times
    np.testing.assert_allclose(times, 0.5 * np.arange(6), atol=2e-3)
    assert any('times as fast' in note for note in found.health) == (rate != 0.0)


def test_a_network_that_is_slow_now_and_then_is_no_other_clock(tmp_path):
    late = np.random.default_rng(1).exponential(5.0, 600) + 40.0 * (np.arange(600) % 100 < 3)
    contents = []
    for index in range(600):
        stamp = EPOCH + index * 10 * MILLISECOND
        received = stamp + int(late[index] * MILLISECOND)
        contents += [
            piston(1e-4 * (index % 9), stamp, received=received),
            pressure(2e5 + index, stamp, received=received),
        ]
        if index % 100 == 50:
            contents.append(setpoint(1e4 * (1 + index // 100 % 2), stamp))
    found = read_recording(write_mcap_bag(tmp_path / 'x.mcap', contents))
    np.testing.assert_allclose(found.cylinders['cylinder_a'].setpoint.times, 0.5 + np.arange(6), atol=1e-6)
    assert not any('clock' in note for note in found.health)


@pytest.mark.parametrize('stray', [2**63 - 10, 5, EPOCH + 10**17])
@pytest.mark.parametrize('which', [slice(100, 105), slice(0, 3), slice(195, 200)])
def test_a_few_times_of_reception_that_cannot_be_leave_the_stamps_in_order(tmp_path, stray, which):
    contents = []
    strays = set(range(200)[which])
    for index in range(200):
        stamp = EPOCH + index * 20 * MILLISECOND
        received = stray if index in strays else stamp + MILLISECOND
        contents += [piston(1e-4 * index, stamp, received=received), pressure(2e5 + index, stamp)]
    found = read_recording(write_mcap_bag(tmp_path / 'x.mcap', contents))
    np.testing.assert_allclose(found.displacement.values, 1e-4 * np.arange(200))
    assert any(f'{len(strays)} messages with an impossible time of reception' in one for one in found.health)


def test_brackets_within_braces_have_to_stand_in_quotes(tmp_path):
    (tmp_path / 'm.yaml').write_text(MAPPING.replace("'v[0]'", 'v[0]'))
    with pytest.raises(InputError, match=r'line 1, .* put a text with brackets, braces or commas in quotes'):
        read_mapping(tmp_path / 'm.yaml')
