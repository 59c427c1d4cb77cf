# SPDX-License-Identifier: Apache-2.0
"""Records of the rig, and the commanded piston."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import (
    CommandedPiston,
    Performance,
    RigParameters,
    RigRecord,
    Sensors,
    out_and_back,
    paper_step,
    record,
    surface_following,
    with_changes,
)
from cfd_pneumatic.units import INCH, PSI

READ = ('times', 'displacement', 'pressures', 'setpoints', 'force')


def same(one: RigRecord, other: RigRecord) -> bool:
    """Say whether two records hold the same to the last bit."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in READ)


def test_the_papers_response() -> None:
    """Figure 6b: a step of 60 mil at 5 psig takes the pressure 0.9 psi down, and 0.2 psi too high afterwards."""
    pressure = record(paper_step(5 * PSI)).truth.pressures[:, 0]
    change = (pressure - pressure[0]) / PSI
    assert change.min() == pytest.approx(-0.9, abs=0.15)
    assert change.max() == pytest.approx(0.2, abs=0.05)
    assert change[-1] == pytest.approx(0.0, abs=0.02)
    assert np.argmin(change) < np.argmax(change)


def test_a_record_has_one_row_for_each_sample() -> None:
    run = record(paper_step(10 * PSI))
    assert run.times.shape == run.displacement.shape == run.force.shape == (350,)
    assert run.pressures.shape == run.setpoints.shape == run.truth.pressures.shape == (350, 2)
    assert np.array_equal(run.truth.times, 2e-3 * np.arange(350))
    assert np.max(np.abs(run.times - run.truth.times)) < 1e-3


def test_sensors_read_the_truth() -> None:
    run = record(paper_step(10 * PSI))
    assert np.std(run.pressures - run.truth.pressures) == pytest.approx(7.8e-3 * PSI, rel=0.1)
    assert np.max(np.abs(run.displacement - run.truth.displacement)) < 5e-6
    assert np.std(run.force - run.truth.force) == pytest.approx(0.1, rel=0.2)


def test_a_seed_picks_the_noise() -> None:
    schedule = paper_step()
    assert same(record(schedule, seed=1), record(schedule, seed=1))
    first, other = record(schedule, seed=1), record(schedule, seed=2)
    assert not same(first, other)
    assert np.array_equal(first.truth.pressures, other.truth.pressures)


def test_channels_have_noises_of_their_own() -> None:
    run = record(surface_following(duration=10.0), sensors=Sensors(bits=0))
    noises = np.column_stack(
        [
            run.pressures - run.truth.pressures,
            run.displacement - run.truth.displacement,
            run.force - run.truth.force,
            run.times - run.truth.times,
        ]
    )
    correlations = np.corrcoef(noises.T) - np.eye(5)
    assert np.max(np.abs(correlations)) < 0.06


@given(st.lists(st.integers(1, 400), min_size=1, max_size=8))
@settings(max_examples=settings.default.max_examples // 5)
def test_a_schedule_played_in_pieces_is_the_same_to_the_last_bit(pieces: list[int]) -> None:
    schedule = out_and_back(repeats=1)
    whole = record(schedule, seed=3)
    played = Performance(schedule, seed=3)
    parts = [played.advance(piece) for piece in pieces if played.remaining]
    if played.remaining:
        parts.append(played.advance(played.remaining))
    for name in READ:
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)), name


def test_a_schedule_with_a_return_can_begin_again() -> None:
    schedule = paper_step().with_return()
    played = Performance(schedule, seed=1, repeat=True)
    first = played.advance(schedule.samples)
    again = played.advance(schedule.samples)
    assert again.truth.times[0] == pytest.approx(first.truth.times[-1] + schedule.sampling_period)
    assert again.truth.pressures == pytest.approx(first.truth.pressures, rel=1e-5)
    assert not np.array_equal(again.pressures, first.pressures)


