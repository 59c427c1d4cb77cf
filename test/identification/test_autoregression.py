# SPDX-License-Identifier: Apache-2.0
"""The colour of noise: known autoregressions are found again, taken out, and counted for what they are worth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from cfd_pneumatic.identification.residual.linear_prediction import (
    autocovariance,
    autoregression,
    independent_share,
    whitened,
)

SEEDS = range(100)
RINGING = np.array([1.5, -0.8])
"""Poles of modulus 0.89."""


def noise(coefficients, seed, samples=4000, before=500):
    """Return autoregressive noise, and the white noise it is made of."""
    white = np.random.default_rng(seed).standard_normal(before + samples)
    made = lfilter([1.0], np.concatenate([[1.0], -np.asarray(coefficients)]), white)
    return made[before:], white[before:]


def test_finds_a_memory_of_one_sample():
    found = [autoregression([noise([0.9], seed)[0]]) for seed in SEEDS]
    exact = [one[0] for one in found if one.size == 1]
    assert len(exact) >= 0.95 * len(found), 'a longer memory is a chance find'
    std = np.sqrt((1.0 - 0.9**2) / 4000)  # of an efficient estimate
    assert np.std(exact) == pytest.approx(std, rel=0.3)
    assert np.mean(exact) == pytest.approx(0.9, abs=(1.0 + 3.0 * 0.9) / 4000 + 4.0 * std / np.sqrt(len(exact)))


def test_finds_a_memory_that_rings():
    found = [autoregression([noise(RINGING, seed)[0]]) for seed in SEEDS]
    exact = np.array([one for one in found if one.size == 2])
    assert len(exact) >= 0.95 * len(found)
    std = np.sqrt((1.0 - 0.8**2) / 4000)
    np.testing.assert_allclose(np.mean(exact, axis=0), RINGING, atol=3e-3)
    np.testing.assert_allclose(np.std(exact, axis=0), std, rtol=0.3)


def test_white_noise_has_none():
    orders = [autoregression([noise([], seed, samples=1000)[0]]).size for seed in range(200)]
    assert np.mean(np.array(orders) == 0) >= 0.97


def test_short_series_count_together():
    """Each of 20 tells too little; that they are joined end to end must not matter."""
    parts = [noise([0.9], seed, samples=200)[0] + 0.0 for seed in range(20)]
    (coefficient,) = autoregression(parts)
    assert coefficient == pytest.approx(0.9, abs=0.03)
    assert autoregression([parts[0][:30]]).size <= 1, 'an order needs twenty samples'


@pytest.mark.parametrize('nothing', [[], [np.zeros(500)], [np.zeros(3), np.empty(0)]])
@pytest.mark.filterwarnings('error')
def test_nothing_has_no_colour(nothing):
    assert autoregression(nothing).size == 0


@given(seed=st.integers(0, 2**31), sizes=st.lists(st.integers(0, 30), min_size=1, max_size=4), lags=st.integers(0, 12))
def test_products_do_not_reach_from_one_series_to_the_next(seed, sizes, lags):
    rng = np.random.default_rng(seed)
    series = [rng.standard_normal(size) for size in sizes]
    expected = [
        sum(one[i] * one[i + lag] for one in series for i in range(one.size - lag)) / max(sum(sizes), 1)
        for lag in range(lags + 1)
    ]
    np.testing.assert_allclose(autocovariance(series, lags), expected, atol=1e-12)


@given(coefficient=st.floats(-0.95, 0.95), seed=st.integers(0, 2**31))
def test_what_is_new_in_each_sample_is_what_it_was_made_of(coefficient, seed):
    made, white = noise([coefficient], seed, samples=50, before=0)
    np.testing.assert_allclose(whitened(made, np.array([coefficient])), white, atol=1e-12)


@pytest.mark.parametrize('coefficients', [[0.9], RINGING, [-0.5]], ids=str)
def test_without_its_own_colour_noise_is_white(coefficients):
    for seed in range(10):
        made, _ = noise(coefficients, seed)
        new = whitened(made, autoregression([made]))
        covariance = autocovariance([new], 10)
        assert np.max(np.abs(covariance[1:] / covariance[0])) < 4.0 / np.sqrt(new.size)
        assert np.std(new) == pytest.approx(1.0, rel=0.06)


@given(coefficient=st.floats(0.0, 0.98))
def test_a_sample_that_remembers_is_worth_less(coefficient):
    """The mean of n samples has the variance of (1 - r) / (1 + r) n independent ones."""
    share = independent_share(np.array([coefficient]))
    assert share == pytest.approx((1.0 - coefficient) / (1.0 + coefficient), rel=1e-9)


def test_a_white_sample_is_worth_one():
    assert independent_share(np.empty(0)) == 1.0


def test_a_sample_is_never_worth_more_than_one():
    assert independent_share(np.array([-0.5])) == 1.0


def test_the_worth_of_a_sample_is_how_means_scatter():
    remembering = np.array([0.5, 0.3])
    runs = [noise(remembering, seed, samples=2000)[0] for seed in range(400)]
    scatter = np.var([np.mean(run) for run in runs])
    independent = np.mean([np.var(run) for run in runs]) / scatter
    assert independent / 2000 == pytest.approx(independent_share(remembering), rel=4.0 * np.sqrt(2.0 / 400))
