# SPDX-License-Identifier: Apache-2.0
"""The one look at the test part: what contradicts a verdict, and what strokes that scatter do not."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import moved, recording_of
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.identification.test_part import contradiction, not_tested
from cfd_pneumatic.identification.visited_range import outside_ranges
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS
from cfd_pneumatic.recording import CylinderSignals, Signal
from studies.panel import draw

TEST = PARTS.index('test')


@pytest.fixture(scope='module')
def strokes():
    """Return an experiment of thirty strokes of a second each."""
    times = np.arange(0.0, 30.0, 0.01)
    return moved(times, 1e-3 * np.sin(np.pi * times), np.full(times.size, 150e3))


def residual_of(experiment, seed, spread=0.0):
    """Return white noise of 1 Pa whose size varies from second to second."""
    rng = np.random.default_rng(seed)
    sizes = np.exp(spread * rng.standard_normal(40))[(experiment.sample_times + 0.5).astype(int)]
    return sizes * rng.standard_normal(experiment.part.size)


@pytest.mark.parametrize('spread', [0.0, 0.1, 0.3])
def test_strokes_that_are_alike_hardly_ever_contradict(strokes, spread):
    found = [contradiction([strokes], [residual_of(strokes, seed, spread)], 0.0) for seed in range(400)]
    assert sum(map(bool, found)) <= 4


def test_the_error_may_grow_by_less_where_strokes_hardly_scatter(strokes):
    test = strokes.part == TEST
    for spread, factor, contradicts in ((0.0, 1.25, True), (0.3, 1.25, False), (0.3, 2.0, True)):
        found = [
            contradiction([strokes], [np.where(test, factor, 1.0) * residual_of(strokes, seed, spread)], 0.0)
            for seed in range(100)
        ]
        assert (sum(map(bool, found)) >= 90) == contradicts


@given(factor=st.floats(3.0, 100.0), seed=st.integers(0, 1000))
def test_says_how_much_larger_the_error_is_and_not_why(strokes, factor, seed):
    larger = np.where(strokes.part == TEST, factor, 1.0)
    (clause,) = contradiction([strokes], [larger * residual_of(strokes, seed)], 1.0)
    words = clause.split()
    assert float(words[words.index('times') - 1]) == pytest.approx(factor, rel=0.5)
    assert clause.endswith('times that of the train part')


def test_what_is_below_the_noise_contradicts_nothing(strokes):
    larger = np.where(strokes.part == TEST, 1e-3, 1e-6)
    assert contradiction([strokes], [larger], 1e-2) == []
    assert contradiction([strokes], [larger], 1e-4) != []
    assert contradiction([strokes], [np.zeros_like(larger)], 0.0) == []


def test_without_a_test_part_there_is_nothing_to_look_at(strokes):
    fitted = replace(strokes, part=np.minimum(strokes.part, TEST - 1).astype(np.int8))
    assert contradiction([fitted], [residual_of(fitted, 0)], 1.0) == []


def test_a_recording_that_was_set_aside_whole_is_named(strokes):
    train, test = (
        replace(strokes, recording=name, part=np.full_like(strokes.part, PARTS.index(part)))
        for name, part in (('monday', 'train'), ('friday', 'test'))
    )
    (clause,) = contradiction([train, test], [residual_of(train, 0), 4.0 * residual_of(test, 1)], 1.0)
    assert clause.startswith('in friday the error of the test part is 4')


def test_a_device_that_changes_behind_the_validation_part_is_identified_in_two_parts():
    """On 0.1.0 nothing was missing, beside a test error several times that of the train part."""
    healthy, leaking = (recording_of(draw(effects, 'out_and_back', 3)) for effects in ((), 'leakage'))
    begin = identify([healthy], Options()).splits[0].bounds[1]
    before, after = (one.cylinders['cylinder_a'] for one in (healthy, leaking))
    times = before.pressure.times
    pressure = Signal(times, np.where(times < begin, before.pressure.values, after.pressure.values))
    changed = replace(healthy, cylinders={'cylinder_a': CylinderSignals(pressure, before.setpoint)}, force=None)
    found = identify([changed], Options(close_loop=True))
    (change,) = found.changes
    low, high = change.interval
    assert low - 0.2 <= begin <= high + 0.2
    assert (change.before.verdict, change.before.effects) == ('no_missing_effect', ())
    assert change.differences or change.after.effects
    (notice,) = [notice for notice in found.notices if notice.code == 'changed_during_recording']
    assert notice.message == change.text
    closure = found.channels['cylinder_a'].conclusion
    assert 'changed' not in closure.why


def test_an_effect_with_which_the_error_does_not_fall_is_not_added():
    """A dead band is worth it on the train part, and makes the error 107 %."""
    drawn = draw('supply_variation', 'out_and_back', 1017)
    result = identify([recording_of(drawn)], Options()).channels['cylinder_a']
    result.channel.library = {key: one for key, one in PRESSURE_EFFECTS.items() if key != 'supply_variation'}
    fit, closure = close_loop(result.fit)
    assert closure.verdict == 'unexplained'
    assert 'The error would change to' in closure.why
    assert closure.effects == ()
    assert fit.model.effects == {}
    assert closure.ratio is None
    assert not any(trial.accepted for trial in closure.tried)
    np.testing.assert_array_equal(fit.simulated[0], result.fit.simulated[0])


def test_states_what_the_test_part_does_not_test(strokes):
    assert not_tested([strokes]) == ()
    early = np.where(strokes.times < 10.0, 150e3, 160e3)
    inputs = {**strokes.inputs, 'setpoint': early}
    (clause,) = not_tested([replace(strokes, inputs=inputs)])
    assert clause == 'the test part has no set-point step: the response to set-points was not tested'
    late = {**strokes.inputs, 'setpoint': np.where(strokes.times < 27.0, 150e3, 160e3)}
    assert not_tested([replace(strokes, inputs=late)]) == ()
    last = np.where(strokes.sample_times > 28.7, TEST, 0).astype(np.int8)
    (clause,) = not_tested([replace(strokes, part=last)])
    assert clause == 'the test part has a single stroke: whether strokes repeat was not tested'
    assert not_tested([replace(strokes, part=np.zeros_like(last))]) == ()


def test_what_is_outside_of_the_range_contradicts_nothing(strokes):
    larger = np.where(strokes.part == TEST, 5.0, 1.0) * residual_of(strokes, 3)
    outside = strokes.part == TEST
    assert contradiction([strokes], [larger], 1.0) != []
    assert contradiction([strokes], [larger], 1.0, [outside]) == []


def test_a_test_part_with_wider_strokes_is_reported_with_errors_inside_and_outside():
    recording = recording_of(draw('leakage', 'out_and_back', 5))
    result = identify([recording], Options()).cylinders['cylinder_a']
    likelihood = result.fit.likelihood
    (experiment,) = likelihood.experiments
    assert outside_ranges(likelihood.channel, [experiment], result.fit.simulated, result.fit.model) == ()
    times = experiment.sample_times
    begin = times[experiment.part == TEST][0]
    middle = np.mean(experiment.inputs['displacement'])
    wider = np.where(experiment.times >= begin, 2.0, 1.0) * (experiment.inputs['displacement'] - middle) + middle
    experiment = replace(experiment, inputs={**experiment.inputs, 'displacement': wider})
    error = 10.0 * (experiment.part == TEST)
    found = outside_ranges(likelihood.channel, [experiment], [experiment.measured - error], result.fit.model)
    by_variable = {outside.variable: outside for outside in found}
    assert set(by_variable) == {'x', 'speed'}
    assert by_variable['x'].outside_rmse == pytest.approx(10.0)
    assert by_variable['x'].inside_rmse == pytest.approx(10.0)
    fitted = wider[experiment.times < begin]
    assert (by_variable['x'].low, by_variable['x'].high) == pytest.approx((fitted.min(), fitted.max()), abs=5e-5)
    assert 'Record several strokes up to there' in by_variable['x'].clause
