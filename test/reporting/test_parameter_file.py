# SPDX-License-Identifier: Apache-2.0
"""`parameters.yaml` with effects: it simulates what was reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from identified import AREA, closed, open_loop, with_force

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.identification import Options
from cfd_pneumatic.model import NAMES, Cylinder, OperatingPoints
from cfd_pneumatic.model.effects import FORCE_EFFECTS, PRESSURE_EFFECTS


def parameters_of(identification):
    return yaml.safe_load(identified_device(identification).text)['/**']['ros__parameters']


def effects_in(block, library):
    """Return the effects that a file switches on, as sim_node reads them."""
    return {
        name: tuple(block[name][parameter.name] for parameter in effect.parameters)
        for name, effect in library.items()
        if block.get(name, {}).get('enabled') is True
    }


def test_it_simulates_the_reported_pressure():
    result = closed().cylinders['cylinder_a']
    found = parameters_of(closed())
    block = found['cylinder_a']
    effects = effects_in(block, PRESSURE_EFFECTS)
    assert set(effects) == set(result.conclusion.effects) == {'droop'}
    rows = {name: block[name] for name in ('setpoints', *NAMES)}
    cylinder = Cylinder(OperatingPoints.from_rows(rows), found['ambient_pressure'], effects)
    (one,) = result.experiments
    offset, *_ = result.found.model.recording_values[0]
    pressure = cylinder.simulate(one.times, one.inputs['displacement'], one.inputs['setpoint'] + offset)[one.samples]
    np.testing.assert_allclose(pressure, result.comparisons[0].after, atol=0.01)


def test_gains_beside_effects_are_constant():
    result = closed().cylinders['cylinder_a']
    block = parameters_of(closed())['cylinder_a']
    for name, value in zip(NAMES, result.found.model.parameters):
        assert block[name] == [value]
    assert len(block['setpoints']) == 1


def test_a_cylinder_without_effects_is_as_before():
    assert parameters_of(closed())['cylinder_b'] == parameters_of(open_loop())['cylinder_b']


def test_every_number_is_a_float():
    def check(node):
        for value in node.values() if isinstance(node, dict) else node:
            if isinstance(value, (dict, list)):
                check(value)
            else:
                assert isinstance(value, (float, bool)), value

    check(parameters_of(with_force(closed())))


def test_every_effect_can_be_written():
    """Also those with tiny, whole or extreme parameters, each within the range that sim_node takes."""
    result = closed().cylinders['cylinder_a']
    for name, effect in PRESSURE_EFFECTS.items():
        for own in (
            effect.null,
            *(tuple(getattr(one, side) for one in effect.parameters) for side in ('lower', 'upper')),
        ):
            beyond = tuple(np.nextafter(value, np.inf) for value in own)
            model = replace(result.found.model, effects={name: beyond})
            changed = replace(result, found=replace(result.found, model=model))
            block = parameters_of(replace(closed(), channels={'cylinder_a': changed}))['cylinder_a']
            (found,) = effects_in(block, PRESSURE_EFFECTS).values()
            for parameter, value, written in zip(effect.parameters, beyond, found):
                assert written == pytest.approx(value)
                assert parameter.lower <= written <= parameter.upper


def test_a_gain_that_is_not_identifiable_beside_effects_is_held_and_said():
    result = closed().cylinders['cylinder_a']
    doubtful = replace(result.found.estimates[2], value=None, std=None, interval=None, reason='not seen')
    estimates = (*result.found.estimates[:2], doubtful, *result.found.estimates[3:])
    changed = replace(result, found=replace(result.found, estimates=estimates))
    text = identified_device(replace(closed(), channels={'cylinder_a': changed})).text
    assert 'not identifiable, value assumed in the fit: not seen' in text
    block = yaml.safe_load(text)['/**']['ros__parameters']['cylinder_a']
    assert block['k_v'] == [result.found.model.parameters[2]]


@pytest.mark.parametrize(('present', 'missing'), [CYLINDERS, CYLINDERS[::-1]])
def test_a_cylinder_that_was_not_recorded_is_switched_off(present, missing):
    alone = replace(open_loop(), channels={present: open_loop().channels[present]})
    found = parameters_of(alone)
    assert found[missing] == {'enabled': False}
    assert found[present] == parameters_of(open_loop())[present]
    assert 'enabled' not in found[present]


@pytest.mark.parametrize(
    ('area', 'factor', 'unidentified', 'lines'),
    [
        (None, None, {}, []),
        (None, -1.5, {}, ['geometric_factor: -1.5']),
        (1e-3, None, {}, ['area: 0.001  # m^2; as given']),
        (5e-5, 1.0, {}, ['area: 5.0e-05  # m^2; as given\n', 'geometric_factor: 1.0 ']),
        (None, None, {'force': 'force: it never changes'}, ['# area is not given: force: it never changes']),
    ],
)
def test_the_geometry_stands_as_far_as_it_is_known(area, factor, unidentified, lines):
    options = Options(area=area, geometric_factor=factor)
    one = replace(open_loop(), channels=open_loop().cylinders, options=options, unidentified=unidentified)
    text = identified_device(one).text
    assert all(line in text for line in lines)
    assert parameters_of(one).get('area') == area
    assert parameters_of(one).get('geometric_factor') == factor


def test_a_device_of_one_cylinder_can_be_planned_for(tmp_path):
    file = tmp_path / 'parameters.yaml'
    channels = {'cylinder_b': open_loop().channels['cylinder_b']}
    options = Options(area=5e-4, geometric_factor=1.5)
    identified_device(replace(open_loop(), channels=channels, options=options)).save(file)
    device = Device.load(file).model
    assert set(device.cylinders) == {'cylinder_b'}
    assert (device.geometry.area, device.geometry.geometric_factor) == (5e-4, 1.5)


def test_effects_on_the_force_stand_below_contact_force():
    found = parameters_of(with_force(closed()))
    assert found['area'] == AREA
    effects = effects_in(found['contact_force'], FORCE_EFFECTS)
    assert effects == {'seal_friction': (2.5, 0.0, 40.0, 5e-05)}
    assert 0.0 < found['contact_force']['seal_play'] < 1e-4
