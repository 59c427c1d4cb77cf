# SPDX-License-Identifier: Apache-2.0
"""The noise of a pressure: how large it is and what colour it has, seen where nothing moves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drawn import CHANNEL, model, moved, with_pressure
from hypothesis import given
from hypothesis import strategies as st
from reference import AMBIENT, PSI, step_like
from scipy.signal import lfilter

from cfd_pneumatic.identification.residual import rest_periods as module
from cfd_pneumatic.identification.residual.noise import rounding_step, sample_noise, stamp_jitter
from cfd_pneumatic.model import TABLE_1

GAINS = np.array(TABLE_1.table[0, 1:])
MODEL = model(GAINS)
PERIOD = 0.002
STD = 52.0
QUIET = 5e-8
"""Of the displacement [m]: K_x makes 0.2 Pa of it."""


def strokes(rest=0.4, duration=4.0, noise=QUIET, steps=True):
    """Return an experiment of strokes out and back with rests in between, the set-point stepped in the last quarter."""
    times = np.arange(round(duration / PERIOD)) * PERIOD
    displacement = np.zeros(times.size)
    for index, at in enumerate(np.arange(0.4, duration - 0.2, rest)):
        displacement += (-1.0) ** index * step_like(at, 0.012, 1.5e-3)(times)
    setpoint = AMBIENT + PSI * np.where(steps & (times > 0.75 * duration), 8.0, 5.0)
    return with_pressure(moved(times, displacement, setpoint, noise), MODEL)


STROKES = strokes()


def coloured(seed, samples, memory=0.9):
    """Return noise of unit variance that remembers."""
    white = np.random.default_rng(seed).standard_normal(samples + 200)
    return math.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[200:]


def noise_of(experiments, simulated, k_x=GAINS[0]):
    """Return the noise of experiments whose pressure a model with a gain simulates."""
    return CHANNEL.noise(experiments, simulated, model([k_x, *GAINS[1:]]))


def heard(experiment, noise, k_x=GAINS[0]):
    """Return the noise that is found where the model is true, and `noise` is added [Pa]."""
    return noise_of([replace(experiment, measured=experiment.measured + noise)], [experiment.measured], k_x)


def runs_of(experiment):
    """Return first and last time of each rest that is found [s]."""
    return [(run[0], run[-1]) for run in CHANNEL.rests(experiment, experiment.sample_times)]


def test_rests_are_found_where_they_are():
    """From some time after each stroke to the next: strokes every 0.4 s, a step of the set-point at 3 s."""
    found = runs_of(STROKES)
    assert len(found) == 9, 'one before each stroke, one after the last; about the step both rests are too short'
    for begin, end in found:
        assert not np.any((np.arange(0.4, 3.8, 0.4) > begin) & (np.arange(0.4, 3.8, 0.4) + 0.012 < end))
        assert not begin < 3.0 < end
    rested = sum(end - begin for begin, end in found)
    free = 0.4 + 8 * (0.4 - 0.012 - module.REST_SETTLING_TIME)  # after a stroke the pressure settles
    assert rested == pytest.approx(free, rel=0.02)


def test_settling_is_left_out_after_motion_and_not_before():
    first, second = runs_of(STROKES)[:2]
    assert first == pytest.approx((0.0, 0.4), abs=0.01)
    assert second[0] == pytest.approx(0.412 + module.REST_SETTLING_TIME, abs=0.01)
    assert second[1] == pytest.approx(0.8, abs=0.01)


def test_while_it_moves_all_the_time_there_is_no_rest():
    times = np.arange(2000) * PERIOD
    moving = moved(times, 1e-3 * np.sin(2.0 * np.pi * 2.0 * times), np.full(times.size, AMBIENT + 5.0 * PSI), QUIET)
    assert runs_of(moving) == []
    found = noise_of([moving], [moving.measured - STD * coloured(0, 2000, 0.0)], GAINS[0])
    assert not found.known
    assert found.std == pytest.approx(STD, rel=0.05)


@pytest.mark.parametrize('seed', range(20))
def test_white_noise_is_measured(seed):
    found = heard(STROKES, STD * coloured(seed, STROKES.measured.size, 0.0))
    assert found.known
    assert not found.rounded
    assert found.std == pytest.approx(STD, rel=0.05)


def test_coloured_noise_is_measured_as_well_as_it_says():
    found = [heard(STROKES, STD * coloured(seed, STROKES.measured.size)) for seed in range(100)]
    assert all(one.known for one in found)
    off = np.array([(one.std / STD - 1.0) / one.uncertainty for one in found])
    assert np.mean(np.abs(off) < 3.0) >= 0.98
    assert abs(np.mean(off)) < 0.5
    sizes = [one.coefficients.size for one in found]
    assert np.mean(np.array(sizes) > 0) == 1.0
    assert np.mean([one.coefficients[0] for one in found]) == pytest.approx(0.9, abs=0.1)


@pytest.mark.parametrize('memory', [0.0, 0.9])
def test_the_uncertainty_is_what_the_size_scatters_by(memory):
    found = [heard(STROKES, STD * coloured(seed, STROKES.measured.size, memory)) for seed in range(100)]
    scatter = np.std([one.std / STD for one in found])
    assert 0.5 < scatter / np.mean([one.uncertainty for one in found]) < 2.0


def test_a_level_that_the_model_misses_at_rest_is_no_noise():
    wrong = 500.0 * (STROKES.sample_times > 2.0) + 2e3 * (STROKES.at_samples('displacement') > 1e-3)
    found = heard(STROKES, wrong + STD * coloured(3, STROKES.measured.size, 0.0))
    assert found.std == pytest.approx(STD, rel=0.08)


def test_the_displacements_noise_counts_with_k_x():
    """That of a still piston, smoothed: K_x times what the smoother leaves of it."""
    rough = strokes(noise=4e-5)
    white = STD * coloured(1, rough.measured.size, 0.0)
    expected = math.sqrt(STD**2 + GAINS[0] ** 2 * rough.motion.uncertainty**2)
    assert expected > 1.1 * STD
    assert heard(rough, white).std == pytest.approx(expected, rel=0.05)
    assert heard(rough, white, k_x=0.0).std == pytest.approx(STD, rel=0.05)


@pytest.mark.parametrize('memory', [0.0, 0.9])
def test_recordings_are_heard_together(memory):
    other = strokes(rest=0.5, duration=5.0)
    both = [STROKES, other]
    noises = [STD * coloured(seed, one.measured.size, memory) for seed, one in enumerate(both)]
    together = noise_of(
        [replace(one, measured=one.measured + noise) for one, noise in zip(both, noises)],
        [one.measured for one in both],
        GAINS[0],
    )
    alone = [heard(one, noise) for one, noise in zip(both, noises)]
    assert together.uncertainty < min(one.uncertainty for one in alone)
    assert together.std == pytest.approx(STD, rel=3.0 * together.uncertainty)


@given(step=st.floats(1e-3, 1e3), level=st.floats(-1e5, 1e5), spread=st.floats(1.5, 30.0), seed=st.integers(0, 2**31))
def test_the_converters_step_is_found(step, level, spread, seed):
    counts = np.round(spread * np.random.default_rng(seed).standard_normal(2000))
    counts[:2] = 0.0, 1.0
    assert rounding_step(level + step * counts) == pytest.approx(step, rel=1e-5 + 1e-9 * abs(level) / step)


@pytest.mark.parametrize(
    'values',
    [np.random.default_rng(0).standard_normal(1000), np.full(100, 1.5e5), np.arange(100.0), np.empty(0)],
    ids=['noise', 'constant', 'all different', 'nothing'],
)
def test_no_step_is_found_where_there_is_none(values):
    assert rounding_step(values) == 0.0


@pytest.mark.parametrize(('share', 'rounded'), [(20.0, True), (10.0, True), (2.5, False), (0.5, False)])
def test_noise_is_rounded_where_nearly_all_of_it_is(share, rounded):
    """A step of so many standard deviations of the white noise; alone it makes a twelfth of its square."""
    step = share * STD
    rng = np.random.default_rng(0)
    true = STROKES.measured + 200.0 * np.sin(3.0 * STROKES.sample_times)  # or at rest a converter stands still
    measured = step * np.round((true + STD * rng.standard_normal(true.size)) / step)
    found = noise_of([replace(STROKES, measured=measured)], [true], GAINS[0])
    assert found.rounded == rounded
    assert found.std >= step / math.sqrt(12.0)
    if not rounded:
        assert found.std == pytest.approx(math.hypot(STD, step / math.sqrt(12.0)), rel=0.1)


@given(
    seed=st.integers(0, 2**31),
    size=st.floats(1e-3, 1e3),
    slope=st.floats(-1e3, 1e3),
    level=st.floats(-1e3, 1e3),
    irregular=st.booleans(),
)
def test_a_straight_line_is_no_noise(seed, size, slope, level, irregular):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 1.5, 4000) if irregular else np.ones(4000)) * PERIOD
    noise = sample_noise(times, level + slope * size * times + size * rng.standard_normal(4000))
    assert noise == pytest.approx(size, rel=0.08)


def test_transients_in_less_than_a_tenth_of_the_differences_are_no_noise():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(4000)
    values[rng.choice(4000, 100, replace=False)] += 1e3
    assert sample_noise(np.arange(4000.0), values) == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize('seed', range(5))
def test_the_jitter_of_stamps_is_measured(seed):
    times = np.arange(5000) * PERIOD + 5e-5 * np.random.default_rng(seed).standard_normal(5000)
    assert stamp_jitter(times) == pytest.approx(5e-5, rel=0.05)
    assert stamp_jitter(np.arange(5000) / 512.0) == 0.0


def test_samples_count_for_less_while_the_pressure_changes_fast():
    """By the slope times the jitter, in the sensor's noise; at rest they count whole."""
    jitter = 5e-5
    rng = np.random.default_rng(0)
    times = STROKES.sample_times
    stamps = np.sort(times + jitter * rng.standard_normal(times.size))
    measured = np.interp(stamps, times, STROKES.measured) + STD * rng.standard_normal(times.size)
    jittered = replace(
        STROKES,
        times=stamps,
        samples=np.arange(stamps.size),
        inputs={'displacement': np.zeros(stamps.size), 'setpoint': np.zeros(stamps.size)},
        measured=measured,
    )
    weight = CHANNEL.precision(jittered, STROKES.measured)
    assert np.all((weight > 0.0) & (weight <= 1.0))
    assert np.median(weight) > 0.99
    fastest = np.max(np.abs(np.diff(STROKES.measured))) / PERIOD
    assert np.min(weight) == pytest.approx(1.0 / math.hypot(1.0, fastest * jitter / STD), rel=0.2)
    np.testing.assert_array_equal(CHANNEL.precision(STROKES, STROKES.measured), 1.0)


@pytest.mark.parametrize('settling', [0.05, 0.2])
def test_a_pressure_that_settles_otherwise_is_no_noise(settling):
    """What a model that lacks something leaves at rest, after each stroke; noise with a memory is still one."""
    since = np.mod(STROKES.sample_times, 0.4)
    left = 8.0 * STD * np.exp(-since / settling)
    white = STD * np.random.default_rng(5).standard_normal(since.size)
    assert heard(STROKES, white + left).std == pytest.approx(STD, rel=0.1)
    assert heard(STROKES, STD * coloured(5, since.size) + 0.1 * left).std > 0.8 * STD
