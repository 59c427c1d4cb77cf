# SPDX-License-Identifier: Apache-2.0
"""The loop on recordings of the rig with something wrong with it: what it names, and when it won't name anything."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import recording_of

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.conclusion import VERDICTS, verdict_of
from cfd_pneumatic.identification.data.tolerance import tolerance_from, tolerated
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.recording import CylinderSignals, Signal
from cfd_pneumatic.recording import recording_of as sampled_recording
from cfd_pneumatic.rig import device_named, out_and_back, record, surface_following
from studies.panel import draw, draw_textbook, oracle_rmse


def rms(result):
    """Return the RMSE of the model that closing the loop ends with [Pa]."""
    return float(np.sqrt(np.mean(result.comparisons[0].residual(1) ** 2)))


def closed(drawn):
    """Return what came of closing the loop on cylinder A, and the RMSE of the model that it ends with [Pa]."""
    result = identify([recording_of(drawn)], Options(close_loop=True)).cylinders['cylinder_a']
    return result.conclusion, rms(result)


@pytest.mark.parametrize(
    'effect', ['leakage', 'transport_delay', 'valve_dead_band', 'nonlinear_valve', 'heat_transfer']
)
def test_names_an_effect_and_reaches_the_floor(effect):
    drawn = draw(effect, 'out_and_back', 2)
    closure, rmse = closed(drawn)
    assert (closure.core, closure.effects) == ('linear', (effect,))
    assert rmse <= 1.05 * oracle_rmse(drawn)
    assert closure.ratio < 0.9
    assert closure.ratio_interval[0] <= closure.ratio <= closure.ratio_interval[1]
    accepted = [trial.effect for trial in closure.tried if trial.accepted]
    assert accepted[0] == effect


@pytest.mark.parametrize('effect', ['setpoint_delay', 'setpoint_lag'])
def test_a_set_point_that_acts_late_is_found_with_its_time(effect):
    drawn = draw(effect, 'out_and_back', 2)
    result = identify([recording_of(drawn)], Options(close_loop=True)).cylinders['cylinder_a']
    assert (result.conclusion.effects, result.conclusion.status) == ((effect,), 'confirmed')
    assert rms(result) <= 1.05 * oracle_rmse(drawn)
    assert result.found.model.effects[effect] == pytest.approx((drawn.truth.strengths[effect],), rel=0.03)


def test_a_dead_time_and_a_lag_of_the_set_point_are_found_together():
    drawn = draw(('setpoint_delay', 'setpoint_lag'), 'out_and_back', 1)
    result = identify([recording_of(drawn)], Options(close_loop=True)).cylinders['cylinder_a']
    assert set(result.conclusion.effects) == {'setpoint_delay', 'setpoint_lag'}
    assert rms(result) <= 1.05 * oracle_rmse(drawn)
    for effect, (value,) in result.found.model.effects.items():
        assert value == pytest.approx(drawn.truth.strengths[effect], rel=0.1)


@pytest.mark.parametrize('effect', ['setpoint_delay', 'setpoint_lag'])
def test_a_dead_time_and_a_lag_that_are_too_short_to_be_told_apart_are_a_tie(effect):
    closure, _ = closed(draw(effect, 'out_and_back', 0, given={effect: 5e-4}))
    (name,) = closure.effects
    assert {name, *closure.alternatives[name]} == {'setpoint_delay', 'setpoint_lag'}


@pytest.mark.parametrize('recorded', [True, False])
def test_without_steps_of_the_set_point_it_is_not_said_when_set_points_act(recorded):
    recording = recording_of(draw('setpoint_delay', 'paper_step', 2))
    if not recorded:
        signals = recording.cylinders['cylinder_a']
        recording = replace(recording, cylinders={'cylinder_a': replace(signals, setpoint=None)})
    conclusion = identify([recording], Options(close_loop=True)).cylinders['cylinder_a'].conclusion
    late = {'setpoint_delay', 'setpoint_lag'}
    assert late.isdisjoint(trial.effect for trial in conclusion.tried)
    assert late <= set(conclusion.not_visible)
    assert 'set-point steps' in conclusion.next_experiment


@pytest.mark.parametrize('noise', ['white', 'coloured', 'quantised'])
@pytest.mark.parametrize('schedule', ['paper_step', 'out_and_back'])
def test_names_nothing_where_nothing_is_missing(schedule, noise):
    closure, _ = closed(draw_textbook(schedule, 2, noise))
    assert closure.effects == ()
    assert closure.verdict == 'no_missing_effect'
    assert closure.ratio is None


def test_without_rests_it_is_said_that_what_is_left_may_be_more_than_noise():
    recording = recording_of(draw_textbook('surface_following', 20, 'coloured')).between(0.0, 12.0)
    closure = identify([recording], Options(close_loop=True)).cylinders['cylinder_a'].conclusion
    assert closure.verdict == 'no_missing_effect'
    assert (
        'is 2.7 times the noise from sample to sample. Nothing is missing if this noise is autocorrelated'
        in closure.why
    )


def test_without_rests_a_name_beside_more_than_white_noise_is_a_hypothesis():
    closure, _ = closed(draw('leakage', 'out_and_back', 2))
    assert closure.status == 'confirmed'
    (floor,) = (one for one in closure.tests_after if one.name == 'noise_floor')
    more, unknown = (replace(floor, statistic=2.7, threshold=6.0),), replace(closure.noise, known=False)
    assert replace(closure, tests_after=more, noise=unknown).status == 'hypothesis'
    assert replace(closure, tests_after=more).status == 'confirmed'  # rests tell that noise has a memory
    _, why = verdict_of('linear', ('leakage',), {}, more, None, 0.5, (0.4, 0.6), has_rests=False)
    assert 'error is 2.7 times the noise from sample to sample. Nothing more is missing if' in why


def test_a_law_is_found_only_where_what_is_left_is_noise():
    closure, _ = closed(draw('leakage', 'out_and_back', 2))
    (floor,) = (one for one in closure.tests_after if one.name == 'noise_floor')
    for statistic, expected in (1.0, 'shape_found'), (2.7, 'unexplained'):
        tests = (replace(floor, statistic=statistic, threshold=1.2),)
        verdict, why = verdict_of('linear', (), {}, tests, None, 0.5, (0.4, 0.6), curve='the valves pass less')
        assert verdict == expected
        assert 'the valves pass less' in why


@pytest.mark.parametrize('effect', ['pulsation', pytest.param('set_point_jump', marks=pytest.mark.long)])
def test_does_not_pretend_to_know_what_is_none_of_its_effects(effect):
    closure, _ = closed(draw(effect, 'out_and_back', 1))
    assert closure.verdict == 'unexplained'
    assert 'No known effect' in closure.why


def test_a_late_displacement_is_found_where_it_leads_the_gains_astray():
    """At first no stroke seems to move the pressure."""
    drawn = draw('displacement_delay', surface_following(60e3, duration=20.0, seed=2), 0)
    result = identify([recording_of(drawn)], Options(close_loop=True)).cylinders['cylinder_a']
    assert result.fit.model.parameters[0] < 1e4
    assert result.conclusion.effects == ('displacement_delay',)
    assert rms(result) <= 1.05 * oracle_rmse(drawn)
    (late,) = result.found.model.effects['displacement_delay']
    assert late == pytest.approx(drawn.truth.strengths['displacement_delay'], rel=0.01)
    assert result.fit.estimates[0].value is None
    assert [one.value for one in result.gains] == pytest.approx(drawn.truth.gains, rel=0.02), 'each is told now'


def test_a_pressure_that_comes_before_its_piston_is_suspect():
    """It was stamped 10 ms early."""
    recording = recording_of(draw_textbook('out_and_back', 2, 'white'))
    signals = recording.cylinders['cylinder_a']
    early = replace(signals.pressure, times=signals.pressure.times - 0.01)
    found = identify(
        [replace(recording, cylinders={'cylinder_a': replace(signals, pressure=early)})], Options(close_loop=True)
    )
    conclusion = found.cylinders['cylinder_a'].conclusion
    assert (conclusion.effects, conclusion.status) == (('transport_delay',), 'hypothesis')
    (told,) = (one for one in found.notices if one.code == 'size_suspect')
    assert 'the pressure leads the displacement: its delay is -10 ms' in told.message


@pytest.mark.parametrize(('pressure', 'verdict'), [(100.0, 'unexplained'), (2000.0, 'no_missing_effect')])
def test_what_is_left_within_the_tolerance_is_not_unexplained(pressure, verdict):
    recording = recording_of(draw('mains_hum', 'out_and_back', 1))
    options = Options(close_loop=True, tolerance=((pressure, 'Pa'),))
    result = identify([recording], options).cylinders['cylinder_a']
    assert 100.0 < result.rmse(1) < 2000.0
    assert result.conclusion.verdict == verdict
    assert ('within the tolerance of 2e+03 Pa' in result.conclusion.why) == (verdict == 'no_missing_effect')
    assert 'contains a tone' in result.conclusion.why


def test_a_tolerance_is_written_with_its_unit():
    assert tolerance_from([]) == ()
    assert tolerance_from(['300Pa', '2.5 N', '1%']) == ((300.0, 'Pa'), (2.5, 'N'), (1.0, '%'))
    assert tolerated(((5.0, 'Pa'), (1.0, '%')), 'Pa', 3e4) == 300.0
    assert tolerated(((5.0, 'Pa'),), 'N', 10.0) == 0.0
    for wrong in ('300', 'Pa', '-1N', '1 psi', '1e3Pa', ''):
        with pytest.raises(InputError, match='Give Pa, N or percent of the span, as 300Pa, 2N or 1%'):
            tolerance_from([wrong])


@pytest.mark.parametrize('odd', [None, 1])
def test_a_recording_of_another_device_is_told_from_the_others(odd):
    devices = [device_named('paper', 'effects_a.leak_conductance=1e-9' if one == odd else '') for one in range(3)]
    recordings = []
    for seed, device in enumerate(devices):
        one = sampled_recording(record(out_and_back(), device, seed=seed))
        own = {'cylinder_a': one.cylinders['cylinder_a']}
        recordings.append(replace(one, name=f'run_{seed}', cylinders=own, force=None))
    notices = identify(recordings, Options(close_loop=True, core='linear')).notices
    told = [one.message for one in notices if one.code == 'recording_differs']
    assert all(message.startswith(f'run_{odd}, cylinder_a: the error is ') for message in told)
    assert len(told) == (odd is not None)


def test_the_test_part_decides_nothing():
    """It may withdraw what was found; every number of the model is that of the other parts."""
    recording = recording_of(draw('leakage', 'out_and_back', 0))
    honest = identify([recording], Options(close_loop=True)).cylinders['cylinder_a']
    experiment = honest.experiments[0]
    begins = experiment.sample_times[experiment.part == 2][0]
    signals = recording.cylinders['cylinder_a']
    spoilt = signals.pressure.values + np.where(signals.pressure.times >= begins, 5e3, 0.0)
    recording = replace(
        recording, cylinders={'cylinder_a': CylinderSignals(Signal(signals.pressure.times, spoilt), signals.setpoint)}
    )
    before_loop = identify([recording]).cylinders['cylinder_a'].fit  # the whole loop would identify two parts
    fit, conclusion = close_loop(before_loop)
    assert conclusion.verdict == 'unexplained'
    assert 'times that of the train part' in conclusion.why
    assert [trial.effect for trial in conclusion.tried] == [trial.effect for trial in honest.conclusion.tried]
    found = honest.found if conclusion.effects else honest.fit
    np.testing.assert_allclose(fit.model.parameters, found.model.parameters, rtol=1e-6)
    error = experiment.measured + 5e3 * (experiment.part == 2) - fit.simulated[0]
    assert np.sqrt(np.mean(error[experiment.part == 2] ** 2)) > 4e3


def test_too_few_samples_are_insufficient_data():
    recording = recording_of(draw_textbook('paper_step', 0))

    def thinned(signal):
        return Signal(signal.times[::5], signal.values[::5])

    signals = recording.cylinders['cylinder_a']
    recording = replace(
        recording,
        displacement=thinned(recording.displacement),
        cylinders={'cylinder_a': CylinderSignals(thinned(signals.pressure), signals.setpoint)},
        force=None,
    )
    closure = identify([recording], Options(close_loop=True)).channels['cylinder_a'].conclusion
    assert closure.verdict == 'insufficient_data'
    assert closure.next_experiment
    assert closure.effects == ()


def test_a_single_step_says_what_it_could_not_show():
    closure, _ = closed(draw_textbook('paper_step', 1))
    assert {'leakage', 'operating_point', 'volume_variation'} <= set(closure.not_visible)
    assert 'set-point' in closure.next_experiment
    assert closure.verdict in VERDICTS
