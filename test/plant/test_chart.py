# SPDX-License-Identifier: Apache-2.0
"""Small charts: every value is there, at its place."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.plant.drift_chart import HEIGHT, WIDTH, Curve, drift_chart

VALUES = st.one_of(st.none(), st.floats(-1e9, 1e9, width=32))
POINTS = st.lists(st.tuples(VALUES, st.floats(0.0, 1e6, width=32)), min_size=1, max_size=30).filter(
    lambda points: any(value is not None for value, _ in points)
)


def path(svg, kind):
    """Return the points of a path, run by run."""
    data = re.search(rf'class="{kind}[^"]*" d="([^"]*)"', svg)
    runs = []
    for run in filter(None, data[1].split('M') if data else []):
        x, y, *steps = map(int, re.findall(r'-?\d+', run.replace('h0', '')))
        points = [(x, y)]
        for across, down in zip(steps[::2], steps[1::2]):
            x, y = x + across, y + down
            points.append((x, y))
        runs.append(points)
    return runs


def chart(values, stds=None, marks=()):
    places = [rank / max(len(values) - 1, 1) for rank in range(len(values))]
    return drift_chart(places, [Curve('before', values, stds or [None] * len(values))], marks, 'k_x <drifts>')


@given(POINTS)
def test_it_stays_inside_and_has_every_value(points):
    values, stds = zip(*points)
    svg = chart(values, stds)
    drawn = [point for run in [*path(svg, 'line'), *path(svg, 'dot')] for point in run]
    assert len(drawn) == sum(value is not None for value in values)
    for x, y in [*drawn, *(point for run in path(svg, 'band') for point in run)]:
        assert 0 <= x <= WIDTH
        assert 0 <= y <= HEIGHT


def test_more_is_higher():
    ((_, low), (_, high)), *_ = path(chart([1.0, 2.0]), 'line')
    assert high < low


def test_a_gap_parts_the_line_and_a_value_alone_is_a_dot():
    svg = chart([1.0, 2.0, None, 3.0, None, 4.0, 5.0, 6.0])
    assert [len(run) for run in path(svg, 'line')] == [2, 3]
    assert [len(run) for run in path(svg, 'dot')] == [1]


def test_what_hardly_varies_is_drawn_flat():
    ((_, one), (_, other)), *_ = path(chart([1.0, 1.0001]), 'line')
    assert abs(one - other) <= 1


def test_the_band_is_one_standard_error_to_both_sides():
    (line,), (band,) = (path(chart([10.0, 20.0], [1.0, 5.0]), kind) for kind in ('line', 'band'))
    scale = (line[0][1] - line[1][1]) / 10.0
    heights = [band[3][1] - band[0][1], band[2][1] - band[1][1]]
    assert heights == pytest.approx([2.0 * scale, 10.0 * scale], abs=2)


def test_marks_stand_at_their_bags():
    assert 'M8 0v120' in chart([1.0, 2.0], marks=[0])
    assert '"mark"' not in chart([1.0, 2.0])


def test_its_label_is_escaped():
    assert 'aria-label="k_x &lt;drifts&gt;"' in chart([1.0])
