# SPDX-License-Identifier: Apache-2.0
"""Cuts that leave motion in every part, and say so where there is none to leave."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.identification.data.split import PARTS, split_recordings, stroke_times, turning_points


def triangle(strokes, samples_each=50, amplitude=1e-2):
    corners = np.arange(strokes + 1)
    return np.interp(np.linspace(0, strokes, strokes * samples_each + 1), corners, amplitude * (corners % 2))


@given(st.integers(1, 40), st.floats(1e-4, 1e-1))
def test_finds_each_reversal(strokes, amplitude):
    points = turning_points(triangle(strokes, amplitude=amplitude), 0.05 * amplitude)
    np.testing.assert_array_equal(points, np.arange(strokes + 1) * 50)


def test_noise_is_no_motion():
    noise = np.random.default_rng(0).normal(size=2000) * 1e-5
    assert stroke_times(np.arange(2000.0), noise, 1e-5).size == 0


def test_noise_on_a_stroke_is_no_reversal():
    rng = np.random.default_rng(1)
    displacement = triangle(8) + rng.normal(size=401) * 4e-5
    assert stroke_times(np.arange(401.0), displacement, 4e-5).size == 9


@given(st.integers(5, 60), st.floats(0.2, 0.8), st.floats(0.1, 0.9))
def test_every_part_holds_a_stroke_of_its_own(strokes, train, share):
    fractions = (train, (1.0 - train) * share, (1.0 - train) * (1.0 - share))
    times = np.arange(strokes * 50 + 1.0)
    (split,), reason = split_recordings([stroke_times(times, triangle(strokes), 1e-6)], fractions)
    assert reason is None
    assert min(split.strokes) >= 1
    assert sum(split.strokes) == strokes
    parts = split.part_of(times)
    assert np.all(np.diff(parts) >= 0)
    assert set(parts) == {0, 1, 2}


def test_cuts_at_whole_strokes_near_the_wanted_shares():
    times = np.arange(1001.0)
    (split,), _ = split_recordings([stroke_times(times, triangle(20), 1e-6)])
    assert split.bounds == (600.0, 800.0)
    assert split.strokes == (12, 4, 4)


def test_a_single_step_has_no_honest_test_part():
    times = np.arange(51.0)
    (split,), reason = split_recordings([stroke_times(times, triangle(1), 1e-6)])
    assert '1 stroke in 1 recording' in reason
    assert np.all(split.part_of(times) == PARTS.index('train'))


def test_single_steps_are_dealt_out_whole():
    times = np.arange(101.0)
    still = np.concatenate([np.zeros(50), triangle(1)])
    strokes = stroke_times(times, still, 1e-6)
    splits, reason = split_recordings([strokes] * 5)
    assert reason is None
    assert [split.whole for split in splits] == ['train', 'train', 'train', 'validation', 'test']
    # the rest before the stroke tells the recording's set-point, and is no test
    parts = splits[-1].part_of(times)
    np.testing.assert_array_equal(parts, np.where(times >= strokes[0], PARTS.index('test'), PARTS.index('train')))


@pytest.mark.parametrize('count', [1, 2])
def test_too_few_steps_for_a_test_are_all_train(count):
    splits, reason = split_recordings([np.array([1.0, 2.0])] * count)
    assert reason is not None
    assert {split.whole for split in splits} == {'train'}
