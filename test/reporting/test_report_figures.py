# SPDX-License-Identifier: Apache-2.0
"""What the figures of the page are made of."""

from __future__ import annotations

import re

import numpy as np
import pytest
from identified import closed, judged

from cfd_pneumatic.charts import svg, thinned
from cfd_pneumatic.identification.characteristic import Characteristic
from cfd_pneumatic.reporting import figures


@pytest.fixture(scope='module')
def outcome():
    return closed().closed[0]


def test_thinning_keeps_what_can_be_seen():
    rng = np.random.default_rng(0)
    times = np.arange(100_000) * 1e-3
    values = rng.standard_normal(times.size)
    values[54_321] = 40.0
    few_times, few = thinned(times, values, 500)
    assert few.size <= 1000
    assert np.all(np.diff(few_times) > 0.0)
    assert (few.max(), few.min()) == (40.0, values.min())
    for column in np.array_split(np.arange(times.size), 500)[10:20]:
        inside = (few_times >= times[column[0]]) & (few_times <= times[column[-1]])
        assert few[inside].max() == pytest.approx(values[column].max(), abs=0.2)


def test_a_short_series_stays_as_it_is():
    times = np.arange(5.0)
    assert thinned(times, times, 3)[1] is times


def test_thinning_with_gaps_in_time():
    times = np.concatenate([np.arange(1000) * 1e-3, 100.0 + np.arange(1000) * 1e-3])
    few_times, few = thinned(times, np.sin(times), 50)
    assert few.size <= 100
    assert few_times.size == few.size


@pytest.mark.parametrize('lag', [-7, 0, 12])
def test_a_correlation_stands_at_the_lag_by_which_the_residual_is_later(lag):
    rng = np.random.default_rng(1)
    drive = rng.standard_normal(4000)
    residual = np.roll(drive, lag) + rng.standard_normal(drive.size)
    lags, values, limit = figures.crosscorrelation([residual], [drive], 20, 60)
    assert lags[np.argmax(values)] == lag
    assert values.max() == pytest.approx(np.sqrt(0.5), abs=0.05)
    assert np.count_nonzero(np.abs(values) > limit) <= 2


def test_independent_series_with_memories_cross_the_threshold_seldom():
    beyond = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        slow = [np.convolve(rng.standard_normal(5000), np.ones(20), 'valid') for _ in range(2)]
        _, values, limit = figures.crosscorrelation([slow[0] - slow[0].mean()], [slow[1] - slow[1].mean()], 20, 60)
        beyond += bool(np.any(np.abs(values) > limit))
    assert beyond <= 2


def test_numbers_on_axes_are_whole(outcome):
    """0.025 must not become 0.02."""
    picture = svg(figures.correlation_charts(outcome)[0], 340)
    ticks = [float(text.replace('−', '-')) for text in re.findall(r'>(−?\d+\.\d+)<', picture)]
    assert len(ticks) >= 3
    np.testing.assert_allclose(np.diff(sorted(ticks)), np.diff(sorted(ticks))[0], rtol=1e-6)


def test_a_curve_that_leaves_out_nothing_visible_is_small(outcome):
    chart = figures.record_chart(outcome, outcome.comparisons[0])
    wide, narrow = (len(svg(chart, width)) for width in (1000, 380))
    assert wide < 100_000
    assert narrow < 0.6 * wide


def test_the_zoom_shows_where_effects_take_most(outcome):
    window = figures.zoom_window(outcome)
    before, after = (window.comparison.residual(which) for which in (0, 1))
    shown = (window.comparison.times >= window.begin) & (window.comparison.times <= window.end)
    taken = before**2 - after**2
    assert taken[shown].mean() > 2.0 * taken.mean()


def test_the_zoom_of_an_unexplained_one_shows_where_most_is_left(outcome):
    changed = judged(closed(), 'unexplained', 'who knows').closed[0]
    window = figures.zoom_window(changed)
    after = window.comparison.residual(1)
    shown = (window.comparison.times >= window.begin) & (window.comparison.times <= window.end)
    assert np.mean(after[shown] ** 2) > np.mean(after**2)


def test_a_law_is_drawn_with_its_band_and_grey_where_nobody_has_been():
    at = np.linspace(-1e-3, 1e-3, 41)
    value = 0.1 * np.exp(-((at / 3e-4) ** 2))
    law = Characteristic('gain', 'x', (), at, value, value - 0.02, value + 0.03, at > -5e-4, 0.5)
    chart = figures.characteristic_chart(law)
    for drawing in (svg(chart, width) for width in (1000, 380)):
        assert 'swept volume and stiffness K_x, more by [%]' in drawing
        assert 'displacement [mm]' in drawing
        assert (drawing.count(figures.MUTED), drawing.count(figures.AFTER)) == (1, 3)
    assert 'the volume that the piston sweeps varies by 10 %, depending on the position of the piston' in chart.caption
