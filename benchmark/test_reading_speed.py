# SPDX-License-Identifier: Apache-2.0
"""
Reading a bag into arrays against what a user would write with rosbags, in the same run.

    CFD_PNEUMATIC_MESSAGES=10000000 make benchmark ARGS='-k read'

rosbags makes an object of every message, and nothing of the objects. By default there are a million messages.
"""

from __future__ import annotations

import os

import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from cfd_pneumatic.recording import read_recording
from studies.trials.long_bag import topics, write_long_bag

MESSAGES = int(os.environ.get('CFD_PNEUMATIC_MESSAGES', 1_000_000))
SAMPLES = MESSAGES // len(topics())
BAGS = {'mcap': ('mcap', False), 'mcap, zstd': ('mcap', True), 'sqlite3': ('sqlite3', False)}
ROUNDS = max(1, 3_000_000 // MESSAGES)


def read_with_rosbags(file):
    types = get_typestore(Stores.LATEST)
    with Reader(file) as reader:
        return sum(
            types.deserialize_cdr(payload, connection.msgtype) is not None
            for connection, _, payload in reader.messages()
        )


@pytest.fixture(scope='module', params=BAGS)
def bag(request, tmp_path_factory):
    storage, compressed = BAGS[request.param]
    return request.param, write_long_bag(tmp_path_factory.mktemp('bags') / 'long', SAMPLES, storage, compressed)


def timed(benchmark, bag, read):
    name, file = bag
    benchmark.extra_info['messages'] = MESSAGES
    benchmark.group = f'read {SAMPLES * len(topics()):,} messages, {name}'
    return benchmark.pedantic(read, args=(file,), rounds=ROUNDS, warmup_rounds=1 if read is read_recording else 0)


def test_reading(benchmark, bag):
    assert len(timed(benchmark, bag, read_recording).displacement) == SAMPLES


def test_reading_with_rosbags(benchmark, bag):
    assert timed(benchmark, bag, read_with_rosbags) == SAMPLES * len(topics())
