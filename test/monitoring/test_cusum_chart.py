# SPDX-License-Identifier: Apache-2.0
"""A CUSUM chart: what it is told by, and what it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.monitoring.chart import Chart, SeriesModel, learn_series

PLAIN = SeriesModel(mean=0.0, coefficients=np.empty(0), std=1.0, tolerance=0.0, learned_from=10**9)
values = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=60)


def path(chart: Chart, series: list[float]) -> list[float]:
    return [chart.alarm_proximity for value in series if chart.update(np.array([value])) < 2]


@given(values)
def test_values_one_by_one_and_all_at_once_are_the_same(series: list[float]) -> None:
    coloured = SeriesModel(0.3, np.array([0.5, -0.2]), 1.5, 0.1, 1000)
    one, all_at_once = Chart(coloured, 1e4, two_sided=True), Chart(coloured, 1e4, two_sided=True)
    by_one = next((index for index, value in enumerate(series) if one.update(np.array([value])) == 0), -1)
    assert all_at_once.update(np.array(series)) == by_one
    assert all_at_once.alarm_proximity == one.alarm_proximity


@given(values)
def test_up_and_down_are_alike(series: list[float]) -> None:
    up, down = Chart(PLAIN, 1e4, two_sided=True), Chart(PLAIN, 1e4, two_sided=True)
    assert up.update(np.array(series)) == down.update(-np.array(series))


@given(st.floats(-1e12, 1e12), st.integers(0, 40))
def test_no_single_value_gives_an_alarm(value: float, at: int) -> None:
    series = np.zeros(50)
    series[at] = value
    assert Chart(PLAIN, 1e4, two_sided=True).update(series) == -1


@given(values)
def test_a_mean_within_the_tolerance_gives_no_alarm_but_by_noise(series: list[float]) -> None:
    tolerant = Chart(SeriesModel(0.0, np.empty(0), 1.0, 3.0, 10**9), 1e4, two_sided=True)
    assert tolerant.update(np.full(100_000, 3.0)) == -1
    assert tolerant.update(np.full(100_000, 3.6)) >= 0
    assert path(tolerant, series)[-1] >= 0.0


@pytest.mark.parametrize('shift', [1.0, 2.0, 3.0])
def test_a_lasting_shift_is_met_after_the_threshold_over_what_exceeds_the_slack(shift: float) -> None:
    rng = np.random.default_rng(1)
    delays, runs = [], []
    for _ in range(200):
        chart = Chart(PLAIN, 1e6, two_sided=True)
        assert chart.update(np.zeros(100)) == -1
        delays.append(chart.update(rng.standard_normal(2000) + shift) + 1)
        runs.append(chart.values_since_change)
    assert np.mean(delays) == pytest.approx((chart.thresholds[0] + 1.0) / (shift - 0.5), rel=0.1)
    assert np.median(np.abs(np.subtract(runs, delays))) <= 3, 'it knows since when'


def test_one_side_alone_does_not_hear_the_other() -> None:
    assert Chart(PLAIN, 1e4, two_sided=False).update(np.full(1000, -3.0)) == -1
    assert Chart(PLAIN, 1e4, two_sided=False).update(np.full(1000, 3.0)) >= 0


def test_what_is_usual_is_learned_with_its_memory_and_without_its_outliers() -> None:
    rng = np.random.default_rng(2)
    noise = 2.0 * rng.standard_normal(20_000)
    for index in range(1, noise.size):
        noise[index] += 0.6 * noise[index - 1]
    series = noise + 7.0
    series[::2000] += 1e3
    learned = learn_series(series)
    assert learned.mean == pytest.approx(7.0, abs=0.2)
    assert 2.0 < learned.std < 2.3
    assert learned.dc_gain == pytest.approx(0.4, abs=0.05)
