# SPDX-License-Identifier: Apache-2.0
"""How long a CUSUM chart runs until a false alarm: against the exact answer, and against chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import norm, poisson

from cfd_pneumatic.monitoring.chart import Chart, learn_series
from cfd_pneumatic.monitoring.run_length import (
    SLACK,
    Excursions,
    find_excursions,
    mean_run_length,
    raise_threshold,
    threshold_for,
)


def exact_mean_run(threshold: float, shift: float, spread: float, states: int = 400) -> float:
    """Return the mean run by a Markov chain over the sum's values (Brook and Evans, 1972)."""
    width = 2.0 * threshold / (2 * states - 1)
    middles = width * np.arange(states)
    change = middles[None, :] - middles[:, None] + SLACK - shift
    upper, lower = norm.cdf((change + 0.5 * width) / spread), norm.cdf((change - 0.5 * width) / spread)
    moves = upper - lower
    moves[:, 0] = upper[:, 0]
    return float(np.linalg.solve(np.eye(states) - moves, np.ones(states))[0])


@pytest.mark.parametrize('threshold', [4.0, 8.0, 13.0])
@pytest.mark.parametrize(
    ('shift', 'spread'), [(0.0, 1.0), (0.1, 1.0), (-0.1, 1.0), (0.0, 1.05), (1.0, 1.0), (0.5, 1.0)]
)
def test_the_mean_run_is_the_exact_one(threshold: float, shift: float, spread: float) -> None:
    assert mean_run_length(threshold, SLACK, shift, spread) == pytest.approx(
        exact_mean_run(threshold, shift, spread), rel=0.03
    )


@given(wanted=st.floats(1e2, 1e10), learned=st.integers(100, 10**6))
def test_a_threshold_grows_with_the_run_that_is_wanted_and_with_what_was_not_learned(
    wanted: float, learned: int
) -> None:
    threshold = threshold_for(wanted, learned)
    assert threshold_for(2.0 * wanted, learned) > threshold
    assert threshold_for(wanted, 2 * learned) < threshold
    assert mean_run_length(threshold) > wanted


def test_where_much_was_learned_the_threshold_is_that_of_the_mean_run_alone() -> None:
    assert mean_run_length(threshold_for(1e6, 10**9)) == pytest.approx(1e6, rel=1e-2)


def alarms(chart: Chart, values: np.ndarray) -> int:
    """Return how often a chart rings."""
    count, left = 0, values
    while (at := chart.update(left)) >= 0:
        count += 1
        chart.reset_sums()
        left = left[at + 1 :]
    return count


@pytest.mark.parametrize('memory', [0.0, 0.4])
def test_false_alarms_are_as_rare_as_is_wanted_on_the_average_over_what_was_learned(memory: float) -> None:
    rng = np.random.default_rng(3)
    wanted, runs, length = 5e3, 300, 50_000
    rung = 0
    for _ in range(runs):
        noise = lfilter([1.0], [1.0, -memory], rng.standard_normal(300 + length))
        rung += alarms(Chart(learn_series(noise[:300]), wanted, two_sided=True), noise[300:])
    expected = runs * length / wanted
    assert poisson.ppf(1e-4, 0.75 * expected) < rung < poisson.ppf(1.0 - 1e-4, 1.6 * expected)


def heavy(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return scores of which large ones are frequent."""
    return rng.standard_t(3.0, size)


def by_regime(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return scores whose mean is another one for each of a few set-points, which are held for some time."""
    errors = rng.normal(0.0, 0.5, 7)
    held = np.repeat(rng.integers(0, errors.size, size), rng.integers(5, 20, size))[:size]
    return errors[held] + rng.standard_normal(size)


@pytest.mark.parametrize('scores', [heavy, by_regime])
def test_what_a_poor_model_leaves_rings_hardly_more_often(
    scores: Callable[[np.random.Generator, int], np.ndarray],
) -> None:
    rng = np.random.default_rng(4)
    wanted, runs, length = 2e4, 60, 100_000
    rung = as_if_normal = 0
    for _ in range(runs):
        values = scores(rng, 1500 + length)
        learned = learn_series(values[:1500])
        rung += alarms(Chart(learned, wanted, two_sided=True), values[1500:])
        unaware = replace(learned, excursions=(Excursions(), Excursions()))
        as_if_normal += alarms(Chart(unaware, wanted, two_sided=True), values[1500:])
    expected = runs * length / wanted
    assert rung < 2.5 * expected
    assert as_if_normal > 3.0 * expected


def test_excursions_are_those_of_the_sum() -> None:
    assert find_excursions(np.array([2.0, -9.0, 3.0, 1.5, -9.0, 1.0]), 0.5) == Excursions(1, 2.0)


@given(st.floats(3.0, 30.0), st.integers(0, 10**6), st.floats(0.0, 50.0))
def test_excursions_never_lower_a_threshold_and_larger_ones_raise_it(threshold: float, count: int, mean: float) -> None:
    raised = raise_threshold(threshold, Excursions(count, count * mean))
    assert threshold <= raised < np.inf
    assert raise_threshold(threshold, Excursions(count, 1.5 * count * mean)) >= raised


def test_many_excursions_stretch_the_threshold_as_they_are_larger_than_normal_ones() -> None:
    assert raise_threshold(13.0, Excursions(10**9, 2.0 * 10**9)) == pytest.approx(1.5 + 2.0 * 11.5, rel=1e-6)
    assert raise_threshold(13.0, Excursions(10**9, 1.0 * 10**9)) == 13.0