def test_set_points_act_up_to_their_sample() -> None:
    run = record(out_and_back(repeats=1))
    change = int(np.flatnonzero(np.diff(run.setpoints[:, 0]))[0]) + 1
    pressure = run.truth.pressures[:, 0]
    assert pressure[change - 1] == pytest.approx(run.setpoints[change - 1, 0], rel=1e-3)
    assert pressure[change] > pressure[change - 1], 'the first sample under a new set-point has felt it'


@given(st.floats(-6e-3, 6e-3), st.floats(-6e-3, 6e-3), st.floats(0.01, 1.0), st.floats(0.1, 100.0))
def test_a_commanded_piston_arrives_within_its_limits(start: float, end: float, speed: float, rush: float) -> None:
    piston = CommandedPiston(start, 6.35e-3, speed, rush)
    piston.command(end)
    period = 2e-4
    knots = int((abs(end - start) / speed + speed / rush + 2 * np.sqrt(abs(end - start) / rush)) / period) + 500
    positions, velocities = piston.move(knots, period)
    assert positions[-1] == pytest.approx(end, abs=1e-9)
    assert velocities[-1] == pytest.approx(0.0, abs=1e-6)
    assert np.max(np.abs(velocities)) <= speed * (1 + 1e-9)
    assert np.max(np.abs(np.diff(velocities, prepend=0.0))) <= 2.01 * rush * period
    low, high = min(start, end), max(start, end)
    assert np.all((positions >= low - 2 * rush * period**2) & (positions <= high + 2 * rush * period**2))


def test_a_command_beyond_the_travel_goes_to_its_end() -> None:
    piston = CommandedPiston(0.0, 6.35e-3, 0.5, 50.0)
    piston.command(1.0)
    assert piston.move(5000, 2e-4)[0][-1] == pytest.approx(0.25 * INCH)


CHANGES = [
    {'effects_a.leak_conductance': 1e-10},
    {'effects_a.dead_band': 300.0},
    {'effects_a.sensor_lag': 3e-3},
    {'pickup.displacement_lag': 3e-3},
    {'pickup.displacement_delay': 30e-3},
    {'pickup.force_offset': 5.0},
]


@pytest.mark.parametrize('changes', CHANGES, ids=lambda changes: next(iter(changes)))
def test_what_appears_acts_from_the_next_sample_on_and_can_go_again(changes: dict[str, float]) -> None:
    schedule = surface_following(duration=4.0, seed=1)
    healthy, troubled = Performance(schedule, seed=1), Performance(schedule, seed=1)
    pairs = []
    for changed in ({}, changes, changes, {}):
        troubled.change(with_changes(RigParameters(), changed))
        pairs.append((healthy.advance(500), troubled.advance(500)))

    def apart(rank: int) -> float:
        one, other = pairs[rank]
        return sum(
            float(np.max(np.abs(getattr(one, name) - getattr(other, name))[-250:]) / np.ptp(getattr(one, name)))
            for name in ('displacement', 'pressures', 'force')
        )

    assert apart(0) == 0.0
    assert apart(1) > 0.01
    assert apart(3) < 0.2 * apart(2)


def test_what_changes_midway_is_what_it_would_be_from_the_start_once_that_is_forgotten() -> None:
    leaking = with_changes(RigParameters(), {'effects_a.leak_conductance': 1e-10})
    schedule = surface_following(duration=6.0, seed=2)
    from_the_start, midway = Performance(schedule, leaking, seed=1), Performance(schedule, seed=1)
    parts = [one.advance(500) for one in (from_the_start, midway)]
    midway.change(leaking)
    parts = [one.advance(2500) for one in (from_the_start, midway)]
    assert parts[0].pressures[-1000:] == pytest.approx(parts[1].pressures[-1000:], abs=60.0)


@pytest.mark.parametrize('name', ['effects_a.leak', 'effect_a.leak_conductance', 'leak_conductance', '', 'effects_a.'])
def test_a_change_of_what_is_not_there_is_refused(name: str) -> None:
    with pytest.raises(InputError, match='is not known: use PART'):
        with_changes(RigParameters(), {name: 1.0})
