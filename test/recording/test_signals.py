# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from recording_cases import recording, signals

from cfd_pneumatic.recording import Signal

TIMES = st.lists(st.integers(0, 100), unique=True, max_size=20).map(sorted)


def signal(times):
    return Signal(np.array(times, float), np.arange(len(times), dtype=float))


@given(TIMES, st.integers(-5, 105), st.integers(-5, 105))
def test_a_window_holds_what_lies_in_it(times, begin, end):
    window = signal(times).between(begin, end)
    assert window.times.tolist() == [time for time in times if begin <= time < end]
    assert window.values.tolist() == [times.index(time) for time in window.times]


@given(TIMES, st.lists(st.integers(-5, 105), min_size=2, max_size=6).map(sorted))
def test_windows_side_by_side_are_the_signal_again(times, edges):
    whole = signal(times)
    windows = [whole.between(begin, end) for begin, end in zip([-10, *edges], [*edges, 110])]
    np.testing.assert_array_equal(np.concatenate([window.times for window in windows]), whole.times)
    np.testing.assert_array_equal(np.concatenate([window.values for window in windows]), whole.values)


def held(setpoint, time):
    """Return the value that acts at a time: what was set last, or the first where nothing was yet."""
    return setpoint.values[max(int(np.searchsorted(setpoint.times, time, side='right')) - 1, 0)]


@given(TIMES.filter(bool), st.integers(-5, 105), st.integers(1, 50), st.floats(0.0, 0.99))
def test_in_a_window_the_same_setpoint_acts(times, begin, length, part):
    setpoint = signal(times)
    window = setpoint.holding_between(begin, begin + length)
    moment = begin + part * length
    if len(window):
        assert held(window, moment) == held(setpoint, moment)
    else:
        assert begin + length <= times[0]
    assert set(window.times[1:]) <= {time for time in times if begin < time < begin + length}


def test_a_window_of_a_recording_is_one_of_each_signal():
    whole = recording(100, cylinders=('cylinder_a', 'cylinder_b'), force=True)
    window = whole.between(0.305, 0.6)
    assert window.epoch == whole.epoch
    assert signals(window).keys() == signals(whole).keys()
    for name, part in signals(window).items():
        if name.endswith('setpoint'):
            assert part.times.tolist() == [0.2]
        else:
            assert part.times[0] >= 0.305
            assert part.times[-1] < 0.6
            assert len(part) in (29, 30)
    bare = recording(100, setpoints=False).between(0.305, 0.6)
    assert bare.cylinders['cylinder_a'].setpoint is None
    assert bare.force is None
