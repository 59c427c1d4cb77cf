# SPDX-License-Identifier: Apache-2.0
"""The force's generic effect: a curve that data have drawn, where it enters and on what it depends."""

from __future__ import annotations

import numpy as np
import pytest

from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.search.curve_places import CurvePlace
from cfd_pneumatic.model.effects import ForceMoment, force_curve
from cfd_pneumatic.model.effects.force_curve import AGAINST, ENTERS
from cfd_pneumatic.model.effects.knots import KNOTS

AMBIENT = 101325.0
VALUES = {'x': 0.3, 'speed': -0.4, 'p': 0.5, 'force': -0.6, 'time': 0.8}
MOMENT = ForceMoment(
    time=VALUES['time'],
    x=VALUES['x'],
    rate=VALUES['speed'],
    acceleration=0.0,
    p=AMBIENT + 0.2,
    opposing=AMBIENT + 0.3,
    ambient=AMBIENT,
)
STRETCH = -0.7
HEIGHTS = tuple(np.linspace(-3.0, 2.0, KNOTS) ** 2)


def slot(enters: str = 'force', against: str = 'x') -> CurvePlace:
    return CurvePlace(enters, against, 1e-4, -1.0, 1.0, 0.0, 1e6, 1.0, Force.curve)


def height(at: float) -> float:
    return float(slot().interpolation(np.array([at]))[0] @ np.array(HEIGHTS))


@pytest.mark.parametrize('against', AGAINST)
def test_it_depends_on_what_it_says(against: str) -> None:
    value = VALUES['force']
    found = force_curve.force(value, MOMENT, STRETCH, *slot(against=against).parameters(HEIGHTS))
    assert found - value == pytest.approx(height(VALUES[against]))


@pytest.mark.parametrize('enters', ENTERS)
def test_it_enters_where_it_says(enters: str) -> None:
    own = height(VALUES['x'])
    expected = {'force': 7.0 + own, 'friction': 7.0 - own * STRETCH, 'cell': 7.0 * (1.0 + own)}
    assert force_curve.force(7.0, MOMENT, STRETCH, *slot(enters).parameters(HEIGHTS)) == pytest.approx(expected[enters])


@pytest.mark.parametrize('against', AGAINST)
def test_beyond_its_ends_it_stays_and_one_of_pressure_or_force_runs_on(against: str) -> None:
    beyond = MOMENT._replace(x=1.2, rate=1.2, time=1.2, p=AMBIENT + 1.0, opposing=AMBIENT + 0.2)
    found = force_curve.force(1.2, beyond, STRETCH, *slot(against=against).parameters(HEIGHTS)) - 1.2
    more = 0.1 * (KNOTS - 1) * (HEIGHTS[-1] - HEIGHTS[-2]) if against in ('p', 'force') else 0.0
    assert found == pytest.approx(HEIGHTS[-1] + more, rel=1e-4)


def test_its_friction_turns_round_after_a_reversal() -> None:
    own = slot('friction').parameters(HEIGHTS)
    ((behind,), (farther,)) = (force_curve.slide(travel, -1.0, *own) for travel in (1e-4, 1e-2))
    assert behind == pytest.approx(1.0 - 2.0 / np.e)
    assert farther == pytest.approx(1.0)
