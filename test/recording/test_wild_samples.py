# SPDX-License-Identifier: Apache-2.0
"""Samples that nobody measured: out of range, zeros, spikes, counters that wrap; and what pistons and tools do."""

from __future__ import annotations

import numpy as np
import pytest

from cfd_pneumatic.identification.input_checks.samples import (
    check_range_limit,
    check_shifts,
    check_stuck_sensor,
    check_two_sources,
)
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.recording.cleaning import Cleaned
from cfd_pneumatic.recording.dropouts import without_pulses
from cfd_pneumatic.recording.outliers import screened

RATE = 500.0
TIMES = np.arange(0.0, 20.0, 1.0 / RATE)

NOISE = np.random.default_rng(3).normal(size=TIMES.size)


def strokes(seed=1):
    """Return a piston's motion over millimetres, with noise [m]."""
    rng = np.random.default_rng(seed)
    motion = 2e-3 * np.sin(3.0 * TIMES) + 1e-3 * np.sin(7.1 * TIMES) + 4e-3
    return motion + 1e-6 * rng.normal(size=TIMES.size)


def force(seed=1):
    """Return a force with the impacts of a tool on burrs [N]."""
    rng = np.random.default_rng(seed)
    impacts = sum(60.0 * np.exp(-(((TIMES - at) / 0.01) ** 2)) for at in rng.uniform(1.0, 19.0, 6))
    return 20.0 + 5.0 * np.sin(2.0 * TIMES) + impacts + 0.3 * rng.normal(size=TIMES.size)


def screen(values, role='displacement'):
    stamps = np.rint(TIMES * 1e9).astype(np.int64)
    found = screened(Cleaned(stamps.copy(), values.copy(), ()), role, role)
    return found, np.isin(stamps, found.times)


WILD = {
    'out of range': lambda one, at: one.__setitem__(slice(at, at + 40), -0.0999998),
    'one sample': lambda one, at: one.__setitem__(at, 0.05),
    'two samples of noise': lambda one, at: one.__setitem__(slice(at, at + 2), [0.05, -0.02]),
    'not a number as a number': lambda one, at: one.__setitem__(slice(at, at + 7), -9.999),
    'far away and drifting': lambda one, at: one.__setitem__(slice(at, at + 50), np.linspace(5.0, 6.0, 50)),
    'zeros': lambda one, at: one.__setitem__(slice(at, at + 25), 0.0),
}


@pytest.mark.parametrize('kind', WILD)
@pytest.mark.parametrize('seed', [1, 2])
def test_wild_samples_of_a_displacement_are_left_out_and_no_others(kind, seed):
    clean = strokes(seed)
    values = clean.copy()
    for at in (300, 2500, 7777):
        WILD[kind](values, at)
    found, kept = screen(values)
    np.testing.assert_array_equal(kept, values == clean)
    (note,) = found.notes
    assert (
        f'left out {np.sum(values != clean)} samples of 10,000 that leap out of the others and back, first 0.6 s'
        in note
    )


def test_wild_samples_at_either_end_are_left_out():
    values = strokes()
    values[:30] = values[-20:] = 0.09
    _, kept = screen(values)
    assert np.flatnonzero(~kept).tolist() == [*range(30), *range(9980, 10_000)]


@pytest.mark.parametrize('value', [6553.5, -6553.5, 3276.7])
def test_wild_samples_of_a_force_are_left_out_and_impacts_stay(value):
    values = force()
    assert screen(values, 'force')[1].all()
    values[[100, 101, 4000]] = value
    assert np.flatnonzero(~screen(values, 'force')[1]).tolist() == [100, 101, 4000]


