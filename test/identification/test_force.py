# SPDX-License-Identifier: Apache-2.0
"""
The force's fit: known truth found again, what the recordings don't tell said so, and a real cylinder.

Recordings come from the rig, which shares no code with the model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from drawn import experiments_of as experiments_on
from measured import MAPPING, ROOT, needs_measured_data
from reference import AMBIENT

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.data.motion import Motion, smooth_motion
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.data.turning_points import seal_displacement
from cfd_pneumatic.identification.fit.fit import find_optimum, fit_model, summary
from cfd_pneumatic.identification.fit.likelihood import Likelihood
from cfd_pneumatic.identification.preparation import prepare_recordings
from cfd_pneumatic.recording import Signal, read_mapping, read_recording, recording_of
from studies.panel import draw, force_oracle_rmse

AREA = 1.14e-3
TEST = PARTS.index('test')


def experiments_of(recordings):
    return experiments_on(recordings, Force(AREA, 1.0, AMBIENT))


def difference_of(experiment):
    return experiment.at_samples('pressure') - experiment.at_samples('opposing')


def drawn_experiment(effects, schedule, seed):
    drawn = draw(effects, schedule, seed)
    return drawn, experiments_of([recording_of(drawn.recording)])[0]


def fit_with(names, experiments, area=AREA):
    """Return the best fit with some effects from all their starting points, test parts kept apart."""
    channel = Force(area, 1.0, AMBIENT)
    plain = fit_model(channel, experiments)
    data = channel.data(experiments, plain.model, plain.simulated)
    starts = product(*(channel.effects[name].starts(data) for name in names))
    begins = [replace(plain.model, effects=dict(zip(names, start))) for start in starts]
    best, _ = min((find_optimum(plain.likelihood, begin, 1e-8, 60) for begin in begins), key=lambda found: found[1])
    return summary(plain.likelihood, best)


def residuals_of(fit):
    return [one.measured - force for one, force in zip(fit.likelihood.experiments, fit.simulated)]


def area_of(fit):
    return float(fit.model.parameters[0])


def rms(values):
    return math.sqrt(np.mean(values**2))


def estimates_of(fit):
    return {one.name: one for one in fit.estimates}


def test_seal_friction_is_found_again():
    drawn, experiment = drawn_experiment('seal_friction', 'surface_following', 101)
    fit = fit_with(['seal_friction'], [experiment], area=None)
    found, seal = estimates_of(fit), drawn.truth.device.rig.seal
    assert area_of(fit) == pytest.approx(AREA, rel=2e-3)
    residual = residuals_of(fit)[0][experiment.part == TEST]
    assert rms(residual) < 1.25 * force_oracle_rmse(drawn)
    coulomb, per_pressure, _, presliding = fit.model.effects['seal_friction']
    gauge = 1e5
    assert coulomb + per_pressure * gauge == pytest.approx(
        seal.coulomb + seal.coulomb_per_pressure * gauge, rel=0.02, abs=0.01
    )
    assert presliding == pytest.approx(seal.presliding, rel=0.1)
    for name, truth in (('coulomb', seal.coulomb), ('per_pressure', seal.coulomb_per_pressure)):
        estimate = found[f'seal_friction.{name}']
        assert abs(estimate.value - truth) < 4.0 * estimate.std
    assert found['seal_friction.viscous'].value == pytest.approx(seal.viscous, rel=0.1, abs=1.0)


def test_effects_are_told_from_each_other():
    names = ('force_offset', 'seal_friction', 'moving_mass')
    drawn, experiment = drawn_experiment(names, 'surface_following', 111)
    fit = fit_with(names, [experiment])
    rig = drawn.truth.device.rig
    mass, offset = estimates_of(fit)['moving_mass.mass'], estimates_of(fit)['force_offset.offset']
    weight = rig.piston.mass * 9.80665 * math.sin(rig.piston.inclination)
    assert mass.value == pytest.approx(rig.piston.mass, rel=0.05, abs=0.005)
    assert offset.value == pytest.approx(rig.pickup.force_offset - weight, abs=4.0 * offset.std)
    assert offset.std < 0.05
    residual = residuals_of(fit)[0][experiment.part == TEST]
    assert rms(residual) < 1.25 * force_oracle_rmse(drawn)


def test_friction_is_known_through_rests_between_sudden_strokes():
    """The converter's last bit toggles, and a curve would overshoot where the piston stops."""
    drawn, experiment = drawn_experiment('seal_friction', 'out_and_back', 4)
    residual = residuals_of(fit_with(['seal_friction'], [experiment]))[0]
    assert rms(residual) < 1.25 * force_oracle_rmse(drawn)


