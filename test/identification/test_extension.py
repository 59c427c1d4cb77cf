# SPDX-License-Identifier: Apache-2.0
"""Fits of effects: parameters that a pressure was made with are found again, within what their errors say."""

from dataclasses import replace
from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from drawn import CHANNEL, alike, covariance, model, moved, slope_of, with_pressure
from hypothesis import given
from hypothesis import strategies as st
from reference import AMBIENT, PSI, step_like
from scipy.signal import lfilter
from scipy.stats import chi2

from cfd_pneumatic.identification.data import experiment
from cfd_pneumatic.identification.fit.fit import find_optimum
from cfd_pneumatic.model import TABLE_1, Cylinder, OperatingPoints
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS

GAINS = np.array(TABLE_1.table[0, 1:])
PERIOD = 0.002
NOISE = 50.0


def strokes(amplitude=1.5e-3, levels=(5.0, 9.0), duration=3.2, seed=0):
    """Return an experiment of strokes out and back of two sizes, at two set-points."""
    times = np.arange(round(duration / PERIOD)) * PERIOD
    setpoint = AMBIENT + PSI * np.where((times > 1.5) & (times <= 2.9), levels[1], levels[0])
    displacement = np.zeros(times.size)
    for at, height in ((0.2, 1.0), (0.8, 0.4), (1.8, 1.0), (2.3, 0.4)):
        displacement += amplitude * height * (step_like(at, 0.012, 1.0)(times) - step_like(at + 0.3, 0.02, 1.0)(times))
    return moved(times, displacement, setpoint, seed=seed)


STROKES = strokes()

KNOWN = [
    ('volume_variation', (50.0,)),
    ('volume_variation', (-40.0,)),
    ('operating_point', (1.0, 2.3e5, 1.5)),
    ('set_point_drift', (-300.0,)),
    ('displacement_lag', (0.003,)),
    ('displacement_delay', (0.03,)),
    ('supply_variation', (200.0, -150.0, 1.7)),
    ('valve_hysteresis', (300.0,)),
    ('droop', (0.01, 0.15)),
    ('leakage', (1.0, 0.0)),
    ('leakage', (1.0, 1.0)),
    ('positional_leakage', (3.0, 8e-4, 4e-4, 0.01, 1.0, 0.0)),
    ('setpoint_delay', (0.0313,)),
    ('setpoint_lag', (0.02,)),
    ('transport_delay', (0.0033,)),
    ('transport_delay', (-0.0033,)),
    ('flow_saturation', (3e5, 1.5e5)),
    ('lost_motion', (8e-5,)),
    ('sensor_lag', (0.004,)),
    ('valve_dead_band', (400.0,)),
    ('line_resonance', (40.0, 0.2)),
    ('nonlinear_valve', (0.7,)),
    ('nonlinear_valve', (1.4,)),
    ('line_restriction', (0.01, 0.1)),
    ('heat_transfer', (5.0,)),
]
"""Effects with parameters by which these strokes show them."""


AWAY = {'frequency': 1.03, 'exponent': 1.15, 'supply': 1.2}
"""From how far a search begins where it is not from two fifths: closer, or another optimum is nearer."""


def begun(effects, count=1):
    """Return where a search begins: gains are a fifth too large, effects two fifths."""
    away = {
        name: tuple(
            value if parameter.choice else value * AWAY.get(parameter.name, 1.4)
            for parameter, value in zip(PRESSURE_EFFECTS[name].parameters, own)
        )
        for name, own in effects.items()
    }
    return model(1.2 * GAINS, away, (0.0,) * count, (0.0,) * count)


def fitted(experiments, effects):
    """Return a fit to all of some experiments from begun, with its residuals and Jacobian."""
    found, _ = find_optimum(alike(experiments), begun(effects, len(experiments)), 1e-10, 100)
    return found, slope_of(experiments, found)


