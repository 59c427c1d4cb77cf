# SPDX-License-Identifier: Apache-2.0
"""Charts of drifts: every value is there, at its place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.charts import Chart, chart_element
from cfd_pneumatic.plant.drift_chart import Curve, drift_chart

VALUES = st.one_of(st.none(), st.floats(-1e9, 1e9, width=32))
POINTS = st.lists(st.tuples(VALUES, st.floats(0.0, 1e6, width=32)), min_size=1, max_size=30).filter(
    lambda points: any(value is not None for value, _ in points)
)


def chart(values, stds=None, marks=()) -> Chart:
    curve = Curve('before', values, stds or [None] * len(values))
    return drift_chart(range(len(values)), 'bag', [curve], marks, 'k_x [Pa/m]', 'k_x <drifts>')


@given(POINTS)
def test_it_stays_inside_and_has_every_value(points):
    values, stds = zip(*points)
    drawn = chart(values, stds)
    (panel,) = drawn.panels
    low, high = panel.range
    dots = panel.curves[-1]
    assert (dots.style == 'dots') == (len(dots.x) <= 12)
    assert dots.x.tolist() == [place for place, value in enumerate(values) if value is not None]
    assert dots.y.tolist() == [value for value in values if value is not None]
    for curve in panel.curves:
        assert np.all((curve.x >= drawn.span[0]) & (curve.x <= drawn.span[1]))
        assert np.all((curve.y >= low) & (curve.y <= high))
    assert chart_element(drawn).startswith('<figure')


def test_what_hardly_varies_is_drawn_flat():
    low, high = chart([1.0, 1.0001]).panels[0].range
    assert high - low > 0.02


def test_the_thin_lines_are_one_standard_error_to_both_sides():
    lower, upper, line, _ = chart([10.0, 20.0], [1.0, 5.0]).panels[0].curves
    assert (upper.y - line.y).tolist() == (line.y - lower.y).tolist() == [1.0, 5.0]


def test_a_change_is_marked():
    assert chart([1.0, 2.0, 3.0], marks=[2]).marks == [2.0]


def test_one_value_has_a_width():
    begin, end = chart([5.0]).span
    assert end - begin == pytest.approx(1.0)
