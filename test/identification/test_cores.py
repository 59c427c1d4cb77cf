# SPDX-License-Identifier: Apache-2.0
"""Which core recordings need: devices of full physics are healthy, and those of the paper's law keep their effects."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drawn import recording_of

from cfd_pneumatic.device import Device
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.channels.channel import NOT_ESTIMATED
from cfd_pneumatic.recording import recording_of as sampled_recording
from cfd_pneumatic.rig import device_named, record, surface_following
from studies.panel import draw, oracle_rmse


@cache
def closed(effect, make, schedule='out_and_back', seed=11):
    planned = surface_following(70e3, 1.4e-3, duration=20.0, seed=seed) if schedule == 'surface_following' else schedule
    drawn = draw(effect, planned, seed, make=make)
    return drawn, identify([recording_of(drawn)], Options(close_loop=True))


def rms(result):
    return float(np.sqrt(np.mean(np.concatenate([one.residual(1) for one in result.comparisons]) ** 2)))


@pytest.mark.parametrize(
    ('make', 'schedule'),
    [('orifices', 'surface_following'), *((make, 'out_and_back') for make in ('walls', 'silencer', 'stirred_walls'))],
)
def test_full_physics_is_no_missing_effect(make, schedule):
    drawn, found = closed(None, make, schedule)
    result = found.cylinders['cylinder_a']
    assert (result.findings.verdict, result.findings.core, result.findings.effects) == (
        'no_missing_effect',
        'physical',
        (),
    )
    assert result.findings.unknown is None
    assert rms(result) <= 1.02 * oracle_rmse(drawn)
    assert result.findings.ratio < 0.6
    assert 'physical core' in result.findings.why.replace('_', ' ')


def test_physics_that_passes_for_noise_with_a_memory_is_physics():
    """A surface without rests: no test of the inputs names what the linear core leaves, 1.5 to 4 times the noise."""
    # set-points 4 % apart tell how gains grow with the pressure
    played = record(surface_following(duration=20.0, seed=3), device_named('real'), seed=3)
    one = sampled_recording(played)
    recording = replace(one, cylinders={'cylinder_a': one.cylinders['cylinder_a']}, force=None)
    result = identify([recording], Options(close_loop=True)).cylinders['cylinder_a']
    assert (result.findings.verdict, result.findings.core) == ('no_missing_effect', 'physical')
    assert result.rmse(1) < 1.05 * result.noise.std


def test_its_numbers_are_the_devices():
    drawn, found = closed(None, 'walls', 'out_and_back')
    told = found.cylinders['cylinder_a'].parameters('physical_core')
    rig = drawn.truth.device.rig
    chamber = rig.cylinder_a
    low, high = told['control_volume'].interval
    assert low < chamber.control_volume / chamber.rest_volume < 1.5 * high
    assert told['exponent'].value == pytest.approx(1.4, abs=0.03)  # air that exchanges heat is adiabatic at first
    length = 1.4 * told['pressure'].value / found.cylinders['cylinder_a'].found.model.parameters[0]
    assert length == pytest.approx(chamber.rest_volume / chamber.area + told['position'].value, rel=0.03)


def test_what_recordings_do_not_tell_of_it_stands_as_data_sheets_have_it():
    """Two orifices and a polytropic chamber have no walls and no silencer: the gains don't make up for any."""
    _, found = closed(None, 'orifices')
    model = found.cylinders['cylinder_a'].found.model
    told = found.cylinders['cylinder_a'].parameters('physical_core')
    absent = {name for name, one in told.items() if one.reason == NOT_ESTIMATED}
    assert absent >= {'wall_loss', 'silencer', 'stirring'}
    parameters = {one.name: one for one in found.cylinders['cylinder_a'].channel.effects['physical_core'].parameters}
    for name, value in zip(parameters, model.core['physical_core']):
        if name in absent and parameters[name].null == parameters[name].lower:
            assert value == 0.0
    _, walls = closed(None, 'walls')
    told = walls.cylinders['cylinder_a'].parameters('physical_core')
    assert told['wall_loss'].value > 3.0 * told['wall_loss'].std