def deviations(found, slope, truth):
    """Return by how much gains and effects' parameters are off, as they are searched, and their covariance."""
    spread = covariance(slope.jacobian, slope.residuals, slope.residuals.size - found.unknowns)
    values = dict(zip(('k_x', 'k_sv', 'k_v', 'tau'), zip(found.parameters, truth.parameters)))
    for name, own in found.effects.items():
        for parameter, value, true in zip(PRESSURE_EFFECTS[name].parameters, own, truth.effects[name]):
            values[f'{name}.{parameter.name}'] = (value, true)
    at = [index for index, name in enumerate(slope.names) if name and np.any(slope.jacobian[:, index])]
    off = [
        np.log(values[slope.names[index]][0] / values[slope.names[index]][1])
        if slope.logarithmic[index]
        else values[slope.names[index]][0] - values[slope.names[index]][1]
        for index in at
    ]
    return np.array(off), spread[np.ix_(at, at)]


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize(('name', 'own'), [pytest.param(name, own, id=f'{name}-{own[0]:g}') for name, own in KNOWN])
def test_what_a_pressure_was_made_with_is_found(name, own, seed):
    truth = model(GAINS, {name: own}, (150.0,), (0.0,))
    noise = NOISE * np.random.default_rng([seed, *name.encode()]).standard_normal(STROKES.measured.size)
    experiment = with_pressure(STROKES, truth, noise)
    found, slope = fitted([experiment], {name: own})
    left = CHANNEL.simulated([experiment], found)[0] - experiment.measured
    assert np.sqrt(np.mean(left**2)) <= 1.0005 * np.sqrt(np.mean(noise**2)), 'the truth itself is not beaten'
    off, spread = deviations(found, slope, truth)
    assert np.all(np.abs(off) < 3.5 * np.sqrt(np.diag(spread)))
    assert off @ np.linalg.solve(spread, off) < chi2.isf(1e-4, off.size)


def test_standard_errors_are_what_estimates_scatter_by():
    truth = model(GAINS, {'sensor_lag': (0.004,)}, (0.0,), (0.0,))
    scores = []
    for seed in range(60):
        noise = NOISE * np.random.default_rng(seed).standard_normal(STROKES.measured.size)
        off, spread = deviations(*fitted([with_pressure(STROKES, truth, noise)], truth.effects), truth)
        scores.append(off / np.sqrt(np.diag(spread)))
    scatter = np.std(scores, axis=0)
    assert np.all((scatter > 0.7) & (scatter < 1.3)), 'of 60, to three standard errors'
    assert np.all(np.abs(np.mean(scores, axis=0)) < 4.0 / np.sqrt(60))


@pytest.mark.parametrize('memory', [0.0, 0.8], ids=['white', 'coloured'])
def test_units_of_unknowns_do_not_matter_to_their_errors(memory):
    """Metres beside hertz, and an unknown on which nothing depends."""
    rng = np.random.default_rng(0)
    jacobian = np.column_stack([rng.standard_normal((500, 3)), np.zeros(500)])
    residuals = lfilter([1.0], [1.0, -memory], rng.standard_normal(500))
    units = np.array([1e-7, 1.0, 1e7, 1.0])
    plain = covariance(jacobian, residuals, 496)
    np.testing.assert_allclose(
        covariance(jacobian * units, residuals, 496), plain / np.outer(units, units), rtol=1e-6, atol=1e-30
    )
    assert not np.any(plain[3])
    if memory == 0.0:
        expected = np.linalg.inv(jacobian[:, :3].T @ jacobian[:, :3]) * np.sum(residuals**2) / 496
        np.testing.assert_allclose(plain[:3, :3], expected, rtol=1e-9)


def test_choices_stay_as_they_are():
    truth = model(GAINS, {'leakage': (1.0, 1.0)}, (0.0,), (0.0,))
    found, slope = fitted([with_pressure(STROKES, truth)], truth.effects)
    assert found.effects['leakage'][1] == 1.0
    assert 'leakage.orifice' not in slope.names
    assert found.unknowns == len(slope.names) == 4 + 1 + 1, 'gains, offset, conductance'


