# SPDX-License-Identifier: Apache-2.0
"""Charts: round numbers beside the axes, curves where they belong, and elements of a page that are well-formed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.charts import Chart, Curve, Panel, Window, svg
from cfd_pneumatic.charts.svg import ticks_of

SVG = '{http://www.w3.org/2000/svg}'


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 12))
def test_numbers_are_round_within_the_range_and_told_apart(low, size, most):
    ticks = ticks_of((low, low + size), most)
    assert 1 <= len(ticks) <= most + 1 or size < 1e-9 * abs(low)
    for value, text in ticks:
        assert low - 1e-6 * size <= value <= low + size + 1e-6 * size
        assert float(text.replace('−', '-')) == pytest.approx(value, abs=1e-6 * size, rel=1e-12)
    assert len({text for _, text in ticks}) == len(ticks)


def test_lags_are_whole_numbers():
    assert [text for _, text in ticks_of((-1.0, 2.0), 6, whole=True)] == ['−1', '0', '1', '2']


def points(path: str) -> np.ndarray:
    """Return where a path goes, in pixels."""
    begin, moves = re.fullmatch(r'M(-?\d+ -?\d+)l(.*)', path).groups()
    steps = np.array(f'{begin} {moves}'.split(), dtype=float).reshape(-1, 2)
    return np.cumsum(steps, axis=0) / 10.0


def test_a_curve_is_drawn_to_a_tenth_of_a_pixel():
    x = np.linspace(2.0, 4.0, 500)
    y = np.sin(7.0 * x)
    chart = Chart([Panel('<up> & down', 200.0, [Curve(x, y, 'red')])], (2.0, 4.0), 's', 'a "sine"')
    root = ElementTree.fromstring(svg(chart, 1200))
    (path,) = (one for one in root.iter(f'{SVG}path') if one.get('stroke') == 'red')
    drawn = points(path.get('d'))
    assert np.allclose(np.interp(x, [2.0, 4.0], drawn[[0, -1], 0]), drawn[:, 0], atol=0.1)
    assert np.corrcoef(drawn[:, 1], -y)[0, 1] > 0.999999
    assert np.ptp(drawn[:, 1]) == pytest.approx(200.0 / 1.16, abs=0.2)  # 8 % are left above and below
    assert root.get('aria-label') == 'a "sine"'
    assert '<up> & down' in [one.text for one in root.iter(f'{SVG}text')]


def test_what_is_constant_or_empty_is_drawn_too():
    flat, none = np.full(3, 5.0), np.empty(0)
    for x, y in ((np.arange(3.0), flat), (none, none)):
        ElementTree.fromstring(svg(Chart([Panel('', 100.0, [Curve(x, y, 'red')])], (0.0, 2.0), '', ''), 300))


def red_paths(root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    return (path for path in root.iter(f'{SVG}path') if path.get('stroke') == 'red')


def heights(picture: str) -> np.ndarray:
    (path,) = red_paths(ElementTree.fromstring(picture))
    return points(path.get('d'))[:, 1]


def test_a_spike_does_not_hide_the_curve():
    x = np.linspace(0.0, 1.0, 900)
    y = np.sin(40.0 * x)
    y[450] = 1000.0
    panels = {robust: Panel('', 100.0, [Curve(x, y, 'red')], robust=robust) for robust in (False, True)}
    assert panels[True].range[1] < 2.0
    assert panels[False].range[1] > 1000.0
    robust, full = (heights(svg(Chart([panels[which]], (0.0, 1.0), '', ''), 2000)) for which in (True, False))
    assert np.ptp(np.delete(robust, 450)) > 50.0
    assert np.ptp(np.delete(full, 450)) < 1.0
    assert robust[450] == pytest.approx(24.0)  # at the upper edge


def test_a_window_shows_its_samples_as_dots():
    x = np.linspace(0.0, 100.0, 20_000)
    window = Window('here', 40.0, 41.0)
    chart = Chart([Panel('', 100.0, [Curve(x, np.sin(x), 'red', style='samples')])], (0.0, 100.0), '', 'all')
    whole, part = (ElementTree.fromstring(svg(chart, 1000, window)) for window in (None, window))
    paths = [next(red_paths(root)) for root in (whole, part)]
    assert 'h0' not in paths[0].get('d')
    assert paths[1].get('d').count('h0') == np.count_nonzero((x >= 40.0) & (x <= 41.0))
    assert part.get('aria-label').startswith('here, 40.00 to 41.00')
