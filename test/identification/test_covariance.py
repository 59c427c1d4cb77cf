# SPDX-License-Identifier: Apache-2.0
"""The covariance of the parameters, on recordings of known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn import CHANNEL, recorded
from reference import AMBIENT, PSI, pressure_between_samples, step_like

from cfd_pneumatic.identification.fit.fit import fit_model, summary
from cfd_pneumatic.identification.fit.likelihood import Likelihood
from cfd_pneumatic.identification.preparation import prepare_recordings
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.recording import sampled

GAINS = np.array([4.3e6, 104.0, 19.4, 0.0105])
TIMES = np.arange(0.0, 3.0, 0.004)
OFFSET = 300.0
NOISE = 50.0
RECORDINGS = 100
FRACTIONS = (1.0, 0.0, 0.0)


def strokes():
    """Return the displacement of two strokes out and back [m]."""
    return sum(step_like(start, 0.12, sign * 1e-3)(TIMES) for start, sign in zip((0.3, 0.9, 1.5, 2.1), (1, -1, 1, -1)))


def experiments_of(pressures):
    setpoint = np.full(TIMES.size, AMBIENT + 5.0 * PSI)
    recordings = [
        recorded(TIMES, strokes(), setpoint, pressure, f'strokes {rank}') for rank, pressure in enumerate(pressures)
    ]
    return prepare_recordings(recordings, FRACTIONS).experiments(CHANNEL)


@pytest.fixture(scope='module')
def exact():
    setpoint = np.full(TIMES.size, AMBIENT + 5.0 * PSI + OFFSET)
    return pressure_between_samples(GAINS, TIMES, strokes(), setpoint)


def noisy(exact, seed):
    return exact + NOISE * np.random.default_rng(seed).normal(size=exact.size)


@pytest.fixture(scope='module')
def fits(exact):
    return [fit_model(CHANNEL, experiments_of([noisy(exact, seed)])) for seed in range(RECORDINGS)]


def offset_of(fit):
    return fit.model.recording_values[:, 0].mean()


def test_it_is_that_of_the_estimates_from_recording_to_recording(fits):
    assert {fit.covariance.names for fit in fits} == {(*NAMES, 'setpoint_offset')}
    reported = np.mean([fit.covariance.matrix for fit in fits], axis=0)
    found = np.cov([[*fit.model.parameters, offset_of(fit)] for fit in fits], rowvar=False)
    stds, found_stds = (np.sqrt(np.diag(matrix)) for matrix in (reported, found))
    np.testing.assert_allclose(stds, found_stds, rtol=0.2)
    correlations = found / np.outer(found_stds, found_stds)
    np.testing.assert_allclose(reported / np.outer(stds, stds), correlations, atol=0.25)
    off_diagonal = np.abs(correlations - np.eye(len(correlations)))
    assert np.max(off_diagonal) > 0.5  # a diagonal matrix would not have passed


def test_its_diagonal_has_the_squares_of_the_standard_errors(fits):
    for fit in fits[:5]:
        stds = [*(estimate.std for estimate in fit.estimates), fit.stds[0, 0]]
        np.testing.assert_allclose(np.diag(fit.covariance.matrix), np.square(stds), rtol=1e-9)


def test_the_mean_offset_of_several_recordings_is_better_known(exact):
    fit = fit_model(CHANNEL, experiments_of([noisy(exact, 0), noisy(exact + 200.0, 1)]))
    variance = fit.covariance.matrix[-1, -1]
    assert fit.covariance.names[-1] == 'setpoint_offset'
    assert 0.45 * np.mean(fit.stds[:, 0] ** 2) < variance < 0.75 * np.mean(fit.stds[:, 0] ** 2)


def test_the_offset_of_an_estimated_set_point_is_that_of_its_estimate(exact):
    recording = sampled(TIMES, strokes(), {'cylinder_a': noisy(exact, 0)}, name='without set-point')
    fit = fit_model(CHANNEL, prepare_recordings([recording], FRACTIONS).experiments(CHANNEL))
    assert fit.covariance.names == (*NAMES, 'setpoint_offset')
    assert fit.covariance.matrix[-1, -1] == pytest.approx(fit.stds[0, 0] ** 2)


def test_offsets_of_recorded_set_points_count_alone(exact):
    """The offset in the parameter file is theirs."""
    recordings = [
        recorded(TIMES, strokes(), np.full(TIMES.size, AMBIENT + 5.0 * PSI), noisy(exact, 0), 'with set-point'),
        sampled(TIMES, strokes(), {'cylinder_a': noisy(exact, 1)}, name='without set-point'),
    ]
    fit = fit_model(CHANNEL, prepare_recordings(recordings, FRACTIONS).experiments(CHANNEL))
    assert fit.covariance.matrix[-1, -1] == pytest.approx(fit.stds[0, 0] ** 2)


def test_a_held_parameter_has_no_row(exact):
    fit = fit_model(CHANNEL, experiments_of([exact + 1.5e3 * np.random.default_rng(0).normal(size=exact.size)]))
    held = {estimate.name for estimate in fit.estimates if not estimate.identifiable}
    assert held
    assert {*fit.covariance.names} == {*NAMES, 'setpoint_offset'} - held


def test_a_parameter_that_is_searched_but_not_reported_has_a_row(fits):
    """The others depend on it: without its row a prediction would lack what they make up for each other."""
    fit = fits[0]
    for slope, is_reported in ((100.0, True), (0.1, False)):
        model = replace(fit.model, effects={'volume_variation': (slope,)})
        (simulated,) = CHANNEL.simulated(fit.likelihood.experiments, model)
        found = summary(Likelihood.alike(CHANNEL, experiments_of([noisy(simulated, 0)])), model)
        assert (found.estimates[-1].name, found.estimates[-1].identifiable) == ('volume_variation.slope', is_reported)
        assert found.covariance.names == (*NAMES, 'volume_variation.slope', 'setpoint_offset')
        assert 30.0 < np.sqrt(found.covariance.matrix[4, 4]) < 50.0