def test_without_noise_the_truth_is_found_exactly():
    truth = model(GAINS, {'sensor_lag': (0.004,), 'leakage': (1.0, 0.0)}, (150.0,), (0.0,))
    found, _ = fitted([with_pressure(STROKES, truth)], truth.effects)
    np.testing.assert_allclose(found.parameters, GAINS, rtol=1e-5)
    assert found.effects['sensor_lag'] == pytest.approx((0.004,), rel=1e-5)
    assert found.effects['leakage'][0] == pytest.approx(1.0, rel=1e-4)
    assert found.recording_values[0, 0] == pytest.approx(150.0, abs=0.1)


@pytest.mark.parametrize('name', ['leakage', 'transport_delay'])
def test_recordings_with_offsets_of_their_own_are_fitted_together(name):
    own = dict(KNOWN)[name]
    offsets = (300.0, -200.0)
    apart = [strokes(), strokes(1e-3, (7.0, 12.0), seed=1)]
    rng = np.random.default_rng(5)
    experiments = [
        with_pressure(one, model(GAINS, {name: own}, (offset,), (0.0,)), NOISE * rng.standard_normal(one.measured.size))
        for one, offset in zip(apart, offsets)
    ]
    experiments[1] = replace(experiments[1], index=1)
    truth = model(GAINS, {name: own}, offsets, (0.0, 0.0))
    found, slope = fitted(experiments, {name: own})
    off, spread = deviations(found, slope, truth)
    assert np.all(np.abs(off) < 3.5 * np.sqrt(np.diag(spread)))
    (offset_a, offset_b) = (index for index, one in enumerate(slope.names) if not one)
    whole = covariance(slope.jacobian, slope.residuals, slope.residuals.size)
    for index, value, true in zip((offset_a, offset_b), found.recording_values[:, 0], offsets):
        assert abs(value - true) < 3.5 * np.sqrt(whole[index, index])
    first = slice(0, experiments[0].measured.size)
    assert not np.any(slope.jacobian[first, offset_b]), 'one recording knows nothing of the other offset'


def test_where_a_band_lets_it_rest_anywhere_the_start_is_found():
    truth = model(GAINS, {'valve_dead_band': (400.0,)}, (0.0,), (250.0,))
    found, _ = fitted([with_pressure(STROKES, truth)], truth.effects)
    assert found.recording_values[0, 1] - 250.0 == pytest.approx(-found.recording_values[0, 0], abs=5.0)
    assert found.effects['valve_dead_band'][0] == pytest.approx(400.0, rel=0.02)


def test_samples_without_weight_do_not_count():
    truth = model(GAINS, {'sensor_lag': (0.004,)}, (0.0,), (0.0,))
    experiment = with_pressure(STROKES, truth)
    late = experiment.sample_times > 2.0
    spoilt = replace(experiment, measured=experiment.measured + 5e3 * late)
    weighted, _ = find_optimum(alike([spoilt], [np.where(late, 0.0, 1.0)]), begun(truth.effects), 1e-10, 100)
    masked, _ = find_optimum(alike([replace(spoilt, chosen=~late)]), begun(truth.effects), 1e-10, 100)
    for found in (weighted, masked):
        np.testing.assert_allclose(found.parameters, GAINS, rtol=1e-4)
        assert found.effects['sensor_lag'] == pytest.approx((0.004,), rel=1e-4)


