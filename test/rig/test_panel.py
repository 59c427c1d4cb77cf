# SPDX-License-Identifier: Apache-2.0
"""The panel: what it draws, what it keeps to itself, and how well anybody could do on it."""

from __future__ import annotations

import itertools
from functools import cache
from itertools import product

import numpy as np
import pytest

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import RigParameters, Sensors, surface_following
from studies.panel import (
    CLASSES,
    EFFECTS,
    FOREIGN,
    LIBRARY,
    MAKES,
    ON_COMMAND,
    ON_FORCE,
    OWN_WAYS,
    STRANGE,
    STRANGE_FORCE,
    Draw,
    baseline_rmse,
    draw,
    draw_textbook,
    force_baseline_rmse,
    force_oracle_rmse,
    oracle_residual,
    oracle_rmse,
    strengths,
)
from studies.panel.drawing import draw_schedule, motion_of
from studies.panel.situation import Situation
from studies.panel.specimen import Clock, Specimen

SCHEDULES = ('paper_step', 'out_and_back', 'surface_following')
READ = ('times', 'displacement', 'pressures', 'setpoints', 'force')
STRANGE_PRESSURE = tuple(name for name in STRANGE if name not in STRANGE_FORCE)
OTHERWISE_NAMED = {'displacement_delay'}  # where it is weak
SPEED_MATTERS = {'swimming_seal', 'rushing_air'}  # which is measured badly
SENSORS = Sensors()
FLOOR = float(np.hypot(SENSORS.pressure_noise, SENSORS.step(SENSORS.pressure_range) / np.sqrt(12.0)))
"""What noise and converter leave of a pressure [Pa]."""

FORCE_FLOOR = float(
    np.sqrt(
        SENSORS.force_noise**2
        + SENSORS.step(SENSORS.force_range) ** 2 / 12.0
        + 2.0 * (RigParameters().cylinder_a.area * FLOOR) ** 2
    )
)
"""What noise and converters leave of a force, given both pressures [N]."""

HIDDEN_IN_A_STEP = {'lost_motion', 'operating_point', 'volume_variation', 'fast_clock'}
"""Effects that it takes more than the paper's step to see."""

FOLLOWING = draw(None, surface_following(duration=20.0, seed=3), 3)
"""A healthy device for a third of a minute."""


def same(one: Draw, other: Draw) -> bool:
    """Say whether two recordings hold the same to the last bit."""
    return all(np.array_equal(getattr(one.recording, name), getattr(other.recording, name)) for name in READ)


@cache
def healthy(schedule: str, seed: int, make: str | None = None) -> Draw:
    """Return a healthy device's draw."""
    return draw(None, schedule, seed, make=make)