def test_a_toggling_last_bit_moves_no_seal():
    rng = np.random.default_rng(5)
    times = np.arange(600) * 2e-3
    bit = 3.1e-6
    measured = np.where(times > 0.6, 1.5e-3, 0.0) + bit * np.repeat(rng.integers(0, 2, times.size // 10), 10)
    path = seal_displacement(smooth_motion(times, measured), measured, times)
    for rest in (slice(50, 290), slice(350, None)):
        assert np.sum(np.abs(np.diff(path[rest]))) < 3.0 * bit
    assert np.sum(np.abs(np.diff(measured[50:290]))) > 8.0 * bit


def test_a_mass_in_unresolved_strokes_is_not_told():
    _, experiment = drawn_experiment('moving_mass', 'paper_step', 1)
    mass = estimates_of(fit_with(['moving_mass'], [experiment]))['moving_mass.mass']
    assert not mass.identifiable
    assert 'Sample faster' in mass.reason


def test_one_stroke_does_not_tell_friction_from_offset():
    _, experiment = drawn_experiment('seal_friction', 'paper_step', 0)
    found = estimates_of(fit_with(['force_offset', 'seal_friction'], [experiment]))
    assert 'other unknowns' in found['seal_friction.coulomb'].reason
    assert 'other unknowns' in found['force_offset.offset'].reason


def test_one_set_point_does_not_tell_the_area():
    _, experiment = drawn_experiment('seal_friction', 'paper_step', 2)
    fit = fit_with(['seal_friction'], [experiment], area=1.2e-3)
    assert area_of(fit) == 1.2e-3
    assert not estimates_of(fit)['area'].identifiable
    assert fit.model.effects['seal_friction'][1] == 0.0
    assert not estimates_of(fit)['seal_friction.per_pressure'].identifiable


def test_a_force_counted_backwards_is_refused():
    _, experiment = drawn_experiment(None, 'surface_following', 3)
    with pytest.raises(InputError, match='sign'):
        fit_with([], [replace(experiment, measured=-experiment.measured)])


def test_what_can_not_make_an_experiment_is_said():
    recording = recording_of(draw(None, 'paper_step', 4).recording)
    channel, force = Force(AREA, 1.0, AMBIENT), recording.force
    assert prepare_recordings([replace(recording, force=None)]).experiments(channel) == ()
    for broken, message in (
        (Signal(force.times + 99.0, force.values), 'time offsets'),
        (Signal(force.times, 0.0 * force.values), 'never changes'),
    ):
        with pytest.raises(InputError, match=message):
            prepare_recordings([replace(recording, force=broken)]).experiments(channel)


def independent_force(times, displacement, rate, difference, gauge, truth):
    """Return the force [N] by a plain loop."""
    area, offset, coulomb, per_pressure, viscous, presliding = truth
    stretch, force = -1.0, []
    for index, x in enumerate(displacement):
        travel = x - displacement[max(index - 1, 0)]
        if travel:
            end = 1.0 if travel > 0.0 else -1.0
            stretch = end - (end - stretch) * 2.718281828459045 ** (-abs(travel) / presliding)
        friction = (coulomb + per_pressure * gauge[index]) * stretch + viscous * rate[index]
        force.append(area * difference[index] + offset - friction)
    return np.array(force)


def test_standard_errors_are_what_the_scatter_is():
    """In 60 repetitions with new noise, for each parameter."""
    times = np.arange(0.0, 8.0, 5e-3)
    x = 3e-3 * np.sin(2.0 * np.pi * 0.9 * times) + 1e-3 * np.sin(2.0 * np.pi * 2.3 * times)
    rate, acceleration = np.gradient(x, times), np.zeros(times.size)
    levels = np.where(times < 4.0, 60e3, 110e3)
    truth = (AREA, 0.8, 1.5, 8e-6, 12.0, 2e-4)
    exact = independent_force(times, x, rate, levels, levels, truth)
    channel, scores = Force(None, 1.0, AMBIENT), []
    for seed in range(60):
        noisy = exact + 0.2 * np.random.default_rng(seed).standard_normal(times.size)
        experiment = Experiment(
            recording='made',
            times=times,
            inputs={
                'displacement': x,
                'rate': rate,
                'acceleration': acceleration,
                'pressure': levels + AMBIENT,
                'opposing': np.full(times.size, AMBIENT),
                'level': levels,
            },
            samples=np.arange(times.size),
            measured=noisy,
            part=np.zeros(times.size, dtype=np.int8),
            motion=Motion(times, x, rate, acceleration, 8e-3, 0.0, 0.0, 0.0, 3, 0.0, times),
            starts_at_rest=False,
        )
        effects = {'force_offset': (0.0,), 'seal_friction': (1.0, 1e-6, 1.0, 1e-4)}
        likelihood = Likelihood.alike(channel, [experiment])
        (start,) = channel.starts([experiment])
        found = summary(likelihood, find_optimum(likelihood, replace(start, effects=effects), 1e-8, 60)[0])
        told = [one for one in found.estimates if one.name != 'geometric_factor']
        scores.append([(one.value - value) / one.std for one, value in zip(told, truth)])
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert spread.shape == (6,)
    assert np.all((spread > 0.7) & (spread < 1.4)), spread


BORE = 0.25 * math.pi * 25.7e-3**2
FRICTION = tuple(f'friction/O-ring257_{bar}bar' for bar in (1, 3, 5, 7))


@needs_measured_data
def test_a_real_cylinders_force():
    """Four runs pooled, with one offset: the error on each one's own test part, and the bore."""
    mapping = read_mapping(MAPPING)
    experiments = experiments_of([read_recording(ROOT / f'{run}.csv', mapping=mapping) for run in FRICTION])
    chosen = fit_with(['force_offset', 'seal_friction'], experiments, area=BORE)
    errors = [rms(residual[one.part == TEST]) for residual, one in zip(residuals_of(chosen), experiments)]
    plain = [rms((one.measured - BORE * difference_of(one))[one.part == TEST]) for one in experiments]
    assert min(plain) > 4.0
    assert max(errors) <= 1.1
    assert area_of(chosen) == pytest.approx(BORE, rel=0.02)
    assert chosen.model.effects['seal_friction'][1] == pytest.approx(0.62e-5, rel=0.15)
    assert all(one.identifiable for one in chosen.estimates if one.name != 'geometric_factor')