@pytest.mark.parametrize('name', dict(KNOWN))
def test_the_jacobian_is_the_slope_of_the_residuals(name):
    """Against central differences of a thousand times the step."""
    truth = model(GAINS, {name: dict(KNOWN)[name]})
    experiment = with_pressure(STROKES, truth, 30.0)
    slope = slope_of([experiment], truth)
    for index, full in enumerate(slope.names):
        if full in ('k_x', 'k_sv', 'k_v', 'tau'):
            at = ('k_x', 'k_sv', 'k_v', 'tau').index(full)
            sides = [
                replace(truth, parameters=GAINS * np.where(np.arange(4) == at, np.exp(h), 1.0)) for h in (1e-2, -1e-2)
            ]
            step = 2e-2
        elif full:
            own = np.array(truth.effects[name])
            at = [parameter.name for parameter in PRESSURE_EFFECTS[name].parameters].index(full.split('.')[1])
            change = 1e-2 * abs(own[at])
            sides = [
                replace(truth, effects={name: tuple(own + sign * change * (np.arange(own.size) == at))})
                for sign in (1.0, -1.0)
            ]
            step = 2e-2 if slope.logarithmic[index] else 2.0 * change
        else:
            continue
        up, down = (CHANNEL.simulated([experiment], side)[0] for side in sides)
        expected = (up - down) / step
        if not np.any(expected):
            assert not np.any(slope.jacobian[:, index])
            continue
        error = np.sqrt(np.mean((slope.jacobian[:, index] - expected) ** 2)) / np.sqrt(np.mean(expected**2))
        assert error < 0.1, full


def fine_truth(experiment, delay, parts):
    """Return the paper's pressure on a grid `parts` times as fine, read `delay` seconds late [Pa]."""
    steps = np.arange(parts) / parts
    times = np.append((experiment.times[:-1, None] + np.diff(experiment.times)[:, None] * steps).ravel(), 0.0)
    times[-1] = experiment.times[-1]
    displacement = np.interp(times, experiment.times, experiment.inputs['displacement'])
    setpoint = experiment.inputs['setpoint'][np.ceil(np.arange(times.size) / parts).astype(int)]
    pressure = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT).simulate(times, displacement, setpoint)
    return np.interp(np.clip(experiment.sample_times - delay, times[0], times[-1]), times, pressure)


@pytest.mark.parametrize('delay', [0.00037, 0.002, 0.0313, -0.00037, -0.0313, 0.0])
def test_reading_late_is_exact(delay):
    """Between samples 2 ms apart a pressure that rings at 7 Hz bends by 100 Pa: it has to be simulated there."""
    (pressure,) = CHANNEL.simulated([STROKES], model(GAINS, {'transport_delay': (delay,)}))
    np.testing.assert_allclose(pressure, fine_truth(STROKES, delay, 40), rtol=0.0, atol=6.0)


def exact_with_late_setpoint(experiment, delay):
    """Return the paper's pressure, exactly integrated, with each set-point a delay later [Pa]."""
    changes = np.flatnonzero(np.diff(experiment.inputs['setpoint']))
    acting_from = experiment.times[changes] + delay
    times = np.union1d(experiment.times, acting_from)
    commanded = experiment.inputs['setpoint'][np.append(0, changes + 1)]
    acting = commanded[np.searchsorted(acting_from, np.append(times[0], times[:-1]), side='right')]
    displacement = np.interp(times, experiment.times, experiment.inputs['displacement'])
    pressure = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT).simulate(times, displacement, acting)
    return pressure[np.searchsorted(times, experiment.sample_times)]


@pytest.mark.parametrize('delay', [0.0, 0.00037, 0.002, 0.0313, 0.5])
def test_a_late_set_point_is_exact_to_a_fraction_of_a_sample(delay):
    """Within a sample of 2 ms the regulator changes the pressure by kilopascals."""
    (pressure,) = CHANNEL.simulated([STROKES], model(GAINS, {'setpoint_delay': (delay,)}))
    np.testing.assert_allclose(pressure, exact_with_late_setpoint(STROKES, delay), rtol=0.0, atol=12.0)
    off_by_a_tenth = exact_with_late_setpoint(STROKES, delay + 0.0002)
    assert np.max(np.abs(pressure - off_by_a_tenth)) > 100.0


