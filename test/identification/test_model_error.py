# SPDX-License-Identifier: Apache-2.0
"""The error of a model beyond the noise, on recordings with an added error of known size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn import recorded
from reference import AMBIENT, PSI, pressure_between_samples

from cfd_pneumatic.identification import error_beyond_noise, identify
from cfd_pneumatic.identification.residual.linear_prediction import autoregressive_series, variance_of_mean
from cfd_pneumatic.identification.residual.noise import Noise

GAINS = np.array([4.3e6, 104.0, 19.4, 0.0105])
TIMES = np.arange(0.0, 24.0, 0.002)
NOISE = 50.0
PERIOD = 2.0
MOVING = 1.2  # of each period [s]


def strokes():
    """Return strokes out and back, a rest after each pair [m]."""
    phase = np.mod(TIMES, PERIOD)
    return 1e-3 * (1.0 - np.cos(2.0 * np.pi * np.clip(phase / MOVING, 0.0, 1.0)))


@pytest.fixture(scope='module')
def result():
    setpoint = np.full(TIMES.size, AMBIENT + 5.0 * PSI)
    exact = pressure_between_samples(GAINS, TIMES, strokes(), setpoint)
    measured = exact + NOISE * np.random.default_rng(0).normal(size=exact.size)
    return identify([recorded(TIMES, strokes(), setpoint, measured)]).cylinders['cylinder_a']


def with_error(result, error, **changes):
    """Return a result whose recording has an error added that its model lacks [Pa]."""
    (comparison,) = result.comparisons
    experiment = replace(comparison.experiment, measured=comparison.experiment.measured + error, **changes)
    return replace(result, comparisons=(replace(comparison, experiment=experiment),))


def moves(result):
    """Return where the piston moves, and shortly afterwards."""
    return np.mod(result.experiments[0].sample_times, PERIOD) < MOVING + 0.15


def test_noise_alone_is_no_error(result):
    error = error_beyond_noise(result)
    assert 0.0 <= error.rest < 4.0
    assert 0.0 <= error.motion < 4.0


@pytest.mark.parametrize('size', [30.0, 100.0])
def test_a_slow_error_has_its_size(result, size):
    slow = size * np.sqrt(2.0) * np.sin(2.0 * np.pi * 0.9 * result.experiments[0].sample_times)
    error = error_beyond_noise(with_error(result, slow))
    assert error.motion == pytest.approx(size, rel=0.15)
    assert error.rest == pytest.approx(size, rel=0.4)  # a rest holds half a period of the sine


def test_rest_and_motion_are_apart(result):
    in_motion = error_beyond_noise(with_error(result, 80.0 * moves(result)))
    at_rest = error_beyond_noise(with_error(result, 80.0 * ~moves(result)))
    assert in_motion.motion == pytest.approx(80.0, rel=0.06)
    assert in_motion.rest < 15.0
    assert at_rest.rest == pytest.approx(80.0, rel=0.06)
    assert at_rest.motion < 15.0


def test_errors_outside_of_the_test_part_do_not_count(result):
    earlier = ~result.judged(result.comparisons[0])
    assert error_beyond_noise(with_error(result, 1e4 * earlier)) == error_beyond_noise(result)


def test_what_is_not_recorded_is_unknown(result):
    (comparison,) = result.comparisons
    displacement = 1e-3 * np.sin(2.0 * np.pi * comparison.experiment.times)
    never_rests = with_error(result, 0.0, inputs={**comparison.experiment.inputs, 'displacement': displacement})
    assert error_beyond_noise(never_rests).rest is None
    always_rests = with_error(result, 0.0, inputs={**comparison.experiment.inputs, 'displacement': 0.0 * displacement})
    assert error_beyond_noise(always_rests).motion is None


def setpoint_with_steps(result, every):
    experiment = result.experiments[0]
    level = experiment.inputs['setpoint'] + 1e3 * np.mod(np.floor(experiment.times / every), 2.0)
    return {**experiment.inputs, 'setpoint': level}


def test_errors_after_steps_of_the_set_point_do_not_count(result):
    times = result.experiments[0].sample_times
    after = np.mod(times, 1.0) < 0.25
    inputs = setpoint_with_steps(result, 1.0)
    assert error_beyond_noise(with_error(result, 1e4 * after, inputs=inputs)).motion < 10.0
    assert error_beyond_noise(with_error(result, 1e4 * after)).motion > 3e3


def test_a_set_point_that_changes_all_the_time_counts(result):
    inputs = setpoint_with_steps(result, 0.2)
    assert error_beyond_noise(with_error(result, 300.0, inputs=inputs)).motion == pytest.approx(300.0, rel=0.05)


def test_autocorrelated_noise_is_no_error(result):
    coefficients = np.array([0.9])
    innovations = NOISE * np.random.default_rng(1).normal(size=result.experiments[0].measured.size)
    noise = autoregressive_series(innovations, coefficients)
    coloured = with_error(result, noise)
    std = float(np.hypot(np.std(noise), NOISE))
    as_white = replace(coloured, noise=Noise(std, np.empty(0), 0.01, True, False))
    as_coloured = replace(coloured, noise=Noise(float(np.std(noise)), coefficients, 0.01, True, False))
    assert error_beyond_noise(as_white).motion > 50.0
    assert error_beyond_noise(as_coloured).motion < 40.0  # a third of the noise: few of its samples are independent


@pytest.mark.parametrize('coefficients', [[], [0.7], [1.2, -0.4]])
def test_the_mean_of_noise_has_the_variance_of_many_means(coefficients):
    innovations = np.random.default_rng(2).normal(size=1_000_000)
    noise = autoregressive_series(innovations, np.array(coefficients))
    means = noise.reshape(-1, 20).mean(axis=1)
    expected = variance_of_mean(np.array(coefficients), 20)
    assert np.var(means) / np.var(noise) == pytest.approx(expected, rel=0.03)


def test_the_error_after_steps_is_relative_to_the_steps(result):
    times = result.experiments[0].sample_times
    inputs = setpoint_with_steps(result, 1.0)
    after = np.mod(times, 1.0) < 0.3
    wrong = with_error(result, np.where(after, 80.0, 0.0), inputs=inputs)
    assert error_beyond_noise(wrong).per_step == pytest.approx(0.08, rel=0.1)
    assert error_beyond_noise(with_error(result, 0.0, inputs=inputs)).per_step < 0.01
    assert error_beyond_noise(result).per_step is None
