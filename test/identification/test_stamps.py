# SPDX-License-Identifier: Apache-2.0
"""Stamps that jitter about a regular clock, told from irregular sampling."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cfd_pneumatic.identification.data.stamps import overlapping_windows, regular_clock

PERIOD = 0.002
JITTER = 5e-5


def ticking(seed, samples=5000, missed=0.0):
    """Return a regular clock [s], some of its ticks missed, and generator."""
    rng = np.random.default_rng(seed)
    clock = PERIOD * np.arange(samples)
    return clock[rng.random(samples) >= missed], rng


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('missed', [0.0, 0.02, 0.2])
def test_finds_the_clock_behind_the_jitter(seed, missed):
    clock, rng = ticking(seed, missed=missed)
    found = regular_clock(clock + JITTER * rng.normal(size=clock.size))
    assert found is not None
    assert np.std(found - clock) < 0.15 * JITTER


def test_finds_a_clock_that_drifts():
    clock, rng = ticking(0)
    drifting = clock + 1e-3 * np.sin(2.0 * np.pi * clock / 5.0)
    found = regular_clock(drifting + JITTER * rng.normal(size=clock.size))
    assert found is not None
    assert np.std(found - drifting) < 0.3 * JITTER


def test_finds_the_clock_across_a_pause():
    clock, rng = ticking(0)
    clock = clock[(clock < 3.0) | (clock > 3.4)]
    found = regular_clock(clock + JITTER * rng.normal(size=clock.size))
    assert found is not None
    assert np.std(found - clock) < 0.15 * JITTER


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('steps', [(0.010, 0.011, 0.012), (0.010, 0.017), (0.002, 0.0021)])
@pytest.mark.parametrize('samples', [60, 200, 3000])
def test_steps_drawn_anew_are_no_jitter(steps, seed, samples):
    assert regular_clock(np.cumsum(np.random.default_rng(seed).choice(steps, samples))) is None


def test_a_clock_without_jitter_needs_no_other():
    assert regular_clock(np.arange(2048) / 512.0) is None


def test_too_few_stamps_tell_no_clock():
    clock, rng = ticking(0, samples=99)
    assert regular_clock(clock + JITTER * rng.normal(size=99)) is None


def test_jitter_of_half_a_period_is_no_clock():
    clock, rng = ticking(0)
    assert regular_clock(np.sort(clock + 0.5 * PERIOD * rng.normal(size=clock.size))) is None


@given(begin=st.floats(-1e3, 1e3), second=st.floats(1e-3, 1e3), samples=st.integers(150, 500), seed=st.integers(0, 99))
@example(begin=0.0, second=1.0, samples=187, seed=73)  # by chance its steps look as if they were drawn anew
def test_origin_and_unit_of_time_do_not_matter(begin, second, samples, seed):
    clock, rng = ticking(seed, samples)
    stamps = clock + JITTER * rng.normal(size=samples)
    plain, other = regular_clock(stamps), regular_clock(second * (stamps + begin))
    assert (other is None) == (plain is None)
    if plain is not None:
        np.testing.assert_allclose(other / second - begin, plain, atol=1e-3 * JITTER)


@given(count=st.integers(1, 300), size=st.integers(1, 90), margin=st.integers(0, 20))
def test_overlapping_windows_cover_an_array(count, size, margin):
    own, around = zip(*overlapping_windows(count, size, margin))
    everything = np.arange(count)
    np.testing.assert_array_equal(np.concatenate([everything[one] for one in own]), everything)
    for one, window in zip(own, around):
        np.testing.assert_array_equal(
            everything[window], everything[max(one.start - margin, 0) : min(one.stop + margin, count)]
        )
