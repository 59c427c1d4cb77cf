# SPDX-License-Identifier: Apache-2.0
"""What is predicted: the notions of the identification, asked before anything is recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.search.visible_effects import effects_not_visible
from cfd_pneumatic.model import NAMES, TABLE_1
from cfd_pneumatic.model.effects import EFFECTS, FORCE_EFFECTS, PRESSURE_EFFECTS
from cfd_pneumatic.planning import Limits, Sensing, plan
from cfd_pneumatic.planning.composition import ROUNDS
from cfd_pneumatic.planning.evidence import Evidence
from cfd_pneumatic.planning.experiment_plan import settling
from cfd_pneumatic.planning.family import family
from cfd_pneumatic.planning.planned_device import device_at_home, home_gains, home_setpoints, usual_pressures
from cfd_pneumatic.planning.proposal import Drawing
from cfd_pneumatic.planning.signatures import all_signatures, split_of
from cfd_pneumatic.planning.signatures import planned as planned_channels

AMBIENT = 101_325.0
LEVEL = 5e4
LIMITS = Limits((LEVEL, 9e4), duration=10.0)
SENSING = Sensing()


def device(effects=None, **gains):
    row = dict(zip(NAMES, TABLE_1.interpolate(LEVEL).table[0, 1:])) | gains
    values = {f'cylinder_a.{name}': [float(value)] for name, value in row.items()}
    values |= {'cylinder_a.setpoints': [LEVEL], 'cylinder_a.initial_setpoint': LEVEL, 'cylinder_b.enabled': False}
    for name, own in (effects or {}).items():
        values[f'cylinder_a.{name}.enabled'] = True
        parameters = PRESSURE_EFFECTS[name].parameters
        values |= {f'cylinder_a.{name}.{one.name}': value for one, value in zip(parameters, own)}
    return Device(values)


def proposal_of(*names, limits=LIMITS, of=None):
    one = of or device()
    return Drawing(limits, SENSING, home_setpoints(one), settling(one)).draw(
        [next(segment for segment in family() if segment.name == name) for name in names]
    )


def evidence_of(*names, limits=LIMITS):
    proposal = proposal_of(*names, limits=limits)
    signatures = all_signatures(proposal, device(), SENSING)[0]
    return Evidence(signatures, signatures.products(), proposal.times.size)


@pytest.fixture(scope='module')
def planned():
    return plan(device(), LIMITS, SENSING)


def test_a_plan_keeps_to_its_duration_and_does_everything_in_each_round(planned):
    assert planned.proposal.times[-1] <= LIMITS.duration
    assert planned.rounds == ROUNDS
    assert [name for name, _ in planned.proposal.segments] == [one.name for one in planned.segments] * ROUNDS
    split = split_of(planned.proposal, SENSING)
    parts = split.part_of(planned.proposal.times)
    assert [np.mean(parts == index) for index in range(3)] == pytest.approx([0.6, 0.2, 0.2], abs=0.1)


def test_all_that_is_wanted_is_predicted(planned):
    assert [one.name for one in planned.parameters if one.channel == 'cylinder_a'] == list(NAMES)
    assert {one.effect for one in planned.effects} == set(EFFECTS)
    assert all(one.identifiable for one in planned.parameters)


def test_the_same_again_is_the_same_plan(planned):
    assert plan(device(), LIMITS, SENSING).proposal.table() == planned.proposal.table()


def test_more_noise_makes_the_error_larger_in_proportion_and_shows_less():
    proposal = proposal_of('sweep', 'set-point step of 100%, A and B')
    found = {}
    for noise in (50.0, 100.0):
        sensing = replace(SENSING, pressure_noise=noise, displacement_noise=0.0)
        signatures = all_signatures(proposal, device(), sensing)[0]
        found[noise] = Evidence(signatures, signatures.products(), proposal.times.size)
    assert found[100.0].stds == pytest.approx(2.0 * found[50.0].stds)
    # a fixed strength shows half as well
    assert found[100.0].visibility['operating_point'] == pytest.approx(
        0.5 * found[50.0].visibility['operating_point'], rel=0.1
    )


def test_exact_sensitivities_and_finite_differences_agree():
    """Beside an effect that does nothing the sensitivities come from the other kernel."""
    proposal = proposal_of('sweep', 'slow stroke of 100%, A raised')
    exact = all_signatures(proposal, device(), SENSING)[0]
    null = device({'volume_variation': (0.0,)})
    other = planned_channels(proposal, null, SENSING)[0].complement.jacobian
    bounds = [np.sqrt(np.diag(np.linalg.inv(one.T @ one)))[:4] for one in (exact.columns[:, :5], other[:, :5])]
    assert bounds[0] == pytest.approx(bounds[1], rel=0.01)


def test_segments_add_up():
    """What a schedule tells is what its segments tell, or composing them one by one would be wrong."""
    names = ['sweep', 'fast stroke of 100%', 'fast stroke of 30%, A and B raised']
    together = evidence_of(*names).stds[:4]
    normal = sum(evidence_of(name).products[:5, :5] for name in names)
    apart = np.sqrt(np.diag(np.linalg.inv(normal)))[:4]
    assert together == pytest.approx(apart, rel=0.02)


def test_a_second_set_point_tells_more_of_a_leak():
    """At one it is the set-point's offset, but for what charging and discharging make of it."""
    one, two = (evidence_of('fast stroke of 100%', *more) for more in ([], ['set-point step of 100%, A']))
    assert two.visibility['leakage'][0] > 1.5 * one.visibility['leakage'][0] > 0.0


