# SPDX-License-Identifier: Apache-2.0
"""A device with the uncertainty of its identification: from files and back, and as deviations of its parameters."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from identified import closed, open_loop, with_force

from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Covariance, ModelError, Options, identify
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.path import IdentifiedDevice
from cfd_pneumatic.reporting import write_report

FORCE_NAMES = ('area', 'seal_friction.coulomb')
FORCE_MATRIX = np.array([[1e-12, -4e-8], [-4e-8, 1e-2]])


def identification():
    """Return a closed loop with an effect in cylinder A, and made-up numbers of the force."""
    made = with_force(closed())
    force = made.channels['force']
    found = replace(force.found, covariance=Covariance(FORCE_NAMES, FORCE_MATRIX))
    return replace(made, channels={**made.channels, 'force': replace(force, found=found)})


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('identified')
    write_report(identification(), folder)
    return folder


@pytest.fixture
def device_of():
    """Return a device with a covariance of some parameters of cylinder A."""

    def device_of(names, matrix, **values):
        device = Device({f'cylinder_a.{name}': value for name, value in values.items()})
        return IdentifiedDevice(device, {'cylinder_a': Covariance(tuple(names), np.asarray(matrix))})

    return device_of


# files


def test_a_folder_gives_what_was_identified(folder):
    loaded, expected = IdentifiedDevice.load(folder), IdentifiedDevice.of_identification(identification())
    assert loaded.device == expected.device
    assert loaded.model_errors == expected.model_errors
    assert set(loaded.model_errors) == {'cylinder_a', 'cylinder_b', 'force'}
    assert loaded.source == str(folder / 'parameters.yaml')
    for channel, covariance in expected.covariances.items():
        assert loaded.covariances[channel].names == covariance.names
        np.testing.assert_array_equal(loaded.covariances[channel].matrix, covariance.matrix)
    assert loaded.covariances['cylinder_a'].names == (*NAMES, 'droop.slope', 'droop.lag', 'setpoint_offset')
    assert loaded.covariances['force'].names == FORCE_NAMES


def test_a_parameter_file_gives_the_same_as_its_folder(folder):
    loaded = IdentifiedDevice.load(folder / 'parameters.yaml')
    assert set(loaded.covariances) == {'cylinder_a', 'cylinder_b', 'force'}


def test_a_file_alone_or_of_another_origin_has_no_uncertainty(folder, tmp_path):
    (tmp_path / 'alone').mkdir()
    for name, text in (('alone', (folder / 'parameters.yaml').read_text()), ('.', None)):
        path = tmp_path / name / 'parameters.yaml'
        if text is None:
            (tmp_path / 'report.json').write_bytes((folder / 'report.json').read_bytes())
            Device.load(folder / 'parameters.yaml').save(path)
        else:
            path.write_text(text)
        loaded = IdentifiedDevice.load(path)
        assert (loaded.covariances, loaded.model_errors) == ({}, {})
        assert loaded.deviations() == []


def test_a_device_has_the_uncertainty_of_its_file_until_it_is_changed(folder):
    device = Device.load(folder / 'parameters.yaml')
    assert IdentifiedDevice.of_device(device).covariances.keys() == IdentifiedDevice.load(folder).covariances.keys()
    changed = device.with_values({'supply_pressure': 5e5})
    assert IdentifiedDevice.of_device(changed) == IdentifiedDevice(changed, {}, {}, 'parameters given in Python')


def test_an_open_loop_has_the_uncertainty_of_the_cylinders(tmp_path):
    write_report(open_loop(), tmp_path)
    loaded = IdentifiedDevice.load(tmp_path)
    assert loaded.covariances['cylinder_a'].names == (*NAMES, 'setpoint_offset')
    # droop, which the model lacks, is more than the noise
    assert loaded.model_errors['cylinder_a'].motion > 3.0 * loaded.model_errors['cylinder_b'].motion


# refusals


def changed_copy(folder, tmp_path, change):
    """Return a copy of a folder whose report is changed."""
    report = json.loads((folder / 'report.json').read_text())
    change(report)
    (tmp_path / 'report.json').write_text(json.dumps(report))
    (tmp_path / 'parameters.yaml').write_bytes((folder / 'parameters.yaml').read_bytes())
    return tmp_path


def covariance_with(**entries):
    def change(report):
        report['cylinders']['cylinder_b']['covariance'] |= entries

    return change


def error_of(value):
    def change(report):
        report['force']['model_error_n'] = value

    return change


def block_of(value):
    def change(report):
        report['cylinders']['cylinder_a'] = value

    return change


PAIR = ['k_x', 'tau']
WRONG = {
    'names missing': (covariance_with(parameters=None), 'without a list of parameters'),
    'names no texts': (covariance_with(parameters=[1, 2]), 'without a list of parameters'),
    'name unknown': (covariance_with(parameters=['k_y'], matrix=[[1.0]]), 'that no device has'),
    'name of a switch': (covariance_with(parameters=['droop.enabled'], matrix=[[1.0]]), 'that no device has'),
    'name of a list': (covariance_with(parameters=['setpoints'], matrix=[[1.0]]), 'that no device has'),
    'name twice': (covariance_with(parameters=['k_x', 'k_x'], matrix=[[1.0, 0.0], [0.0, 1.0]]), 'or twice'),
    'matrix missing': (covariance_with(matrix=None), 'no matrix of'),
    'rows missing': (covariance_with(parameters=PAIR, matrix=[[1.0, 0.0]]), 'no matrix of 2 by 2'),
    'rows unequal': (covariance_with(parameters=PAIR, matrix=[[1.0, 0.0], [1.0]]), 'no matrix of 2 by 2'),
    'text': (covariance_with(parameters=PAIR, matrix=[[1.0, '0.0'], [0.0, 1.0]]), 'no matrix of 2 by 2'),
    'switch': (covariance_with(parameters=PAIR, matrix=[[True, 0.0], [0.0, 1.0]]), 'no matrix of 2 by 2'),
    'not finite': (covariance_with(parameters=PAIR, matrix=[[1.0, float('nan')], [0.0, 1.0]]), 'no matrix of 2 by 2'),
    'huge': (covariance_with(parameters=PAIR, matrix=[[10**400, 0.0], [0.0, 1.0]]), 'no matrix of 2 by 2'),
    'not symmetric': (covariance_with(parameters=PAIR, matrix=[[1.0, 0.5], [0.4, 1.0]]), 'not symmetric'),
    'overflow': (covariance_with(parameters=PAIR, matrix=[[1e-300, 1e300], [1e300, 1e-300]]), 'not symmetric'),
    'negative': (covariance_with(parameters=PAIR, matrix=[[-1.0, 0.0], [0.0, 1.0]]), 'negative variance'),
    'not positive': (covariance_with(parameters=PAIR, matrix=[[1.0, 1.1], [1.1, 1.0]]), 'not positive'),
    'covariance of a constant': (covariance_with(parameters=PAIR, matrix=[[0.0, 1.1], [1.1, 1.0]]), 'not positive'),
    'no block': (block_of([]), 'no results for cylinder_a'),
    'no covariance': (lambda report: report['force'].update(covariance=[]), 'without a list of parameters'),
    'error a number': (error_of(3.0), 'model error of force'),
    'error negative': (error_of({'rest': -1.0, 'motion': 1.0}), 'model error of force'),
    'error a text': (error_of({'rest': None, 'motion': '1'}), 'model error of force'),
    'error incomplete': (error_of({'rest': 1.0}), 'model error of force'),
    'error not finite': (error_of({'rest': None, 'motion': float('inf')}), 'model error of force'),
}


@pytest.mark.parametrize('name', WRONG)
def test_an_invalid_report_is_refused_in_one_line(folder, tmp_path, name):
    change, reason = WRONG[name]
    with pytest.raises(InputError, match=reason) as caught:
        IdentifiedDevice.load(changed_copy(folder, tmp_path, change))
    message = str(caught.value)
    assert '\n' not in message
    assert message.startswith(str(tmp_path / 'report.json'))
    assert message.endswith(': identify again')


def test_what_an_older_version_did_not_write_is_unknown(folder, tmp_path):
    def without(report):
        for block in (*report['cylinders'].values(), report['force']):
            for key in ('covariance', 'model_error_pa', 'model_error_n'):
                block.pop(key, None)

    loaded = IdentifiedDevice.load(changed_copy(folder, tmp_path, without))
    assert (loaded.covariances, loaded.model_errors) == ({}, {})


def test_a_model_error_may_be_unknown(folder, tmp_path):
    loaded = IdentifiedDevice.load(changed_copy(folder, tmp_path, error_of({'rest': None, 'motion': 2})))
    assert loaded.model_errors['force'] == ModelError(None, 2.0)


def test_a_report_of_another_run_is_refused(folder, tmp_path):
    with pytest.raises(InputError, match='different runs'):
        IdentifiedDevice.load(changed_copy(folder, tmp_path, lambda report: report.update(run='another')))


def test_a_report_that_is_no_json_is_refused(folder, tmp_path):
    changed_copy(folder, tmp_path, dict)
    (tmp_path / 'report.json').write_text('{"schema": 1, ')
    with pytest.raises(InputError, match=r'report\.json is not a report'):
        IdentifiedDevice.load(tmp_path)


@pytest.mark.parametrize(('path', 'reason'), [('.', 'has no parameters.yaml'), ('none.yaml', 'cannot be read')])
def test_a_folder_or_file_that_is_not_there_is_refused(tmp_path, path, reason):
    with pytest.raises(InputError, match=reason):
        IdentifiedDevice.load(tmp_path / path)


# deviations


def changes_of(device, **options):
    """Return the changes of the parameters for each deviation, shape (axes, parameters), of single numbers."""
    changes = []
    for channel, values in device.deviations(**options):
        prefix = {'force': 'contact_force'}.get(channel, channel)
        names = [name if name == 'area' else f'{prefix}.{name}' for name in device.covariances[channel].names]
        assert list(values) == names
        changes.append([np.mean(values[name]) - np.mean(device.device.value(name)) for name in names])
    return np.array(changes)


@pytest.mark.parametrize('share', [1.0, 0.1])
@pytest.mark.parametrize('channel', ['cylinder_b', 'force'])
def test_deviations_add_up_to_the_covariance(channel, share):
    whole = IdentifiedDevice.of_identification(identification())
    device = replace(whole, covariances={channel: whole.covariances[channel]})
    matrix = whole.covariances[channel].matrix
    changes = changes_of(device, share=share) / share
    assert len(changes) == len(matrix)
    stds = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose(changes.T @ changes / np.outer(stds, stds), matrix / np.outer(stds, stds), atol=1e-5)


def test_a_predicted_pressure_has_the_variance_of_predictions_from_drawn_parameters():
    """Drawn from the covariance, and simulated: what the sum over the deviations has to give."""
    whole = IdentifiedDevice.of_identification(open_loop())
    covariance = whole.covariances['cylinder_b']
    device = replace(whole, covariances={'cylinder_b': covariance})
    (experiment,) = open_loop().cylinders['cylinder_b'].experiments
    driven = experiment.times, experiment.inputs['displacement'], experiment.inputs['setpoint']

    def predicted(values):
        return device.device.with_values(values).model.cylinders['cylinder_b'].simulate(*driven)

    nominal = predicted({})
    variance = sum((predicted(values) - nominal) ** 2 for _, values in device.deviations())
    names = [f'cylinder_b.{name}' for name in covariance.names]
    mean = [np.mean(device.device.value(name)) for name in names]
    rng = np.random.default_rng(0)
    drawn = [
        {name: (value,) if name.endswith(NAMES) else value for name, value in zip(names, row.tolist())}
        for row in rng.multivariate_normal(mean, covariance.matrix, 400)
    ]
    sampled = np.var([predicted(values) for values in drawn], axis=0)
    assert np.sqrt(np.mean(variance)) == pytest.approx(np.sqrt(np.mean(sampled)), rel=0.1)
    assert np.max(np.sqrt(variance)) > 2.0 * np.median(np.sqrt(variance))  # the motion matters


def test_changed_parameters_make_a_device():
    whole = IdentifiedDevice.of_identification(identification())
    for channel, values in whole.deviations():
        changed = whole.device.with_values(values)
        assert changed != whole.device
        assert all(name.startswith((channel, 'contact_force', 'area')) for name in values)


def test_gains_at_several_set_points_change_by_the_same_share():
    whole = IdentifiedDevice.of_identification(identify(closed().recordings, Options(per_setpoint=True)))
    gains = whole.device.value('cylinder_a.k_x')
    assert len(gains) > 1
    cylinders = [deviation for deviation in whole.deviations() if deviation[0] != 'force']
    assert len(cylinders) == 10
    for channel, values in cylinders:
        ratios = np.array(values[f'{channel}.k_x']) / np.array(whole.device.value(f'{channel}.k_x'))
        np.testing.assert_allclose(ratios, ratios[0], rtol=1e-12)
        assert ratios[0] != 1.0


def test_parameters_stay_within_their_bounds(device_of):
    """A slope of droop cannot be negative: the deviation points upwards, whatever the sign of the axis."""
    device = device_of(['droop.slope'], [[1.0]], **{'droop.slope': 0.2, 'droop.lag': 1.0})
    assert device.deviations() == [('cylinder_a', {'cylinder_a.droop.slope': pytest.approx(1.2)})]
    largest = device_of(['droop.slope'], [[1.0]], **{'droop.slope': 10.0, 'droop.lag': 1.0})
    assert largest.deviations() == [('cylinder_a', {'cylinder_a.droop.slope': pytest.approx(9.0)})]
    wide = device_of(['droop.slope'], [[100.0**2]], **{'droop.slope': 0.2, 'droop.lag': 1.0})
    assert wide.deviations() == [('cylinder_a', {'cylinder_a.droop.slope': 10.0})]


def test_a_constant_and_no_parameter_have_no_deviation(device_of):
    assert device_of([], np.empty((0, 0))).deviations() == []
    assert changes_of(device_of(['k_x', 'tau'], np.diag([0.0, 1e-6]))).tolist() == [[0.0, pytest.approx(1e-3)]]