REAL = {
    'strokes': strokes(),
    'at rest but for one stroke': 3e-3 * ((TIMES > 9.0) & (TIMES < 9.5)),
    'square strokes': 6e-3 * (np.sin(5.0 * TIMES) > 0.0),
    'square strokes with noise': 6e-3 * (np.sin(5.0 * TIMES) > 0.0)
    + 1e-6 * np.random.default_rng(3).normal(size=TIMES.size),
    'square strokes of a coarse sensor': np.round(6e-3 * (np.sin(5.0 * TIMES) > 0.0) + 1e-3 * np.sin(TIMES), 5),
    'at rest but for a fast stroke, with noise': 3e-3 * ((TIMES > 9.0) & (TIMES < 9.5)) + 1e-6 * NOISE,
    'at rest but for a stroke to zero': np.round(3e-3 * ~((TIMES > 9.0) & (TIMES < 9.5)) + 1e-6 * NOISE, 6),
    'at rest but for a long stroke of a large device': 0.1 * np.clip(20.0 * (TIMES - 9.0), 0.0, 1.0) * (TIMES < 9.6)
    + 1e-6 * NOISE,
    'through zero': np.round(1e-3 * np.sin(3.0 * TIMES), 5),
    'at zero': np.maximum(0.0, 2e-3 * np.sin(3.0 * TIMES)),
    'fast': 1e-3 * np.sin(2.0 * np.pi * 90.0 * TIMES),
    'constant': np.full(TIMES.size, 1e-3),
}


CONTACTS = {
    'one contact': 20.0 * ((TIMES > 9.0) & (TIMES < 9.5)) + 0.1 * NOISE,
    'one hard knock': 300.0 * ((TIMES > 9.0) & (TIMES < 9.003)) + 0.1 * NOISE,
    'impacts': force(),
    'a stiff workpiece': 400.0 * (np.sin(3.0 * TIMES) > 0.9) + 0.1 * NOISE,
}


def test_jerks_of_a_piston_at_both_ends_of_its_strokes_stay():
    side = np.sign(np.sin(3.0 * TIMES))
    assert screen(20.0 * side + 30.0 * np.diff(side, prepend=0.0) + 0.1 * NOISE, 'force')[1].all()


@pytest.mark.parametrize('name', CONTACTS)
def test_what_a_tool_really_feels_stays(name):
    assert screen(CONTACTS[name], 'force')[1].all()


@pytest.mark.parametrize('name', REAL)
def test_what_a_piston_really_does_stays(name):
    found, kept = screen(REAL[name])
    assert kept.all()
    assert found.notes == ()
    np.testing.assert_array_equal(found.values, REAL[name])


def test_a_rest_without_noise_behind_a_quick_stroke_is_no_code():
    moved = np.interp(TIMES % 2.0, [1.8, 1.806, 1.994, 2.0], [0.0, 4e-4, 4e-4, 0.0])
    assert screen(np.where(TIMES % 2.0 < 1.8, 1e-6 * np.round(NOISE), moved))[1].all()


DROPPED = {
    'single zeros': lambda one: one.__setitem__(slice(50, None, 120), 0.0),
    'runs of zeros': lambda one: [one.__setitem__(slice(at, at + 250), 0.0) for at in (2000, 6000)],
    'spikes within the range': lambda one: one.__setitem__(slice(40, None, 66), one[40::66] + 0.6 * np.ptp(one)),
    'a code within the range': lambda one: one.__setitem__(slice(3000, 3400), 6.5535e-3),
}


@pytest.mark.parametrize('kind', DROPPED)
@pytest.mark.parametrize('seed', [1, 2])
def test_samples_within_the_range_that_leap_out_and_back_are_left_out(kind, seed):
    clean = strokes(seed)
    values = clean.copy()
    DROPPED[kind](values)
    _, kept = screen(values)
    leaps = np.abs(values - clean) > 2e-3  # nearer samples disturb no fit
    assert not np.any(kept & leaps)
    assert np.all(kept[values == clean])


@pytest.mark.parametrize(('share', 'step'), [(0.002, 0.0), (0.01, 3e-6), (0.05, 1e-5)])
def test_zeros_of_a_logger_within_the_range_are_left_out_but_for_those_that_disturb_nothing(share, step):
    clean = in_steps(strokes() - 4e-3, step)
    lost = np.random.default_rng(5).random(TIMES.size) < share
    _, kept = screen(np.where(lost, 0.0, clean))
    assert not np.any(kept & lost & (np.abs(clean) > 1e-4))
    assert np.all(kept[~lost & (clean != 0.0)])


