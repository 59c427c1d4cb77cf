# SPDX-License-Identifier: Apache-2.0
"""Tests of a residual: silent on noise of any colour, awake to what a model may lack."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drawn import CHANNEL, experiments_of, model, recording_of, whole
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from cfd_pneumatic.identification.fit.likelihood import Likelihood
from cfd_pneumatic.identification.residual import tests as module
from cfd_pneumatic.identification.residual.tests import Test as ResidualTest
from cfd_pneumatic.identification.residual.tests import is_noise
from cfd_pneumatic.identification.residual.thresholds import LARGEST_COLOURED_NOISE
from studies.panel import draw_textbook

SEEDS = range(50)
STD = 52.0
MEMORY = {'white': 0.0, 'coloured': 0.9}


@cache
def out_and_back():
    """Return an experiment with the inputs of strokes out and back, and what the model makes of them [Pa]."""
    drawn = draw_textbook('out_and_back', 700)
    experiment = whole(experiments_of([recording_of(drawn)])[0])
    (simulated,) = CHANNEL.simulated([experiment], model(drawn.truth.gains))
    return experiment, simulated


def level_of(experiments, simulated):
    """Return the noise, of a displacement that was measured without any."""
    return CHANNEL.noise(experiments, simulated, model([0.0, 1.0, 1.0, 1.0]))


def noise(kind, seed):
    """Return noise of the size of a sensor's [Pa]."""
    memory = MEMORY[kind]
    white = np.random.default_rng([seed, 7]).standard_normal(out_and_back()[1].size + 300)
    return STD * math.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[300:]


def asked(kind, seed, lacking=0.0):
    """Return the tests of a residual that is noise and what a model lacks [Pa], by their names."""
    experiment, simulated = out_and_back()
    measured = replace(experiment, measured=simulated + noise(kind, seed) + lacking)
    level = level_of([measured], [simulated])
    return {test.name: test for test in Likelihood.alike(CHANNEL, [measured]).tested([simulated], level)}


def scaled(shape, share):
    """Return a shape that makes up a share of the residual's sum of squares, beside noise [Pa]."""
    shape = shape - np.mean(shape)
    return shape * STD * math.sqrt(share / (1.0 - share)) / np.std(shape)


def rate(lag):
    """Return the piston's speed `lag` samples ago [m/s]."""
    experiment, _ = out_and_back()
    return np.roll(np.gradient(experiment.at_samples('displacement'), experiment.sample_times), lag)


def power(name, lacking, kind='white', seeds=range(10)):
    """Return how often a test finds what a model lacks."""
    with pytest.MonkeyPatch.context() as patch:
        # These simulations set the threshold of a test whose power is not measured here.
        patch.setattr(module, 'LJUNG_BOX_SIMULATIONS', 3)
        return np.mean([not asked(kind, seed, lacking)[name].passed for seed in seeds])


@pytest.mark.parametrize('kind', MEMORY)
def test_noise_alone_hardly_ever_fails_a_test(kind, capsys):
    found = [asked(kind, seed) for seed in SEEDS]
    alarms = {name: int(np.sum([not one[name].passed for one in found])) for name in found[0]}
    with capsys.disabled():
        print(f'\n{kind} noise, false alarms in {len(found)}: {alarms}', end='')
    decisive = [name for name, test in found[0].items() if test.decisive]
    assert {'inputs', 'line', 'level', 'noise_floor'} <= set(decisive)
    assert all(alarms[name] <= 0.01 * len(found) for name in decisive)
    assert np.mean([is_noise(list(one.values())) for one in found]) >= 0.98


@pytest.mark.parametrize('kind', MEMORY)
def test_statistics_of_noise_stay_well_below_their_thresholds(kind):
    """Or the alarms above are rare by luck."""
    found = [asked(kind, seed) for seed in range(30)]
    for name in ('inputs', 'line', 'level', 'noise_floor'):
        assert np.median([one[name].statistic / one[name].threshold for one in found]) < 0.95, name


@pytest.mark.parametrize('kind', MEMORY)
@pytest.mark.parametrize('lag', [0, 4, 16])
def test_a_dependence_on_the_speed_is_found(lag, kind):
    """Twice the share that matters; of once that share 0.6 to 1.0 are found."""
    assert power('inputs', scaled(rate(lag), 2.0 * module.LARGEST_EXPLAINED), kind) >= 0.9


def test_an_immaterial_dependence_on_the_speed_is_left_alone():
    """On many samples a share of a hundredth is certain and still of no matter."""
    assert power('inputs', scaled(rate(0), 0.25 * module.LARGEST_EXPLAINED), seeds=range(20)) <= 0.1


def test_a_dependence_on_the_set_point_is_found():
    """In white noise a tenth of the residual, by its slow part."""
    experiment, _ = out_and_back()
    assert power('level', scaled(experiment.at_samples('setpoint'), 0.1)) >= 0.9


@pytest.mark.parametrize(
    ('kind', 'frequency', 'share'),
    [
        ('white', 9.0, 0.05),
        ('white', 33.0, 0.05),
        ('white', 120.0, 0.05),
        ('coloured', 9.0, 0.2),  # where noise with a memory of ten samples is loud; of 0.1 four in ten are found
        ('coloured', 33.0, 0.1),
        ('coloured', 120.0, 0.03),
    ],
)
def test_a_line_is_found(kind, frequency, share):
    experiment, _ = out_and_back()
    line = scaled(np.sin(2.0 * np.pi * frequency * experiment.sample_times), share)
    assert power('line', line, kind) >= 0.9


