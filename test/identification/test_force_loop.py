# SPDX-License-Identifier: Apache-2.0
"""
Closing the loop on the force: effects named that are there, none that aren't, and what can't be told said so.

Recordings come from the rig, which shares no code with the model, and from a real cylinder.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn import both_cylinders
from drawn import experiments_of as experiments_on
from measured import MAPPING, ROOT, needs_measured_data
from reference import AMBIENT

from cfd_pneumatic.identification import Geometry, Options, identify
from cfd_pneumatic.identification.channels.channel import Model
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.conclusion import VERDICTS, part_errors, verdict_of, withdraw_effects
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.fit.fit import fit_model
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.identification.search.stepwise import Trial
from cfd_pneumatic.model.effects import FORCE_EFFECTS
from cfd_pneumatic.recording import Signal, read_mapping, read_recording, recording_of
from cfd_pneumatic.rig import device_named, paper_step, record, surface_following
from studies.panel import draw, force_oracle_rmse

AREA = 1.14e-3
BORE = 0.25 * math.pi * 25.7e-3**2
TEST = PARTS.index('test')
FRICTION = tuple(f'friction/O-ring257_{bar}bar' for bar in (1, 3, 5, 7))


def experiments_of(recordings):
    return experiments_on(recordings, Force(AREA, 1.0, AMBIENT))


def difference_of(experiment):
    return experiment.at_samples('pressure') - experiment.at_samples('opposing')


def close(experiments, area, factor=1.0, library=FORCE_EFFECTS):
    """Return what came of closing the loop on the force: fits before and after, their errors, and the conclusion."""
    channel = Force(area, factor, AMBIENT)
    channel.library = library
    plain = fit_model(channel, experiments)
    found, conclusion = close_loop(plain)
    return SimpleNamespace(
        **vars(conclusion),
        estimates=found.estimates,
        plain=plain,
        fit=found,
        area=float(found.model.parameters[0]),
        factor=float(found.model.parameters[1]),
        values=found.model.effects,
        before=part_errors(experiments, plain.simulated),
        after=part_errors(experiments, found.simulated),
        experiments=experiments,
    )


def drawn_with(effects, schedule, seed):
    """Return a draw; a surface is followed for a third of a minute."""
    planned = surface_following(duration=20.0, seed=seed) if schedule == 'surface_following' else schedule
    return draw(effects, planned, seed)


def closed(effects, schedule, seed, area=AREA, **options):
    drawn = drawn_with(effects, schedule, seed)
    return drawn, close(experiments_of([both_cylinders(drawn)]), area, **options)


def measured(runs):
    mapping = read_mapping(MAPPING)
    return experiments_of([read_recording(ROOT / f'{run}.csv', mapping=mapping) for run in runs])


def rms(values):
    return math.sqrt(np.mean(values**2))


def made_of(experiment, effects, noise=0.0, area=AREA):
    """Return an experiment whose force a known model makes, with noise [N]."""
    model = Model(np.array([area, 1.0]), effects, np.zeros((1, 1)))
    (force,) = Force(area, 1.0, AMBIENT).simulated([experiment], model)
    rng = np.random.default_rng(8)
    return replace(experiment, measured=force + noise * rng.standard_normal(force.size))


def estimates_of(closure):
    return {one.name: one for one in closure.estimates}


@pytest.mark.parametrize(
    ('effect', 'schedule'),
    [
        ('seal_friction', 'surface_following'),
        ('seal_friction', 'out_and_back'),
        ('stribeck_friction', 'surface_following'),
        ('stribeck_friction', 'out_and_back'),
        ('force_offset', 'surface_following'),
        ('force_offset', 'out_and_back'),
        ('moving_mass', 'surface_following'),
    ],
)
def test_the_effect_that_is_there_is_named(effect, schedule):
    drawn, closure = closed(effect, schedule, 21)
    assert closure.effects[0] == effect or effect in closure.alternatives[closure.effects[0]]
    assert closure.after['test'].rmse < 1.1 * force_oracle_rmse(drawn)
    assert closure.ratio == pytest.approx(closure.after['test'].rmse / closure.before['test'].rmse)
    assert closure.ratio_interval[0] <= closure.ratio <= closure.ratio_interval[1]
    assert closure.noise.std == pytest.approx(force_oracle_rmse(drawn), rel=0.05)
    assert {trial.effect for trial in closure.tried if trial.accepted} >= set(closure.effects)


def test_parameters_are_found_again():
    (experiment,) = experiments_of([both_cylinders(drawn_with(None, 'surface_following', 22))])
    truth = {'seal_friction': (2.0, 1e-5, 10.0, 1e-4), 'force_offset': (-1.5,)}
    closure = close([made_of(experiment, truth, noise=0.1)], 1.0e-3)
    assert closure.verdict == 'effect_added'
    assert set(closure.effects) == set(truth)
    found = estimates_of(closure)
    assert found['area'].value == pytest.approx(AREA, rel=2e-3)
    for effect, values in truth.items():
        for parameter, value in zip(FORCE_EFFECTS[effect].parameters, values):
            estimate = found[f'{effect}.{parameter.name}']
            assert abs(estimate.value - value) < 4.0 * estimate.std


@pytest.mark.parametrize('schedule', ['paper_step', 'out_and_back', 'surface_following'])
def test_clean_data_name_nothing(schedule):
    for seed in (31, 32, 33):
        _, closure = closed(None, schedule, seed)
        assert closure.verdict == 'no_missing_effect', closure.why
        assert closure.effects == ()
        assert closure.ratio is None
        assert closure.ratio_interval is None
        assert closure.after == closure.before


def test_a_force_without_noise_is_no_riddle():
    """As a simulator publishes it."""
    (experiment,) = experiments_of([both_cylinders(draw(None, 'out_and_back', 41))])
    closure = close([made_of(experiment, {})], AREA)
    assert closure.verdict == 'no_missing_effect'
    assert all(math.isfinite(test.statistic) for test in closure.tests_after)
    closure = close([made_of(experiment, {'force_offset': (3.0,)})], AREA)
    assert closure.effects == ('force_offset',)
    assert closure.verdict == 'effect_added'
    assert closure.values['force_offset'][0] == pytest.approx(3.0, rel=1e-4)
    closure = close([made_of(experiment, {'seal_friction': (2.0, 0.0, 5.0, 1e-4)})], AREA)
    assert closure.effects == ('seal_friction',)
    assert closure.verdict == 'effect_added'


def test_one_set_point_does_not_tell_area_or_factor():
    _, closure = closed('seal_friction', 'paper_step', 2, factor=1.0, area=1.14e-3)
    found = estimates_of(closure)
    assert closure.effects[0] == 'seal_friction'
    assert closure.area == 1.14e-3
    assert not found['area'].identifiable
    assert 'the same set-point' in found['area'].reason
    assert '1140.0 mm^2' in found['area'].reason
    assert not found['geometric_factor'].identifiable
    assert 'product' in found['geometric_factor'].reason


def test_only_the_product_of_area_and_factor_shows():
    _, plain = closed('force_offset', 'out_and_back', 23)
    _, geared = closed('force_offset', 'out_and_back', 23, area=0.5 * AREA, factor=2.0)
    assert geared.factor == 2.0
    assert 2.0 * geared.area == pytest.approx(plain.area, rel=1e-5)
    assert geared.effects == plain.effects


def test_where_nobody_knows_the_area_an_offset_is_not_claimed():
    drawn, closure = closed('force_offset', 'paper_step', 0, area=None)
    assert 'force_offset' not in closure.effects
    assert 'force_offset' in closure.not_visible
    assert 'two set-points' in closure.next_experiment
    strength = drawn.truth.changes['pickup.force_offset']
    difference = difference_of(closure.experiments[0])
    assert closure.area == pytest.approx(AREA + strength / np.mean(difference), rel=0.01)


def test_a_constant_may_be_a_weight():
    _, closure = closed('force_offset', 'out_and_back', 23)
    assert closure.effects == ('force_offset',)
    assert closure.alternatives['force_offset'] == ('moving_mass',)  # strokes too quick to see that nothing is inert
    assert 'force_offset (not distinguishable from moving_mass)' in closure.why
    _, closure = closed('force_offset', 'surface_following', 0)
    assert closure.alternatives['force_offset'] == ()  # 0.2 kg would have shown


def test_friction_that_is_not_known_is_drawn():
    library = {name: effect for name, effect in FORCE_EFFECTS.items() if 'friction' not in name}
    _, closure = closed('seal_friction', 'surface_following', 24, library=library)
    assert closure.verdict == 'shape_found'
    assert closure.unknown.enters == 'friction'
    assert 'Unknown cause' in closure.why


def test_a_force_sensor_that_trails_is_unexplained():
    (experiment,) = experiments_of([both_cylinders(draw(None, surface_following(duration=8.0, seed=25), 25))])
    trailing = replace(experiment, measured=np.roll(experiment.measured, 4))
    closure = close([trailing], AREA)
    assert closure.verdict == 'unexplained'


def test_too_few_samples_are_said():
    (experiment,) = experiments_of([both_cylinders(draw('seal_friction', 'paper_step', 3))])
    few = replace(
        experiment, samples=experiment.samples[::5], measured=experiment.measured[::5], part=experiment.part[::5]
    )
    closure = close([few], AREA)
    assert closure.verdict == 'insufficient_data'
    assert closure.tried == ()
    assert 'too few' in closure.why
    assert 'two set-points' in closure.next_experiment


def test_the_verdict_is_put_into_words():
    for shortage, effects, ratio, interval, verdict, words in (
        ('7 samples', (), None, None, 'insufficient_data', '7 samples'),
        (None, (), None, None, 'no_missing_effect', 'Nothing is missing that the recording could show'),
        (
            None,
            ('force_offset',),
            0.25,
            (0.2, 0.3),
            'effect_added',
            'error to 25 %. The remaining error is sensor noise',
        ),
        (
            None,
            ('force_offset',),
            0.95,
            (0.8, 1.1),
            'effect_added',
            'to 95 %. This may be chance: the 95 % interval is 80 to 110 %',
        ),
    ):
        found = verdict_of('linear', effects, {}, (), shortage, ratio, interval)
        assert found[0] == verdict
        assert found[0] in VERDICTS
        assert words in found[1]


def test_what_withdraws_a_verdict_stands_beside_what_was_found():
    against = ['the error of the test part is 6 times that of the train part']
    for effects, ratio, interval, words in (
        ((), None, None, 'The model explains the recording down to sensor noise. The error of the test part is 6'),
        (
            ('force_offset',),
            0.25,
            (0.2, 0.3),
            'Missing effect: force_offset. Adding it reduces the error to 25 %. The error of',
        ),
    ):
        verdict, why = verdict_of('linear', effects, {}, (), None, ratio, interval, against)
        assert verdict == 'unexplained'
        assert why.startswith(words)


def test_trials_with_which_the_error_does_not_fall_are_not_accepted():
    tried = [Trial('seal_friction', 100.0, 0.5, 1.0, True, ''), Trial('moving_mass', -9.0, 0.0, 2.0, False, 'no use')]
    clause, trials = withdraw_effects(['seal_friction'], 1.67, (1.5, 1.8), tried)
    assert clause == 'not added: seal_friction. The error would change to 167 %'
    assert [trial.accepted for trial in trials] == [False, False]
    assert trials[0].why == 'does not reduce the error on the test part'
    assert trials[1] == tried[1]


def test_the_noise_is_seen_beside_what_is_missing():
    drawn = draw('moving_mass', 'out_and_back', 1)
    experiments = experiments_of([both_cylinders(drawn)])
    thrust = [AREA * difference_of(one) for one in experiments]
    channel = Force(AREA, 1.0, AMBIENT)
    model = Model(np.array([AREA, 1.0]), {}, np.zeros((1, 1)))
    assert channel.noise(experiments, thrust, model).std == pytest.approx(force_oracle_rmse(drawn), rel=0.15)


def test_identify_closes_the_loop_on_the_force_too():
    drawn = draw('force_offset', 'paper_step', 4)
    found = identify([both_cylinders(drawn)], Options(close_loop=True, area=AREA))
    assert found.unidentified == {}
    force = found.channels['force']
    assert force.conclusion.effects == ('force_offset',)
    assert found.geometry == Geometry(AREA, 1.0, estimates_of(force.found)['area'].reason)
    assert identify([both_cylinders(drawn)]).channels['force'].conclusion is None


def test_the_area_is_known_without_closing_the_loop():
    """At one set-point it makes the force; a linkage's factor is in it, unless it is given."""
    recording = both_cylinders(draw(None, 'paper_step', 6))
    geared = replace(recording, force=Signal(recording.force.times, 1.5 * recording.force.values))
    geometry = identify([geared]).geometry
    assert geometry.area == pytest.approx(1.5 * AREA, rel=0.01)
    assert geometry.factor == 1.0
    assert 'the same set-point' in geometry.note
    for factor in (1.5, -1.5):
        force = Signal(recording.force.times, factor * recording.force.values)
        known = identify([replace(recording, force=force)], Options(geometric_factor=factor)).geometry
        assert known.factor == factor
        assert known.area == pytest.approx(AREA, rel=0.01)
    given = Options(area=2e-3, geometric_factor=1.5)
    assert identify([geared], given).geometry.area == 2e-3
    assert identify([replace(recording, force=None)], given).geometry == Geometry(2e-3, 1.5, 'as given')
    assert identify([replace(recording, force=None)]).geometry == Geometry()