@pytest.mark.parametrize('step', [0.0, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_piston_may_be_at_zero_or_come_back_from_there(step):
    values = in_steps(np.abs(strokes() - 4e-3), step)
    values[values < 2e-6] = 0.0
    assert screen(values)[1].all()


@pytest.mark.parametrize('kind', ['spikes of one value', 'spikes both ways', 'runs of zeros'])
def test_a_force_that_was_not_measured_is_left_out(kind):
    clean = force()
    values = clean.copy()
    if kind == 'runs of zeros':
        values[2000:3500] = values[6000:6300] = 0.0
    elif kind == 'spikes both ways':
        values[30::500] += 150.0 + np.arange(20.0)
        values[280::500] -= 150.0 + np.arange(20.0)
    else:
        values[30::500] = 327.67
    np.testing.assert_array_equal(screen(values, 'force')[1], values == clean)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('role', ['displacement', 'pressure', 'force'])
def test_enormous_numbers_raise_no_warning(role):
    screen(np.where(NOISE > 0.0, strokes(), 1e200 * np.sign(NOISE + 1.0)), role)


def test_a_pressure_that_reads_a_code_for_a_while_is_left_out():
    clean = 2e5 + 1e7 * strokes() + 50.0 * NOISE
    values = clean.copy()
    values[4000:4400] = 0.0
    np.testing.assert_array_equal(screen(values, 'pressure')[1], values == clean)
    assert screen(clean, 'pressure')[1].all()


@pytest.mark.parametrize(('bits', 'step'), [(14, 1e-7), (12, 1e-6), (16, 1e-7), (10, 2e-6)])
def test_a_counter_that_wraps_is_made_continuous(bits, step):
    motion = 2.5 * strokes() - 5e-3
    period = 2**bits * step
    values = np.round(motion / step) % 2**bits * step
    assert np.ptp(values) < np.ptp(motion)
    found, kept = screen(values)
    assert kept.all()
    np.testing.assert_allclose(found.values - found.values[0], motion - motion[0], atol=2 * step)
    (note,) = found.notes
    assert f'by {period:.4g} m: made continuous' in note
    assert 'unsure' not in note


def test_a_counter_that_wraps_in_another_unit_is_known_by_its_leaps():
    motion = 3.0 * strokes()
    period = 0.7 * np.ptp(motion)  # no power of anything
    found, _ = screen(motion % period)
    np.testing.assert_allclose(found.values - found.values[0], motion - motion[0], atol=2e-5)


CLIPPED = {
    'highest': lambda one: np.minimum(one, np.percentile(one, 97.0)),
    'lowest': lambda one: np.maximum(one, np.percentile(one, 5.0)),
}


COARSE = [0.0, 1e-6, 1e-5, 2e-5]  # steps of a sensor [m]


def in_steps(values, step):
    return step * np.round(values / step) if step else values


@pytest.mark.parametrize('step', COARSE)
@pytest.mark.parametrize('end', CLIPPED)
def test_a_displacement_at_its_sensor_s_limit_is_told(end, step):
    (notice,) = check_range_limit(Signal(TIMES, in_steps(CLIPPED[end](5.0 * strokes()), step)))
    assert f'at its {end} value' in notice.message
    assert notice.code == 'samples_suspect'


@pytest.mark.parametrize('step', [*COARSE, 1e-4, 1e-3])
@pytest.mark.parametrize('name', REAL)
def test_a_displacement_within_its_range_is_not_told_to_be_at_its_limit(name, step):
    found = list(check_range_limit(Signal(TIMES, in_steps(REAL[name], step))))
    assert found == [] or name == 'at zero'  # whose rest has no noise at all


@pytest.mark.parametrize('step', [0.0, 1e-5])
@pytest.mark.parametrize('long', [30, 200, 400])
def test_a_signal_that_is_stuck_now_and_then_is_reported(long, step):
    for role, values in (('displacement', in_steps(5.0 * strokes(), step)), ('force', in_steps(force(), 1e3 * step))):
        for begin in range(1000, 9500, 1700):
            values[begin : begin + long] = values[begin]
        (notice,) = check_stuck_sensor(role, Signal(TIMES, values))
        assert notice.message.startswith(f'{role}: ')
        assert notice.message.endswith('first at t = 2 s')


@pytest.mark.parametrize('name', REAL)
@pytest.mark.parametrize('step', [*COARSE, 1e-4, 1e-3])
def test_a_piston_that_really_rests_is_not_stuck(name, step):
    assert list(check_stuck_sensor('displacement', Signal(TIMES, in_steps(REAL[name], step)))) == []


@pytest.mark.parametrize('name', CONTACTS)
@pytest.mark.parametrize('step', [0.0, 0.01, 0.1, 1.0])
def test_a_force_that_really_rests_is_not_stuck(name, step):
    assert list(check_stuck_sensor('force', Signal(TIMES, in_steps(CONTACTS[name], step)))) == []


def test_a_stop_is_no_limit_of_the_sensor():
    stopped = np.minimum(strokes(), 5e-3) + 1e-7 * NOISE
    assert list(check_range_limit(Signal(TIMES, stopped))) == []


@pytest.mark.parametrize('role', ['displacement', 'pressure'])
@pytest.mark.parametrize('share', [0.3, -0.5])
def test_a_sensor_that_is_zeroed_in_the_middle_is_reported(role, share):
    values = strokes()
    clean = values.copy()
    values[6000:] += share * np.ptp(values)
    (notice,) = check_shifts(role, None, Signal(TIMES, values))
    assert 'shifts within a single sample, at t = 12 s' in notice.message
    assert list(check_shifts(role, None, Signal(TIMES, clean))) == []


@pytest.mark.parametrize('lasting', [0.006, 0.02, 0.1])
@pytest.mark.parametrize('step', [0.0, 1e-6, 1e-5])
def test_a_piston_that_moves_quickly_is_not_shifted(lasting, step):
    stroke = 3e-3 * np.clip((TIMES - 9.0) / lasting, 0.0, 1.0) + 1e-6 * NOISE
    assert list(check_shifts('displacement', None, Signal(TIMES, in_steps(stroke, step)))) == []


@pytest.mark.parametrize('offset', [1e-3, -5e-3])
def test_two_who_publish_one_topic_are_told(offset):
    values = strokes()
    values[1::2] = np.interp(TIMES[1::2], TIMES, strokes(2)) + offset
    (notice,) = check_two_sources('displacement', None, Signal(TIMES, values))
    assert 'far from the previous sample and near the sample before that' in notice.message
    assert list(check_two_sources('pressure', 'cylinder_a', Signal(TIMES, 1e5 + values))) != []


@pytest.mark.parametrize('name', REAL)
def test_one_who_publishes_is_not_taken_for_two(name):
    assert list(check_two_sources('displacement', None, Signal(TIMES, REAL[name]))) == []


def test_noise_is_not_taken_for_two_sources():
    assert list(check_two_sources('force', None, Signal(TIMES, NOISE))) == []


@pytest.mark.parametrize(('lasting', 'stays'), [(0.002, False), (0.016, False), (0.03, True)])
@pytest.mark.parametrize('value', [0.0, 655350.0])
def test_a_set_point_that_is_taken_back_at_once_is_left_out(lasting, stays, value):
    times = np.rint(1e9 * np.array([0.0, 3.0, 5.0, 5.0 + lasting, 8.0])).astype(np.int64)
    values = np.array([7e4, 8e4, value, 8e4, 7e4])
    assert without_pulses(times, values).tolist() == [True, True, stays, stays, True]


def test_short_steps_of_a_set_point_that_go_on_are_kept():
    times = np.rint(1e9 * np.arange(20) * 0.01).astype(np.int64)
    assert without_pulses(times, np.linspace(1e5, 2e5, 20)).all()