def test_a_late_set_point_acts_on_the_parabolas_of_a_smoothed_motion():
    """A step that is split keeps the parabola, so that another set-point alone moves the pressure."""
    blocks, split = (list(STROKES.parabolic.blocks(setpoint_delay=delay)) for delay in (0.0, 0.00037))
    assert sum(block.times.size for block in split) > sum(block.times.size for block in blocks)
    for block, finer in zip(blocks, split):
        kept = np.searchsorted(finer.times, block.times)
        np.testing.assert_array_equal(finer.times[kept], block.times)
        np.testing.assert_array_equal(finer.inputs['displacement'][kept], block.inputs['displacement'])
        steps = np.searchsorted(block.times, finer.times)
        np.testing.assert_array_equal(finer.inputs['acceleration'], block.inputs['acceleration'][steps])
        for added in np.setdiff1d(np.arange(finer.times.size), kept):
            before, after = finer.times[added] - finer.times[added - 1], finer.times[added + 1] - finer.times[added]
            x = finer.inputs['displacement'][added - 1 : added + 2]
            bend = 2.0 * ((x[2] - x[1]) / after - (x[1] - x[0]) / before) / (before + after)
            assert bend == pytest.approx(finer.inputs['acceleration'][added], rel=1e-6, abs=1e-3)


@given(samples=st.integers(0, 200), fraction=st.floats(0.01, 0.99) | st.just(0.0))
def test_a_late_set_point_changes_when_set_points_act_and_nothing_else(samples, fraction):
    delay = (samples + fraction) * 0.002
    with patch.object(experiment, 'BLOCK_SAMPLES', 500):
        blocks = list(STROKES.blocks(setpoint_delay=delay))
    np.testing.assert_array_equal(
        np.concatenate([block.times[block.sample_indices] for block in blocks]), STROKES.sample_times
    )
    assert all(following.times[0] == block.times[-1] for block, following in pairwise(blocks))
    times, displacement, setpoint = (
        np.concatenate([first[:1], *(series[1:] for series in (first, *following))])
        for first, *following in (
            [block.times for block in blocks],
            *([block.inputs[name] for block in blocks] for name in ('displacement', 'setpoint')),
        )
    )
    assert np.all(np.diff(times) > 0.0)
    np.testing.assert_allclose(
        displacement, np.interp(times, STROKES.times, STROKES.inputs['displacement']), rtol=0.0, atol=1e-15
    )
    steps = np.searchsorted(STROKES.times, np.maximum(0.5 * (times[1:] + times[:-1]) - delay, STROKES.times[0]))
    lasting = np.diff(times) > 1e-9  # a step that is rounding may belong to either side
    np.testing.assert_array_equal(setpoint[1:][lasting], STROKES.inputs['setpoint'][steps][lasting])


@given(samples=st.integers(-150, 150), fraction=st.floats(0.01, 0.99) | st.just(0.0))
def test_reading_late_changes_when_samples_are_taken_and_nothing_else(samples, fraction):
    delay = (samples + fraction) * 0.002
    with patch.object(experiment, 'BLOCK_SAMPLES', 500):
        blocks = list(STROKES.blocks(delay=delay))
    wanted = np.clip(STROKES.sample_times - delay, STROKES.times[0], STROKES.times[-1])
    np.testing.assert_array_equal(np.concatenate([block.times[block.sample_indices] for block in blocks]), wanted)
    assert all(following.times[0] == block.times[-1] for block, following in pairwise(blocks))
    times = np.concatenate([blocks[0].times[:1], *(block.times[1:] for block in blocks)])
    displacement, setpoint = (
        np.concatenate([blocks[0].inputs[name][:1], *(block.inputs[name][1:] for block in blocks)])
        for name in ('displacement', 'setpoint')
    )
    assert np.all(np.diff(times) > 0.0)
    reached = STROKES.times <= times[-1]
    kept = np.searchsorted(times, STROKES.times[reached])
    np.testing.assert_array_equal(times[kept], STROKES.times[reached])
    np.testing.assert_array_equal(displacement[kept], STROKES.inputs['displacement'][reached])
    np.testing.assert_array_equal(setpoint[kept], STROKES.inputs['setpoint'][reached])
    steps = np.searchsorted(STROKES.times, 0.5 * (times[1:] + times[:-1]))
    lasting = np.diff(times) > 1e-9  # a step that is rounding may belong to either side
    np.testing.assert_array_equal(setpoint[1:][lasting], STROKES.inputs['setpoint'][steps][lasting])