@pytest.mark.parametrize('factor', [1.5, -1.5])
def test_several_set_points_tell_the_area(factor):
    recording = both_cylinders(draw(None, 'out_and_back', 7))
    force = Signal(recording.force.times, factor * recording.force.values)
    geometry = identify([replace(recording, force=force)], Options(geometric_factor=factor)).geometry
    assert geometry.area == pytest.approx(AREA, rel=5e-3)
    assert geometry.note is None


def test_a_force_that_can_not_be_used_does_not_cost_the_pressures():
    recording = both_cylinders(draw(None, 'paper_step', 5))
    force = recording.force
    for broken, message in (
        (Signal(force.times, 0.0 * force.values), 'never changes'),
        (Signal(force.times, -force.values), 'sign'),
        (Signal(force.times, 1e-4 * force.values), 'units'),
    ):
        for options in (Options(), Options(close_loop=True)):
            found = identify([replace(recording, force=broken)], options)
            assert 'force' not in found.channels
            assert message in found.unidentified['force']
            assert found.geometry == Geometry(note=found.unidentified['force'])
            assert (found.channels['cylinder_a'].conclusion is not None) == options.close_loop
    dead = replace(recording, force=Signal(force.times, 0.0 * force.values))
    assert identify([dead], Options(area=AREA)).geometry == Geometry(AREA, None, 'as given')