def strongest(name: str, schedule: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> Draw:
    """Return a draw of an effect at its strongest."""
    monkeypatch.setitem(strengths.EFFECTS, name, EFFECTS[name]._replace(weakest=EFFECTS[name].strongest))
    return draw(name, schedule, seed)


# recordings


@pytest.mark.parametrize('name', EFFECTS)
def test_a_recording_does_not_say_what_is_wrong(name: str) -> None:
    """An effect changes readings, but nothing else about a recording."""
    drawn, twin = draw(name, 'paper_step', 5), healthy('paper_step', 5)
    assert vars(drawn.recording).keys() == vars(twin.recording).keys() == set(READ)
    for field in READ:
        values, expected = getattr(drawn.recording, field), getattr(twin.recording, field)
        assert type(values) is np.ndarray
        assert values.dtype == expected.dtype == float
        assert values.shape == expected.shape
        assert np.all(np.isfinite(values))
    assert np.array_equal(drawn.recording.times, twin.recording.times)
    assert np.array_equal(drawn.recording.setpoints, twin.recording.setpoints)
    assert drawn.truth.effects == (name,)
    assert drawn.truth.strengths.keys() == {name}
    assert drawn.truth.healthy == twin.truth.device


def test_a_seed_draws_the_same_again_and_another_something_else() -> None:
    for schedule in SCHEDULES:
        planned, again = (draw_schedule(schedule, np.random.default_rng(1)) for _ in range(2))
        assert np.array_equal(planned.positions, again.positions)
        assert np.array_equal(planned.setpoints, again.setpoints)
    for schedule in ('paper_step', 'out_and_back'):
        first, again, other = (draw('leakage', schedule, seed) for seed in (1, 1, 2))
        assert same(first, again)
        assert first.truth.strengths == again.truth.strengths
        assert first.truth.strengths != other.truth.strengths
        assert first.truth.gains != other.truth.gains


@pytest.mark.parametrize('name', EFFECTS)
def test_strengths_are_drawn_from_their_range(name: str) -> None:
    effect, truth = EFFECTS[name], FOLLOWING.truth
    assert isinstance(truth.device, Specimen)
    situation = Situation(truth.device, truth.gains, truth.schedule, np.random.default_rng(0))
    drawn = [strengths.install(name, situation)[0] for _ in range(200)]
    low, high = sorted((effect.weakest, effect.strongest))
    assert low <= min(drawn) <= max(drawn) <= high
    if low < high:
        share = np.mean(np.array(drawn) < np.sqrt(low * high))
        assert share == pytest.approx(0.5, abs=0.15), 'evenly on a logarithmic scale'


def test_of_each_strange_law_it_is_said_where_it_enters_and_on_what_it_depends() -> None:
    assert CLASSES.keys() == STRANGE.keys()
    places = {'set_point', 'flow', 'chamber', 'gain', 'stiffness', 'sensing', 'force', 'friction', 'cell'}
    against = {'x', 'speed', 'direction', 'p', 'error', 'flow', 'time', 'force'}
    assert {pair for right in CLASSES.values() for pair in right} <= set(product(places, against))


def test_two_effects_at_once() -> None:
    pair = draw(('leakage', 'sensor_lag'), 'out_and_back', 4)
    alone = [draw(name, 'out_and_back', 4) for name in ('leakage', 'sensor_lag')]
    assert pair.truth.effects == ('leakage', 'sensor_lag')
    for one in alone:
        assert pair.truth.changes.items() >= one.truth.changes.items()
        assert not same(pair, one)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('leak', 'paper_step', 0), "effect 'leak' is not known. Use one of leakage"),
        (('leakage', 'step', 0), "schedule 'step' is not known. Use one of paper_step"),
        (('leakage', 'paper_step', 0, 'pink'), "noise 'pink' is not known. Use one of white"),
        ((('supply_variation', 'pulsation'), 'paper_step', 0), 'two of them change the same part of the rig'),
    ],
)
def test_what_cannot_be_drawn(arguments: tuple[str, str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        draw(*arguments)


def test_a_clock_is_late_or_fast() -> None:
    stamps = np.array([0.0, 1.0, 2.0])
    assert Clock(delay=0.25).sampled(stamps) == pytest.approx([-0.25, 0.75, 1.75])
    assert Clock(gain=0.25).sampled(stamps) == pytest.approx([0.0, 0.8, 1.6])


@pytest.mark.parametrize('seed', range(3))
def test_a_delay_shifts_the_pressure(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = strongest('transport_delay', 'out_and_back', seed, monkeypatch)
    samples = 1000 * drawn.truth.changes['clock.delay'] / 2
    late, early = drawn.recording.pressures[:, 0], healthy('out_and_back', seed).recording.pressures[:, 0]
    lags = range(-12, 13)
    errors = [np.std(np.roll(early, lag) - late) for lag in lags]
    assert lags[int(np.argmin(errors))] == pytest.approx(samples, abs=0.75)


# healthy devices


@pytest.mark.parametrize('seed', range(3))
def test_a_healthy_device_follows_the_papers_model(seed: int) -> None:
    """Frozen coefficients and a small control chamber: the textbook's equations predict it."""
    drawn = draw(None, 'paper_step', seed)
    truth = drawn.truth
    text = draw_textbook('paper_step', seed, straight=False)
    assert text.truth.gains == truth.gains
    assert text.truth.samples.pressures[:, 0] == pytest.approx(truth.samples.pressures[:, 0], abs=10.0)
    assert np.ptp(truth.samples.pressures[:, 0]) > 3000.0


@pytest.mark.parametrize('make', MAKES)
def test_a_make_is_a_device_of_all_physics_whatever_is_wrong_with_it(make: str) -> None:
    twin, leaking = healthy('out_and_back', 3, make), draw('leakage', 'out_and_back', 3, make=make)
    assert oracle_rmse(twin) < 1.3 * FLOOR
    assert twin.truth.gains == leaking.truth.gains
    assert twin.truth.device == leaking.truth.healthy
    linear = Specimen(
        leaking.truth.healthy.rig._replace(
            cylinder_a=leaking.truth.healthy.rig.cylinder_a._replace(pressure_dependence=0.0, position_dependence=0.0)
        ),
        approach=leaking.truth.healthy.approach,
    )
    frozen, whole = (one.simulate(motion_of(twin.truth.schedule))[0].pressures for one in (linear, twin.truth.device))
    assert np.max(np.abs(frozen - whole)) > 10.0 * FLOOR


def test_makes_differ_and_more_than_a_third_go_ways_of_their_own() -> None:
    recorded = {make: healthy('out_and_back', 3, make).truth.samples.pressures[:, 0] for make in MAKES}
    for one, other in itertools.combinations(recorded, 2):
        assert np.max(np.abs(recorded[one] - recorded[other])) > 0.1 * FLOOR, (one, other)
    assert set(OWN_WAYS) < set(MAKES)
    assert len(OWN_WAYS) > len(MAKES) / 3
    with pytest.raises(InputError, match='make'):
        draw(None, 'out_and_back', 3, make='nobody')


@pytest.mark.parametrize('schedule', SCHEDULES)
def test_a_recording_begins_at_rest(schedule: str) -> None:
    drawn = FOLLOWING if schedule == 'surface_following' else healthy(schedule, 3)
    samples = drawn.truth.samples
    assert samples.pressures[0] == pytest.approx(samples.setpoints[0], abs=0.01)
    assert samples.displacement[0] == samples.velocity[0] == 0.0
    assert samples.times[0] == pytest.approx(0.0, abs=1e-12)
    assert samples.times[-1] == pytest.approx(drawn.truth.schedule.duration)


# floors


def test_the_oracle_of_a_long_recording_leaves_the_noise() -> None:
    assert oracle_rmse(FOLLOWING) == pytest.approx(FLOOR, rel=0.03)
    for seed in range(3):
        assert oracle_rmse(healthy('out_and_back', seed)) == pytest.approx(FLOOR, rel=0.1)


def test_the_oracles_residual_gives_the_floor_of_a_part() -> None:
    residual = oracle_residual(FOLLOWING)
    assert residual.shape == FOLLOWING.recording.times.shape
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(oracle_rmse(FOLLOWING))
    for part in np.array_split(residual, 3):
        assert np.sqrt(np.mean(part**2)) == pytest.approx(FLOOR, rel=0.05)


@pytest.mark.parametrize('noise', ['white', 'coloured', 'quantised'])
def test_the_textbooks_oracle_leaves_the_noise(noise: str) -> None:
    step = SENSORS.step(SENSORS.pressure_range) / np.sqrt(12.0)
    noises = {'white': FLOOR, 'coloured': FLOOR, 'quantised': float(np.hypot(0.1 * SENSORS.pressure_noise, step))}
    drawn = draw_textbook('surface_following', 1, noise)
    assert oracle_rmse(drawn) == pytest.approx(noises[noise], rel=0.15 if noise == 'quantised' else 0.04)
    residual = drawn.recording.pressures[:, 0] - drawn.truth.samples.pressures[:, 0]
    memory = np.corrcoef(residual[1:], residual[:-1])[0, 1]
    assert memory == pytest.approx(0.83 if noise == 'coloured' else 0.0, abs=0.15 if noise == 'quantised' else 0.05)


@pytest.mark.parametrize('name', [*LIBRARY, *FOREIGN, *STRANGE_PRESSURE])
def test_a_strong_effect_can_be_seen_and_is_known_to_the_oracle(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    schedule = 'out_and_back' if name in {*HIDDEN_IN_A_STEP, *STRANGE} else 'paper_step'
    drawn = strongest(name, schedule, 1, monkeypatch)
    floor = oracle_rmse(drawn)
    assert baseline_rmse(drawn) > (1.0 if name == 'volume_variation' else 1.5) * floor
    # Where a leak or a stamp depends on the moment at which a stroke ends, samples 2 ms apart leave more.
    assert floor < (6.0 if name in {'positional_leakage', *SPEED_MATTERS} else 1.5) * FLOOR


@pytest.mark.parametrize('name', ON_COMMAND)
def test_a_late_set_point_can_be_seen_and_is_known_to_the_oracle(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, twin = strongest(name, 'out_and_back', 1, monkeypatch), healthy('out_and_back', 1)
    assert np.array_equal(drawn.recording.setpoints, twin.recording.setpoints), 'as commanded'
    assert baseline_rmse(drawn) > 5.0 * oracle_rmse(drawn)
    assert oracle_rmse(drawn) < 1.5 * FLOOR


@pytest.mark.parametrize('name', [*ON_FORCE, *STRANGE_FORCE])
def test_an_effect_on_the_force_can_be_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, twin = strongest(name, 'out_and_back', 1, monkeypatch), healthy('out_and_back', 1)
    assert np.array_equal(drawn.recording.pressures, twin.recording.pressures)
    assert force_oracle_rmse(drawn) == pytest.approx(FORCE_FLOOR, rel=0.2 if name == 'bent_cell' else 0.05)
    assert force_baseline_rmse(twin) == pytest.approx(force_oracle_rmse(twin))
    assert force_baseline_rmse(drawn) > 3.0 * force_oracle_rmse(drawn)


@pytest.mark.parametrize('name', sorted({*LIBRARY, *FOREIGN, *STRANGE_PRESSURE} - OTHERWISE_NAMED))
def test_a_weak_effect_is_hardly_to_be_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(strengths.EFFECTS, name, EFFECTS[name]._replace(strongest=EFFECTS[name].weakest))
    drawn = draw(name, 'paper_step', 1)
    assert baseline_rmse(drawn) < 2.0 * oracle_rmse(drawn)
