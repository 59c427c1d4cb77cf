# SPDX-License-Identifier: Apache-2.0
"""What programs of others rely on: the keys of report.json and their types, and parameters.yaml as 0.1.0 wrote it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from identified import closed, open_loop, with_force

from cfd_pneumatic.device import Device
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.reporting import report_data

PARAMETERS = Path(__file__).parents[1] / 'parameters_0_1_0.yaml'

EACH = '*'
NUMBER = (int, float)
OR_NONE = type(None)

ESTIMATE = {
    'value': (*NUMBER, OR_NONE),
    'std': (*NUMBER, OR_NONE),
    'ci95': (list, OR_NONE),
    'unit': str,
    'identifiable': bool,
    'reason': (str, OR_NONE),
}
TEST = {'name': str, 'statistic': NUMBER, 'threshold': NUMBER, 'passed': bool, 'decisive': bool, 'what': str}


def errors(key):
    return {EACH: {f'rmse_{key}': NUMBER, 'nrmse_percent': NUMBER}}


def closure(key):
    """Return what closing the loop adds to a cylinder, and all that there is of the force."""
    trial = {
        'effect': str,
        'delta_bic': (*NUMBER, OR_NONE),
        'rss_drop': NUMBER,
        f'validation_rmse_{key}': (*NUMBER, OR_NONE),
        'accepted': bool,
        'why': str,
    }
    return {
        'verdict': str,
        'why': str,
        'effects': [str],
        'effect_parameters': {EACH: {EACH: ESTIMATE}},
        'parameters_after': {EACH: ESTIMATE},
        'alternatives': {EACH: [str]},
        'before': errors(key),
        'after': errors(key),
        f'span_{key}': NUMBER,
        'tried': [trial],
        'residual_tests': {'before': [TEST], 'after': [TEST]},
        'not_visible': [str],
        'next_experiment': str,
    }


CYLINDER = {
    'parameters': {EACH: ESTIMATE},
    'schedule': [{'setpoint_pa': NUMBER, 'parameters': {EACH: ESTIMATE}}],
    'setpoints': [{'recording': str, 'recorded': bool, 'std_pa': NUMBER, 'displacement_noise_m': NUMBER}],
    'span_pa': NUMBER,
    'noise_floor_pa': NUMBER,
    'before': errors('pa'),
    'notes': [str],
}
UNCERTAINTY = {
    'covariance': {'parameters': [str], 'matrix': [[NUMBER]]},
    'model_error_pa': dict.fromkeys(('rest', 'motion', 'per_step'), (*NUMBER, OR_NONE)),
}
"""What 0.3.0 added to a cylinder."""
RECORDING = {'name': str, 'displacement_samples': int, 'duration_s': NUMBER, 'travel_m': [NUMBER], 'notes': [str]}
SPLIT = {'part': (str, OR_NONE), 'validation_from_s': NUMBER, 'test_from_s': NUMBER, 'strokes': {EACH: int}}
REPORT = {
    'schema': int,
    'recordings': [RECORDING],
    'split': {'no_test_part': (str, OR_NONE), 'recordings': [SPLIT]},
    'ambient_pressure_pa': NUMBER,
    'cylinders': {EACH: CYLINDER},
    'next_plan': (str, OR_NONE),
}
RATIO = {'ratio': NUMBER, 'ci95': [NUMBER]}
CLOSED = {**REPORT, 'cylinders': {EACH: {**CYLINDER, **closure('pa')}}}


def assert_holds(told, wanted, where='report'):
    """Assert that a report has what is wanted; it may have more."""
    if isinstance(wanted, dict) and EACH in wanted:
        assert isinstance(told, dict), where
        for key, value in told.items():
            assert_holds(value, wanted[EACH], f'{where}.{key}')
    elif isinstance(wanted, dict):
        for key, inner in wanted.items():
            assert key in told, f'{where} lacks {key}'
            assert_holds(told[key], inner, f'{where}.{key}')
    elif isinstance(wanted, list):
        assert isinstance(told, list), where
        for value in told:
            assert_holds(value, wanted[0], f'{where}[]')
    else:
        assert isinstance(told, wanted), f'{where} is {told!r}'


def report_of(identification):
    return json.loads(json.dumps(report_data(identification), allow_nan=False))


def test_a_report_has_the_keys_of_0_1_0():
    report = report_of(open_loop())
    assert_holds(report, REPORT)
    assert report['schema'] == 1
    assert set(report['cylinders']['cylinder_a']['parameters']) == {'k_x', 'k_sv', 'k_v', 'tau'}
    assert set(report['cylinders']['cylinder_a']['before']) == {'train', 'validation', 'test'}


def test_the_report_of_a_closed_loop_has_the_keys_of_0_1_0():
    report = report_of(with_force(closed()))
    assert_holds(report, CLOSED)
    assert_holds(report['force'], closure('n'))
    assert_holds(report['force']['after_over_before'], RATIO)
    assert report['cylinders']['cylinder_b']['after_over_before'] is None


@pytest.mark.parametrize('identification', [open_loop, closed])
def test_a_report_has_the_uncertainty_of_0_3_0(identification):
    for block in report_of(identification())['cylinders'].values():
        assert_holds(block, UNCERTAINTY)
        size = len(block['covariance']['parameters'])
        assert [len(row) for row in block['covariance']['matrix']] == [size] * size


def test_a_set_point_is_an_offset_or_an_estimate():
    (known,) = report_of(open_loop())['cylinders']['cylinder_a']['setpoints']
    assert isinstance(known['offset_pa'], float)


@pytest.mark.parametrize('options', [Options(), Options(per_setpoint=True)])
def test_options_change_no_key(options):
    assert_holds(report_of(identify(closed().recordings, options)), REPORT)


def test_a_parameter_file_of_0_1_0_is_read():
    device = Device.load(PARAMETERS).model
    assert device.geometry.area == 0.0012
    assert device.cylinders['cylinder_a'].effects == {'droop': (0.0013775011810227419, 0.12040480395560328)}
    gains = device.cylinders['cylinder_b'].parameters.table[0, 1:]
    assert gains == pytest.approx([4598430.18, 144.7747, 17.73708, 0.01130016], rel=1e-6)
    assert device.force_effects == {'seal_friction': (2.5, 0.0, 40.0, 5e-5)}
