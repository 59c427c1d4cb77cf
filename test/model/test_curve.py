# SPDX-License-Identifier: Apache-2.0
"""The generic effect: a curve that data have drawn, where it enters and on what it depends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.search.curve_places import CurvePlace
from cfd_pneumatic.model.effects import EFFECTS, FORCE_PARTS, GENERIC, PRESSURE_PARTS, Moment, curve
from cfd_pneumatic.model.effects.curve import AGAINST, ENTERS
from cfd_pneumatic.model.effects.knots import KNOTS

AMBIENT = 101325.0
VALUES = {'x': 0.3, 'speed': -0.4, 'p': 0.5, 'error': -0.6, 'flow': 0.7, 'time': 0.8}
MOMENT = Moment(
    time=VALUES['time'],
    x=VALUES['x'],
    rate=VALUES['speed'],
    p=AMBIENT + VALUES['p'],
    setpoint=AMBIENT,
    ambient=AMBIENT,
    p_f=AMBIENT - VALUES['error'],
)
HEIGHTS = tuple(np.linspace(-3.0, 2.0, KNOTS) ** 2)


def slot(enters: str = 'flow', against: str = 'x', crowd: float = 1e6, middle: float = 0.0) -> CurvePlace:
    return CurvePlace(enters, against, 0.1, -1.0, 1.0, middle, crowd, 1.0, Pressure.curve)


def height(place: CurvePlace, at: float, heights: tuple[float, ...] = HEIGHTS) -> float:
    """Return how much more flows than 1 Pa/s, as the kernel has it."""
    return curve.flow(1.0, MOMENT._replace(x=at), 0.0, *place.parameters(heights)) - 1.0


def test_it_is_no_effect_that_a_search_may_name() -> None:
    assert GENERIC.keys() == {'curve', 'force_curve'}
    assert GENERIC.keys().isdisjoint(EFFECTS)
    assert 'curve' in PRESSURE_PARTS
    assert 'force_curve' in FORCE_PARTS


@pytest.mark.parametrize('middle', [0.0, 0.7])
@pytest.mark.parametrize('crowd', [1e6, 0.3, 0.03])
@given(at=st.floats(-1.0, 1.0), heights=st.lists(st.floats(-1e3, 1e3), min_size=KNOTS, max_size=KNOTS).map(tuple))
def test_it_runs_straight_from_knot_to_knot(middle: float, crowd: float, at: float, heights: tuple[float, ...]) -> None:
    place = slot(crowd=crowd, middle=middle)
    expected = float(place.interpolation(np.array([at]))[0] @ np.array(heights))
    assert height(place, at, heights) == pytest.approx(expected, abs=1e-9)


def test_knots_crowd_about_the_middle_and_ends_stay() -> None:
    even, crowded = slot(), slot(crowd=0.1)
    for place in (even, crowded):
        assert height(place, -1.0) == pytest.approx(HEIGHTS[0])
        assert height(place, 1.0) == pytest.approx(HEIGHTS[-1])
        assert height(place, 0.0) == pytest.approx(HEIGHTS[KNOTS // 2])
    within = [
        np.count_nonzero(place.interpolation(np.linspace(-0.1, 0.1, 101)).max(axis=0) > 0.5)
        for place in (even, crowded)
    ]
    assert within[1] > within[0]


@pytest.mark.parametrize('middle', [0.0, 0.7])
@given(at=st.floats(-1.5, 2.0))
def test_over_another_range_an_even_line_is_the_same_and_the_middle_keeps_its_place(middle: float, at: float) -> None:
    near = slot(middle=middle)
    wide = near.with_range(-1.5, 2.0)
    assert (wide.middle + 1.5) / 3.5 == pytest.approx((near.middle + 1.0) / 2.0)
    assert height(wide, at, tuple(2.0 * wide.knots + 3.0)) == pytest.approx(2.0 * at + 3.0)
    ends = near.interpolation(wide.knots) @ np.array(HEIGHTS)
    assert (ends[0], ends[-1]) == pytest.approx((HEIGHTS[0], HEIGHTS[-1]))


def test_beyond_its_ends_it_stays_and_one_of_the_pressure_runs_on() -> None:
    assert (height(slot(), 1.2), height(slot(), -1.2)) == pytest.approx((HEIGHTS[-1], HEIGHTS[0]))
    own = slot(against='p').parameters(HEIGHTS)
    for p, end, before in ((1.2, -1, -2), (-1.2, 0, 1)):
        beyond = curve.flow(1.0, MOMENT._replace(p=AMBIENT + p), 0.0, *own) - 1.0
        assert beyond == pytest.approx(HEIGHTS[end] + 0.1 * (KNOTS - 1) * (HEIGHTS[end] - HEIGHTS[before]), rel=1e-4)


@pytest.mark.parametrize('against', AGAINST)
def test_it_depends_on_what_it_says(against: str) -> None:
    found = curve.flow(1.0, MOMENT, VALUES['flow'], *slot(against=against).parameters(HEIGHTS)) - 1.0
    assert found == pytest.approx(float(slot().interpolation(np.array([VALUES[against]]))[0] @ np.array(HEIGHTS)))


@pytest.mark.parametrize('enters', ENTERS)
def test_it_enters_where_it_says_and_nowhere_else(enters: str) -> None:
    own = (MOMENT, VALUES['flow'], *slot(enters).parameters(HEIGHTS))
    size = float(slot().interpolation(np.array([VALUES['x']]))[0] @ np.array(HEIGHTS))
    changes = {
        'set_point': curve.setpoint(7.0, *own) - 7.0,
        'flow': curve.flow(7.0, *own) / 7.0 - 1.0,
        'gain': curve.velocity_gain(7.0, *own) / 7.0 - 1.0,
        'chamber': curve.chamber(7.0, *own) - 7.0,
        'sensing': curve.signal(7.0, *own) - 7.0,
    }
    expected = dict.fromkeys(changes, 0.0)
    if enters.startswith('leak'):
        lifted = {'leak': 1.0, 'leak_while_growing': 0.5 * (1.0 + np.tanh(VALUES['speed'] / 1e-2))}
        expected['chamber'] = -size * VALUES['p'] * lifted.get(enters, 1.0 - lifted['leak_while_growing'])
    elif enters == 'stiffness':
        expected['flow'] = expected['gain'] = size
    else:
        expected[enters] = size
    assert changes == pytest.approx(expected, abs=1e-9)
