"""How long a CUSUM chart runs until a false alarm: against the exact answer, and against chance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import norm, poisson

from cfd_pneumatic.monitoring.chart import Chart, usual
from cfd_pneumatic.monitoring.run_length import SLACK, mean_run, threshold_for


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
    assert mean_run(threshold, SLACK, shift, spread) == pytest.approx(
        exact_mean_run(threshold, shift, spread), rel=0.03
    )


@given(wanted=st.floats(1e2, 1e10), learned=st.integers(100, 10**6))
def test_a_threshold_grows_with_the_run_that_is_wanted_and_with_what_was_not_learned(
    wanted: float, learned: int
) -> None:
    threshold = threshold_for(wanted, learned)
    assert threshold_for(2.0 * wanted, learned) > threshold
    assert threshold_for(wanted, 2 * learned) < threshold
    assert mean_run(threshold) > wanted


def test_where_much_was_learned_the_threshold_is_that_of_the_mean_run_alone() -> None:
    assert mean_run(threshold_for(1e6, 10**9)) == pytest.approx(1e6, rel=1e-2)


@pytest.mark.parametrize('memory', [0.0, 0.4])
def test_false_alarms_are_as_rare_as_is_wanted_on_the_average_over_what_was_learned(memory: float) -> None:
    rng = np.random.default_rng(3)
    wanted, runs, length = 5e3, 300, 50_000
    alarms = 0
    for _ in range(runs):
        noise = lfilter([1.0], [1.0, -memory], rng.standard_normal(300 + length))
        chart = Chart(usual(noise[:300]), wanted, two_sided=True)
        left = noise[300:]
        while (at := chart.take(left)) >= 0:
            alarms += 1
            chart.again()
            left = left[at + 1 :]
    expected = runs * length / wanted
    assert poisson.ppf(1e-4, 0.75 * expected) < alarms < poisson.ppf(1.0 - 1e-4, 1.6 * expected)
