# SPDX-License-Identifier: Apache-2.0
"""What effects draw their starting values from: lags, frequencies and speeds that are known are found."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import CHANNEL, model, moved, with_pressure
from hypothesis import given
from hypothesis import strategies as st
from reference import AMBIENT, PSI, step_like

from cfd_pneumatic.model import TABLE_1
from cfd_pneumatic.model.effects import EFFECTS, PRESSURE_EFFECTS

GAINS = np.array(TABLE_1.table[0, 1:])
MODEL = model(GAINS)
PERIOD = 0.002


def strokes(duration=1.0, period=PERIOD):
    """Return an experiment of strokes out and back, and the pressure of the model in it [Pa]."""
    times = np.arange(round(duration / period)) * period
    displacement = sum(
        (-1.0) ** index * step_like(start, 0.012, 1.5e-3)(times) for index, start in enumerate(np.arange(0.3, 0.9, 0.2))
    )
    experiment = with_pressure(moved(times, displacement, np.full(times.size, AMBIENT + 5.0 * PSI)), MODEL)
    return experiment, experiment.measured


EXPERIMENT, SIMULATED = strokes()


def found(experiment, simulated):
    return CHANNEL.data([experiment], MODEL, [simulated])


def resting(duration, period=PERIOD):
    """Return an experiment of so many seconds, for what only the residual matters to."""
    times = np.arange(round(duration / period)) * period
    at = np.arange(times.size)
    return replace(
        EXPERIMENT,
        times=times,
        inputs={
            'displacement': np.linspace(0.0, 1e-3, times.size),
            'setpoint': np.full(times.size, AMBIENT + 5.0 * PSI),
        },
        samples=at,
        measured=np.full(times.size, AMBIENT + 5.0 * PSI),
    )


@given(samples=st.integers(-40, 40), noise=st.floats(0.0, 100.0), seed=st.integers(0, 99))
def test_finds_by_how_much_the_pressure_comes_late_or_early(samples, noise, seed):
    """Against a pressure that spans 7 kPa."""
    times = EXPERIMENT.sample_times
    late = np.interp(times - samples * PERIOD, times, SIMULATED)
    late += noise * np.random.default_rng(seed).standard_normal(late.size)
    assert found(replace(EXPERIMENT, measured=late), SIMULATED)['lag'] == pytest.approx(samples * PERIOD, abs=1e-9)


def test_a_level_is_no_lag():
    assert found(replace(EXPERIMENT, measured=SIMULATED + 5e3), SIMULATED)['lag'] == 0.0


@given(
    duration=st.sampled_from([1.0, 3.0, 20.0, 100.0]),
    position=st.floats(0.0, 1.0),
    phase=st.floats(0.0, 6.3),
    seed=st.integers(0, 99),
)
def test_finds_a_slow_period_under_noise_as_large(duration, position, phase, seed):
    """To within a quarter of the width of a line; half of it in a record that is too short to tell phase from level."""
    lowest = 2.0 / duration
    frequency = lowest + position * (2.9 - lowest)
    experiment = resting(duration)
    times = experiment.sample_times
    residual = 100.0 * np.sin(2.0 * np.pi * frequency * times + phase)
    residual += 70.0 * np.random.default_rng(seed).standard_normal(times.size)
    data = found(experiment, experiment.measured - residual)
    assert data['slow_frequency'] == pytest.approx(frequency, abs=0.25 / duration)


@pytest.mark.parametrize('phase', np.arange(0.0, 6.3, 0.5))
@pytest.mark.parametrize('frequency', [1.6, 2.2, 2.8])
def test_finds_it_on_a_record_shorter_than_two_periods(frequency, phase):
    experiment = resting(0.7)
    residual = 100.0 * np.sin(2.0 * np.pi * frequency * experiment.sample_times + phase)
    data = found(experiment, experiment.measured - residual)
    assert data['slow_frequency'] == pytest.approx(frequency, abs=0.1 * frequency)


@pytest.mark.parametrize('frequency', [0.01234, 0.4567, 1.23456, 2.9])
def test_finds_it_on_a_long_record_with_a_pause(frequency):
    """In half an hour a line is half a millihertz wide."""
    experiment = resting(1800.0, period=0.02)
    kept = np.flatnonzero(~((experiment.times > 400.0) & (experiment.times < 700.0)))
    experiment = replace(experiment, samples=kept, measured=experiment.measured[kept])
    residual = 100.0 * np.sin(2.0 * np.pi * frequency * experiment.sample_times)
    data = found(experiment, experiment.measured - residual)
    assert data['slow_frequency'] == pytest.approx(frequency, abs=0.25 / 1800.0)


@pytest.mark.parametrize('duration', [0.1, 0.3, 0.34])
def test_a_record_too_short_for_any_gives_one_within_bounds(duration):
    experiment = resting(duration)
    data = found(experiment, experiment.measured + np.linspace(0.0, 1.0, experiment.measured.size))
    assert 1e-2 <= data['slow_frequency'] <= 3.0


def test_speed_is_the_pistons_while_it_moves():
    """Up and down at 20 mm/s, and half of the time at rest."""
    times = np.arange(2000) * PERIOD
    displacement = np.interp(times % 2.0, [0.5, 1.0, 1.5, 2.0], [0.0, 0.01, 0.01, 0.0])
    experiment = moved(times, displacement, np.full(times.size, AMBIENT + 5.0 * PSI))
    assert found(experiment, experiment.measured)['speed'] == pytest.approx(0.02, rel=0.05)


def test_flows_that_limits_start_from():
    """K_sv times the largest error while charging, K_v times the largest while exhausting."""
    data = found(EXPERIMENT, SIMULATED)
    error = EXPERIMENT.at_samples('setpoint') - SIMULATED
    assert data['largest_charge'] == pytest.approx(GAINS[1] * np.max(error))
    assert data['largest_exhaust'] == pytest.approx(-GAINS[2] * np.min(error))


def test_numbers_of_the_recording():
    data = found(replace(EXPERIMENT, measured=SIMULATED + 30.0), SIMULATED)
    assert data['residual'] == pytest.approx(30.0)
    assert data['period'] == pytest.approx(PERIOD)
    assert data['duration'] == pytest.approx(1.0 - PERIOD)
    assert data['gauge'] == pytest.approx(5.0 * PSI, rel=0.01)
    assert data['highest_pressure'] == pytest.approx(np.max(SIMULATED) + 30.0)
    assert data['x_high'] - data['x_low'] == pytest.approx(1.5e-3, rel=0.01)
    assert [data[name] for name in ('k_x', 'k_sv', 'k_v', 'tau')] == pytest.approx(GAINS)


@pytest.mark.parametrize('name', PRESSURE_EFFECTS)
def test_every_effect_starts_within_its_bounds(name):
    for experiment in (EXPERIMENT, resting(0.7), resting(20.0)):
        for own in EFFECTS[name].starts(found(experiment, experiment.measured - 50.0)):
            assert len(own) == len(EFFECTS[name].parameters)
            for parameter, value in zip(EFFECTS[name].parameters, own):
                assert parameter.lower <= value <= parameter.upper, parameter.name
