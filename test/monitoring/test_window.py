# SPDX-License-Identifier: Apache-2.0
"""The last seconds as a recording."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.monitoring.window import RollingSignal, Window

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


@given(st.lists(st.integers(-5, 3 * SECOND), min_size=1, max_size=100))
def test_a_track_keeps_the_last_seconds_in_order(steps: list[int]) -> None:
    signal = RollingSignal(5 * SECOND)
    stamps = (EPOCH + np.cumsum(steps)).tolist()
    for index, stamp in enumerate(stamps):
        signal.append(stamp, float(index))
    end = max(stamps)
    kept = signal.between(end - 5 * SECOND, end, EPOCH)
    expected = [(stamp, index) for index, stamp in enumerate(stamps) if stamp > max([-1, *stamps[:index]])]
    expected = [(stamp, index) for stamp, index in expected if stamp >= end - 5 * SECOND]
    assert np.round(kept.times * SECOND).astype(int).tolist() == [stamp - EPOCH for stamp, _ in expected]
    assert kept.values.tolist() == [index for _, index in expected]


def filled(seconds: float, force_from: float) -> Window:
    window = Window(10.0)
    for index in range(round(seconds * 100)):
        stamp = EPOCH + index * SECOND // 100
        window.displacement.append(stamp, index * 1e-6)
        window.pressures['cylinder_a'].append(stamp, 2e5)
        if index >= force_from * 100:
            window.force.append(stamp, 1.0)
        if index in (0, 100, 1800):
            window.setpoints['cylinder_a'].append(stamp, 2e5 + index)
    return window


def test_a_window_is_a_recording_of_what_was_heard_all_the_time() -> None:
    window = filled(20.0, force_from=15.0)
    end = EPOCH + 20 * SECOND
    recording = window.recording(end - 10 * SECOND, end)
    assert set(recording.cylinders) == {'cylinder_a'}
    assert recording.force is None
    assert len(recording.displacement) == 1000
    setpoint = recording.cylinders['cylinder_a'].setpoint
    assert setpoint.times.tolist() == [0.0, 8.0]
    assert setpoint.values.tolist() == [2e5 + 100, 2e5 + 1800]
    assert window.recording(end - 4 * SECOND, end).force is not None
    window.clear()
    assert window.begin == 0