@pytest.mark.parametrize(
    ('effect', 'make', 'seed'),
    [
        ('transport_delay', 'silencer', 11),  # with the linear core, that and a saturated valve leave noise
        # by 87 ms, which is longer than a stroke takes
        pytest.param('displacement_delay', 'stirred_walls', 104, marks=pytest.mark.long),
        # beside which the core is stuck at first
        pytest.param('valve_hysteresis', 'stirred_walls', 104, marks=pytest.mark.long),
    ],
)
def test_what_is_wrong_with_a_device_of_full_physics_is_named(effect, make, seed):
    drawn, found = closed(effect, make, seed=seed)
    findings = found.cylinders['cylinder_a'].findings
    assert findings.core == 'physical'
    assert findings.effects == (effect,)
    assert findings.verdict == 'effect_added'
    assert rms(found.cylinders['cylinder_a']) <= 1.05 * oracle_rmse(drawn)


@pytest.mark.long
def test_where_much_is_left_the_search_is_begun_from_the_core_alone():
    """Three effects beside the linear core lead astray, and are named without it."""
    _, found = closed('valve_hysteresis', 'walls', seed=114)
    result = found.cylinders['cylinder_a']
    assert result.findings.core == 'physical'
    assert result.findings.effects == ('valve_hysteresis',)
    assert rms(result) < 0.1 * result.rms(0)


@pytest.mark.parametrize('effect', ['volume_variation', 'operating_point'])
def test_a_device_of_the_papers_law_keeps_its_effects(effect):
    _, found = closed(effect, None, seed=2)
    findings = found.cylinders['cylinder_a'].findings
    assert findings.core == 'linear'
    assert findings.effects == (effect,)


def test_a_healthy_device_of_the_papers_law_needs_no_other_core():
    findings = closed(None, None)[1].cylinders['cylinder_a'].findings
    assert (findings.verdict, findings.core, findings.unknown) == ('no_missing_effect', 'linear', None)


def test_a_core_can_be_asked_for():
    drawn = draw(None, surface_following(70e3, 1.4e-3, duration=5.0, seed=11), 11, make='orifices')
    for core, chosen in ('auto', 'physical'), ('linear', 'linear'):
        found = identify([recording_of(drawn)], Options(close_loop=True, core=core)).cylinders['cylinder_a']
        assert found.findings.core == chosen
    drawn, _ = closed(None, 'walls')
    fitted = identify([recording_of(drawn)], Options(core='physical')).cylinders['cylinder_a']
    assert fitted.conclusion is None
    assert fitted.after['test'].rmse < 0.25 * fitted.before['test'].rmse
    with pytest.raises(InputError, match='core'):
        Options(core='quadratic')


def test_the_supply_is_above_what_was_recorded():
    drawn, found = closed(None, 'orifices', 'surface_following')
    supply = found.cylinders['cylinder_a'].parameters('physical_core')['supply']
    assert supply.value is None or supply.value > np.max(drawn.recording.pressures[:, 0])


def test_at_one_set_point_data_sheets_stand_in():
    drawn = draw(None, 'paper_step', 11, make='orifices')
    result = identify([recording_of(drawn)], Options(core='physical')).cylinders['cylinder_a']
    told = result.parameters('physical_core')
    for name in ('supply', 'critical_ratio', 'supply_growth', 'relief_growth'):
        assert 'data-sheet' in told[name].reason


def test_what_was_identified_is_what_its_file_simulates(tmp_path):
    drawn, found = closed(None, 'walls', 'out_and_back')
    identified_device(found).save(tmp_path / 'parameters.yaml')
    device = Device.load(tmp_path / 'parameters.yaml')
    assert list(device.model.cylinders['cylinder_a'].effects) == ['physical_core']
    simulated = device.simulate(recording_of(drawn)).cylinders['cylinder_a'].pressure
    result = found.cylinders['cylinder_a']
    np.testing.assert_allclose(simulated.values, result.comparisons[0].after, atol=1e-4 * result.span)
