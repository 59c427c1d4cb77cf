# SPDX-License-Identifier: Apache-2.0
"""
Writing a recording as a bag, against what a user would write with rosbags, in the same run.

The peer has its messages made already; only serialising and writing them counts.
"""

from __future__ import annotations

import shutil

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from cfd_pneumatic.messages import standard_types
from cfd_pneumatic.recording import recording_of, write_recording
from cfd_pneumatic.rig import record, surface_following

ROUNDS = 5


@pytest.fixture(scope='module')
def recording():
    """Return a minute of the rig: two cylinders, set-points, force."""
    return recording_of(record(surface_following(duration=60.0), seed=1), 'surface', 10**18)


@pytest.fixture(params=['mcap', 'sqlite3'])
def storage(request, benchmark, recording):
    count = sum(len(signal) for *_, signal in recording.signals())
    benchmark.extra_info['messages'] = count
    benchmark.group = f'write {count:,} messages, {request.param}'
    return request.param


def emptied(path):
    shutil.rmtree(path, ignore_errors=True)


def test_writing(benchmark, tmp_path, recording, storage):
    benchmark.pedantic(
        lambda: write_recording(tmp_path / 'bag', recording, storage=storage),
        setup=lambda: emptied(tmp_path / 'bag'),
        rounds=ROUNDS,
    )


def test_writing_with_rosbags(benchmark, tmp_path, recording, storage):
    write_recording(tmp_path / 'ours', recording, storage=storage)
    types = standard_types()
    with Reader(tmp_path / 'ours') as reader:
        messages = [
            (one.topic, one.msgtype, time, types.deserialize_cdr(payload, one.msgtype))
            for one, time, payload in reader.messages()
        ]
    topics = {topic: msgtype for topic, msgtype, *_ in messages}

    def write():
        with Writer(tmp_path / 'bag', version=8, storage_plugin=StoragePlugin[storage.upper()]) as bag:
            opened = {topic: bag.add_connection(topic, kind, typestore=types) for topic, kind in topics.items()}
            for topic, msgtype, time, message in messages:
                bag.write(opened[topic], time, types.serialize_cdr(message, msgtype))

    benchmark.pedantic(write, setup=lambda: emptied(tmp_path / 'bag'), rounds=2)
