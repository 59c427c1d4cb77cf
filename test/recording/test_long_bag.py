# SPDX-License-Identifier: Apache-2.0
"""The bags that reading is measured with hold what they say."""

from __future__ import annotations

import numpy as np
import pytest
from recording_cases import assert_same
from rosbags.rosbag2 import Reader

from cfd_pneumatic.recording import read_recording
from studies.trials.long_bag import topics, write_long_bag

SAMPLES = 22_000


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    return read_recording(write_long_bag(tmp_path_factory.mktemp('plain') / 'bag', SAMPLES, force=True))


def test_it_is_a_device_at_1_khz_with_steps_of_the_setpoint(plain):
    for signal in (plain.displacement, plain.force, *(parts.pressure for parts in plain.cylinders.values())):
        np.testing.assert_allclose(np.diff(signal.times), 1e-3, rtol=1e-6)
        assert len(signal) == SAMPLES
    assert np.ptp(plain.displacement.values) > 1e-3
    for parts in plain.cylinders.values():
        np.testing.assert_allclose(parts.setpoint.times, [0.0, 5.0, 14.999], atol=1.1e-3)
        before_the_step = (parts.pressure.times > 0.5) & (parts.pressure.times < 1.2)
        np.testing.assert_allclose(
            parts.pressure.values[before_the_step].mean(), parts.setpoint.values[0], rtol=1e-3, atol=0
        )
    assert plain.health == ()


@pytest.mark.parametrize(('storage', 'compressed'), [('mcap', True), ('sqlite3', False)])
def test_it_is_the_same_in_every_storage(tmp_path, plain, storage, compressed):
    file = write_long_bag(tmp_path / 'bag', SAMPLES, storage, compressed, force=True)
    assert_same(read_recording(file), plain)
    with Reader(file) as reader:
        assert [connection.topic for connection in reader.connections] == topics(force=True)
        assert reader.message_count == SAMPLES * len(topics(force=True))