@needs_measured_data
@pytest.mark.long
def test_a_real_cylinders_force_pooled(capsys):
    """Four runs with one area and one offset: the error on each one's own test part, and the bore."""
    experiments = measured(FRICTION)
    closure = close(experiments, None)
    errors = [
        [rms((one.measured - force)[one.part == TEST]) for one, force in zip(experiments, simulated)]
        for simulated in (closure.plain.simulated, closure.fit.simulated)
    ]
    area = estimates_of(closure)['area']
    with capsys.disabled():
        print(f'\nforce loop on 1, 3, 5, 7 bar pooled: {closure.verdict}, {closure.why}')
        for label, error in zip(('before', 'after'), errors):
            print(f'  {label}: {" ".join(f"{one:.2f}" for one in error)} N RMS on the test parts')
        print(f'  area {area.value * 1e6:.1f} +- {area.std * 1e6:.1f} mm^2, bore {BORE * 1e6:.1f}; {closure.values}')
    assert closure.effects[0] == 'seal_friction'
    assert set(closure.effects) <= {'seal_friction', 'force_offset'}
    assert area.value == pytest.approx(BORE, rel=0.02)
    assert min(errors[0]) > 4.0
    assert max(errors[1]) <= 1.1


@needs_measured_data
def test_a_real_cylinders_force_at_one_pressure(capsys):
    run = FRICTION[0]
    closure = close(measured([run]), BORE)
    after = closure.after['test'].rmse
    with capsys.disabled():
        print(
            f'\n{run}: {closure.verdict}, {", ".join(closure.effects)}, test part '
            f'{closure.before["test"].rmse:.2f} to {after:.2f} N',
            end='',
        )
    assert 'seal_friction' in closure.effects
    assert not estimates_of(closure)['area'].identifiable
    assert closure.area == BORE
    assert after < 1.1


def test_the_search_ends_where_samples_tell_no_further_effect():
    """A step leaves an acceleration that changes from sample to sample: beside a mass nothing else is asked for."""
    recording = recording_of(record(paper_step(70e3), device_named('real', ''), seed=0))
    found = identify([recording], Options(close_loop=True)).channels['force']
    assert (found.findings.verdict, found.findings.effects) == ('unexplained', ('moving_mass',))
