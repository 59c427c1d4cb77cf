# SPDX-License-Identifier: Apache-2.0
"""What is proposed keeps the limits of the cell, whatever they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.planning import Limits, Sensing
from cfd_pneumatic.planning.family import Move, Turn, family
from cfd_pneumatic.planning.proposal import Drawing, Proposal


@st.composite
def cells(draw) -> tuple[Limits, Sensing, tuple[float, float], float]:
    low = draw(st.floats(-9e4, 5e5))
    limits = Limits(
        pressures=(low, low + draw(st.floats(0.0, 3e5))),
        stroke=draw(st.floats(2e-5, 0.1)) * draw(st.sampled_from([-1.0, 1.0])),
        speed=draw(st.floats(5e-3, 2.0)),
        acceleration=draw(st.floats(0.1, 500.0)),
    )
    sensing = Sensing(sample_rate=draw(st.sampled_from([100.0, 333.0, 500.0, 1000.0])))
    homes = tuple(draw(st.floats(*limits.pressures)) for _ in range(2))
    return limits, sensing, homes, draw(st.floats(0.05, 1.0))


def written(proposal: Proposal) -> np.ndarray:
    """Return the columns of the table as somebody reads them."""
    head, *rows = proposal.table().splitlines()
    assert tuple(head.split(',')) == SCHEDULE_COLUMNS
    return np.array([[float(cell) for cell in row.split(',')] for row in rows]).T


@settings(max_examples=settings.default.max_examples // 2)
@given(
    cells(), st.lists(st.sampled_from([one for one in family() if 'creeping' not in one.name]), min_size=1, max_size=3)
)
def test_limits_are_kept_exactly(cell, segments):
    limits, sensing, homes, settling = cell
    proposal = Drawing(limits, sensing, homes, settling).draw(segments)
    times, x, v, *levels = written(proposal)
    assert np.all((min(0.0, limits.stroke) <= x) & (x <= max(0.0, limits.stroke)))
    assert np.all(np.abs(v) <= limits.speed)
    assert np.max(np.abs(np.diff(x))) <= limits.speed * sensing.period
    assert np.max(np.abs(proposal.acceleration)) <= limits.acceleration * (1.0 + 1e-9)
    assert np.max(np.abs(np.diff(v))) <= (limits.acceleration * (1.0 + 1e-9)) * sensing.period + 2e-9
    assert all(np.all((limits.pressures[0] <= one) & (one <= limits.pressures[1])) for one in levels)
    assert np.diff(times) == pytest.approx(sensing.period, abs=2e-9)


@given(cells(), st.sampled_from([one for one in family() if 'creeping' not in one.name]))
def test_a_segment_begins_and_ends_at_rest_at_home(cell, segment):
    limits, sensing, homes, settling = cell
    drawing = Drawing(limits, sensing, homes, settling)
    proposal = drawing.draw([segment])
    assert proposal.times.size == 1 + drawing.opening + drawing.duration(segment)
    still = [0, drawing.opening, -1]
    assert np.all(proposal.displacement[still] == 0.0)
    assert np.all(proposal.velocity[still] == 0.0)
    assert np.all(proposal.setpoints[still] == proposal.setpoints[0])


def test_the_motion_is_that_of_its_rate_and_reaches_the_stroke():
    limits = Limits((3e4, 6e4), stroke=2e-3, speed=0.1, acceleration=5.0)
    sensing = Sensing(sample_rate=5000.0)
    drawing = Drawing(limits, sensing, (3e4, 3e4), 0.3)
    proposal = drawing.draw([one for one in family() if one.name == 'fast stroke of 100%'])
    travelled = (
        np.concatenate([[0.0], np.cumsum(proposal.velocity[1:] + proposal.velocity[:-1])]) * 0.5 * sensing.period
    )
    assert proposal.displacement == pytest.approx(travelled, abs=2e-7)
    assert proposal.displacement.max() == 2e-3
    assert np.abs(proposal.velocity).max() == pytest.approx(np.sqrt(2.0 * 5.0 * 2e-3 / np.pi), rel=1e-3)


def test_a_set_point_acts_after_the_row_that_holds_it():
    limits = Limits((3e4, 6e4))
    proposal = Drawing(limits, Sensing(), (3e4, 5e4), 0.3).draw(
        [one for one in family() if one.name == 'set-point step of 100%, A and B']
    )
    changed = np.flatnonzero(np.diff(proposal.setpoints[:, 0]))
    assert np.array_equal(np.flatnonzero(np.diff(proposal.held[:, 0])) + 1, changed)
    assert np.unique(proposal.setpoints[:, 0]) == pytest.approx([3e4, 6e4])
    assert np.unique(proposal.setpoints[:, 1]) == pytest.approx([3e4, 5e4]), 'to the end that is farther away'


def test_every_segment_comes_home():
    for segment in family():
        moves = [step for step in segment.steps if isinstance(step, Move)]
        turns = [step for step in segment.steps if isinstance(step, Turn)]
        assert not moves or (moves[-1].to, moves[-1].rest) == (0.0, 1.0)
        assert not turns or turns[-1] == Turn(0.0, 0.0)
    assert len({segment.name for segment in family()}) == len(family())


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'stroke': 0.0}, 'stroke 0 m'),
        ({'stroke': float('nan')}, 'stroke nan m'),
        ({'speed': 0.0}, 'speed 0 m/s'),
        ({'acceleration': -1.0}, 'acceleration -1 m/s'),
        ({'pressures': (6e4, 3e4)}, 'give the lower first'),
        ({'pressures': (float('nan'), 3e4)}, 'pressures nan'),
        ({'duration': 0.0}, 'duration 0 s'),
    ],
)
def test_limits_that_leave_nothing_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        Limits(**{'pressures': (3e4, 6e4), **changes})


@pytest.mark.parametrize(
    'changes',
    [
        {'pressure_noise': 0.0},
        {'pressure_noise': 1e308},
        {'force_noise': float('nan')},
        {'displacement_noise': -1.0},
        {'displacement_noise': 1.0},
        {'sample_rate': float('nan')},
    ],
)
def test_sensors_that_nobody_has_are_refused(changes):
    with pytest.raises(InputError, match='give'):
        Sensing(**changes)