def test_saturation_shows_only_where_much_flows():
    """A limit that does not bind changes nothing: it is asked for where it just does."""
    limits = []
    for names in (['fast stroke of 30%'], ['fast stroke of 30%', 'set-point step of 100%, A']):
        one = evidence_of(*names)
        assert one.visibility['flow_saturation'][1] > 1.0
        form = [form for form in one.signatures.forms if form.effect == 'flow_saturation'][1]
        charge, _ = EFFECTS['flow_saturation'].of_strength(form.typical, form.share)
        limits.append(charge)
    assert limits[1] > 5.0 * limits[0]


def test_a_lag_and_a_delay_are_more_alike_than_a_lag_and_a_dead_band():
    remaining = evidence_of('sweep', 'set-point step of 100%, A').remaining['sensor_lag']
    assert remaining['transport_delay'].max() < 0.3 < remaining['valve_dead_band'].min()


@pytest.mark.parametrize('name', ['setpoint_delay', 'setpoint_lag'])
def test_a_step_of_the_set_point_separates_a_late_set_point_from_a_late_pressure(name):
    """At a set-point step alone all delays are alike; strokes show the delays of the pressure only."""
    stroke, step, both = (
        evidence_of(*names)
        for names in (
            ['fast stroke of 100%'],
            ['set-point step of 100%, A'],
            ['fast stroke of 100%', 'set-point step of 100%, A'],
        )
    )
    assert stroke.visibility[name].max() < 0.01
    for one in (step, both):
        assert one.visibility[name].min() > 1.0
    for rival in ('transport_delay', 'sensor_lag'):
        assert both.remaining[name][rival].min() > 2.0 * step.remaining[name][rival].min()
        assert both.distinctness(name)[rival].min() > 1.0
    other = {'setpoint_delay': 'setpoint_lag', 'setpoint_lag': 'setpoint_delay'}[name]
    assert both.remaining[name][other].max() < 0.5


@pytest.mark.parametrize(
    'names', [('fast stroke of 100%',), ('sweep', 'set-point step of 100%, A'), ('slow stroke of 30%',)]
)
def test_what_shows_is_not_invisible(names):
    """In all of its forms, that is: the identification asks for one."""
    one = evidence_of(*names)
    shows = {effect for effect, own in one.visibility.items() if own.min() > 1.1}
    channel = planned_channels(proposal_of(*names), device(), SENSING)[0]
    noise = Noise(channel.noise, np.empty(0), 0.02, True, False)
    complement = channel.complement
    hidden = effects_not_visible(complement.likelihood, complement.model, noise)
    assert shows
    assert all(EFFECTS[name].of_time for name in shows & set(hidden))


def test_what_is_wanted_decides_what_is_done():
    """Leaks need two set-points; gains and lags alone do not."""
    leaky = plan(device(), LIMITS, SENSING, ['leakage'])
    assert any(one.turns for one in leaky.segments)
    assert {one.effect for one in leaky.effects} == {'leakage'}
    assert leaky.parameters == () or all(one.name == 'area' for one in leaky.parameters)
    assert np.ptp(leaky.proposal.displacement) > 0.0, 'or identify_bag would have nothing to split'