@pytest.mark.parametrize(('cycles', 'share', 'passed'), [(900, 0.03, False), (900, 0.005, True), (2, 0.01, True)])
def test_in_a_long_record_a_line_has_to_matter_and_slow_wandering_is_none(cycles, share, passed):
    """A fifth of what these hold would stand out of the spectrum of so many samples."""
    turns = np.linspace(0.0, cycles, 30_000, endpoint=False)
    noise = STD * np.random.default_rng(5).standard_normal(turns.size)
    spectrum = module._periodogram(noise + scaled(np.sin(2.0 * np.pi * turns), share))
    assert module._line_test([[spectrum]]).passed == passed


@pytest.mark.parametrize(('kind', 'size'), [('white', 0.5), ('coloured', 2.0)])
def test_a_drift_is_found(kind, size):
    """From -size to size, in standard deviations; of 1.0 in coloured noise half are found."""
    _, simulated = out_and_back()
    assert power('level', size * STD * np.linspace(-1.0, 1.0, simulated.size), kind) >= 0.9


@pytest.mark.parametrize(('kind', 'size', 'found'), [('white', 0.5, 0.9), ('coloured', 2.0, 0.6)])
def test_a_jump_is_found(kind, size, found):
    _, simulated = out_and_back()
    assert power('level', size * STD * (np.arange(simulated.size) > 0.6 * simulated.size), kind) >= found


def test_what_resembles_itself_more_than_white_noise_at_rest_is_found():
    """A slow wander while the piston moves; where the noise at rest has a colour, it may be that."""
    experiment, _ = out_and_back()
    wander = gaussian_filter1d(np.random.default_rng(0).standard_normal(experiment.measured.size), 3.0)
    wander *= np.abs(rate(0)) > 0.01 * np.max(np.abs(rate(0)))
    found = asked('white', 0, scaled(wander, 0.3))
    assert not found['ljung_box'].passed
    assert found['ljung_box'].decisive
    assert not asked('coloured', 0, scaled(wander, 0.3))['ljung_box'].decisive


@pytest.mark.parametrize('larger', [1.05, 1.25])
def test_a_residual_larger_than_the_noise_at_rest_is_found(larger):
    """White noise while the piston moves, so that no other test has a reason to fail."""
    experiment, simulated = out_and_back()
    level = level_of([replace(experiment, measured=simulated + noise('white', 0))], [simulated])
    measured = replace(experiment, measured=simulated + larger * noise('white', 0) * STD / level.std)
    alike = Likelihood.alike(CHANNEL, [measured])
    found = {test.name: test for test in alike.tested([simulated], replace(level, std=STD))}
    size = found['noise_floor']
    assert size.threshold == pytest.approx(module.LARGEST_SIZE_RATIO * (1.0 + 3.0 * level.uncertainty))
    assert size.passed == (larger < size.threshold)
    assert size.decisive


def test_where_the_noise_is_not_known_it_may_be_as_large_as_a_sensors_noise_can_be():
    experiment, simulated = out_and_back()
    measured = replace(experiment, measured=simulated + noise('white', 0))
    level = replace(level_of([measured], [simulated]), known=False)
    found = {test.name: test for test in Likelihood.alike(CHANNEL, [measured]).tested([simulated], level)}
    assert found['noise_floor'].threshold == LARGEST_COLOURED_NOISE
    assert found['noise_floor'].decisive
    assert found['inputs'].decisive


def test_where_noise_is_rounding_only_its_size_decides():
    experiment, simulated = out_and_back()
    measured = replace(experiment, measured=simulated + noise('white', 0))
    level = replace(level_of([measured], [simulated]), rounded=True)
    found = Likelihood.alike(CHANNEL, [measured]).tested([simulated], level)
    assert [test.name for test in found if test.decisive] == ['noise_floor']


def test_samples_that_do_not_count_are_not_asked():
    experiment, simulated = out_and_back()
    early = np.arange(simulated.size) < 0.6 * simulated.size
    measured = replace(experiment, measured=simulated + noise('white', 0) + 1e4 * ~early, chosen=early)
    level = level_of([replace(experiment, measured=simulated + noise('white', 0))], [simulated])
    assert is_noise(Likelihood.alike(CHANNEL, [measured]).tested([simulated], level))


def test_recordings_are_tested_together():
    experiment, simulated = out_and_back()
    ones = [replace(experiment, measured=simulated + noise('white', seed)) for seed in (1, 2)]
    level = level_of(ones, [simulated] * 2)
    assert is_noise(Likelihood.alike(CHANNEL, ones).tested([simulated] * 2, level))
    apart = [replace(ones[0], measured=ones[0].measured + scaled(rate(0), 0.3)), ones[1]]
    assert not is_noise(Likelihood.alike(CHANNEL, apart).tested([simulated] * 2, level))


def test_only_decisive_failures_leave_something_unexplained():
    passed, failed = ResidualTest('a', 1.0, 2.0, ''), ResidualTest('b', 2.0, 1.0, '')
    assert is_noise([passed, replace(failed, decisive=False)])
    assert not is_noise([passed, failed])
    assert ResidualTest('c', 1.0, 1.0, '').passed