def test_with_one_pressure_no_set_point_changes():
    steady = plan(device(), Limits((LEVEL, LEVEL), duration=8.0), SENSING, [*NAMES, 'leakage'])
    assert np.ptp(steady.proposal.setpoints) == 0.0
    assert all(one.identifiable for one in steady.parameters if one.name in NAMES)


def test_a_missing_cylinder_is_left_alone(planned):
    assert np.ptp(planned.proposal.setpoints[:, 0]) > 0.0
    assert np.ptp(planned.proposal.setpoints[:, 1]) == 0.0
    assert {one.channel for one in planned.effects} == {'cylinder_a', 'force'}


def test_effects_that_are_on_are_parameters_and_not_missing():
    leaky = plan(device({'leakage': (0.5, 0.0)}), LIMITS, SENSING, [*NAMES, 'leakage', 'droop'])
    named = {one.name: one for one in leaky.parameters}
    assert named['leakage.conductance'].value == 0.5
    assert named['leakage.conductance'].identifiable
    assert 'leakage' not in {one.effect for one in leaky.effects}


def test_a_smallest_strength_just_shows():
    """Linear from where it was asked: what is said to just show leaves what has to show."""
    proposal = proposal_of('sweep', 'set-point step of 100%, A and B')
    signatures = all_signatures(proposal, device(), SENSING)[0]
    one = Evidence(signatures, signatures.products(), proposal.times.size)
    form = next(form for form in signatures.forms if form.effect == 'leakage')
    share = 1.0 / float(one.visibility['leakage'][0])
    weaker = EFFECTS['leakage'].of_strength(form.typical, share)
    own = signatures.columns[:, :5] / np.linalg.norm(signatures.columns[:, :5], axis=0)
    change = planned_channels(proposal, device(), SENSING)[0].complement.changes('leakage', [weaker])[:, 0]
    left = change - own @ np.linalg.lstsq(own, change, rcond=None)[0]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.57 * signatures.noise, rel=0.05)


@pytest.mark.parametrize('name', EFFECTS)
def test_a_strength_is_scaled_to_nothing_and_kept(name):
    effect = EFFECTS[name]
    between = tuple(one.lower + 0.3 * (min(one.upper, one.lower + 10.0) - one.lower) for one in effect.parameters)
    assert effect.of_strength(between, 1.0) == pytest.approx(between)
    faint = effect.of_strength(between, 1e-12)
    for index in effect.strengths:
        assert faint[index] == pytest.approx(effect.parameters[index].null, abs=1e-6)
    assert [faint[index] for index in range(len(faint)) if index not in effect.strengths] == [
        between[index] for index in range(len(faint)) if index not in effect.strengths
    ]


def test_too_little_time_is_said():
    with pytest.raises(InputError, match='is too short for a stroke: give'):
        plan(device(), replace(LIMITS, duration=0.4), SENSING)


def test_a_short_time_is_one_round():
    assert plan(device(), replace(LIMITS, duration=1.5), SENSING, NAMES).rounds == 1


def test_a_long_time_is_many_rounds():
    planned = plan(device(), replace(LIMITS, duration=150.0), replace(SENSING, sample_rate=40.0), NAMES)
    assert planned.rounds == 7  # of at most 24 s
    assert 120.0 < planned.proposal.times[-1] <= 150.0


def test_what_there_is_not_cannot_be_wanted():
    with pytest.raises(InputError, match='leek is neither a parameter nor an effect: wanted may be k_x'):
        plan(device(), LIMITS, SENSING, ['leek'])


def test_force_effects_are_predicted_beside_the_area(planned):
    force = {one.effect: one for one in planned.effects if one.channel == 'force'}
    assert set(force) == set(FORCE_EFFECTS)
    assert force['force_offset'].shows
    assert [one.unit for one in planned.parameters if one.name == 'area'] == ['m^2']


def test_a_device_is_read_as_the_simulator_reads_it():
    read = Device.load(Path(__file__).parents[2] / 'config' / 'table_1.yaml')
    assert set(read.model.cylinders) == {'cylinder_a', 'cylinder_b'}
    assert home_gains(device_at_home(read, (0.0, 1e6)), 'cylinder_a') == pytest.approx(TABLE_1.table[0, 1:], rel=1e-5)
    assert usual_pressures(read) == pytest.approx((34473.79, 137895.15))
    assert read.assumed == ()
    without_area = {name: value for name, value in read.given.items() if name != 'area'}
    assert replace(read, given=without_area).assumed == ('area',)
