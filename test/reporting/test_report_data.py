# SPDX-License-Identifier: Apache-2.0
"""`report.json`: what closing the loop adds to it."""

from __future__ import annotations

import json
import math

import pytest
from identified import AREA, closed, judged, open_loop, with_force

from cfd_pneumatic.model import NAMES
from cfd_pneumatic.reporting import report_data

ADDED = {
    *('verdict', 'why', 'effects', 'status', 'effect_parameters', 'parameters_after', 'alternatives', 'after'),
    *('core', 'core_parameters'),
    *(
        'after_over_before',
        'explained_to_within_noise',
        'tried',
        'residual_tests',
        'not_visible',
        'not_tried',
        'tried',
        'residual_tests',
        'not_visible',
        'not_tested',
        'outside_of_range',
        'next_experiment',
        'left',
        'unknown',
    ),
}


@pytest.fixture(scope='module')
def data():
    return json.loads(json.dumps(report_data(closed()), allow_nan=False))


def test_a_cylinder_says_what_closure_found(data):
    closure = closed().channels['cylinder_a'].conclusion
    block = data['cylinders']['cylinder_a']
    assert set(block) >= ADDED
    assert (block['verdict'], block['why']) == (closure.verdict, closure.why)
    assert block['effects'] == list(closure.effects) == ['droop']
    assert set(block['alternatives']) == {'droop'}
    assert set(block['after']) == set(block['before']) == {'train', 'validation', 'test'}
    assert set(block['after']['test']) == {'rmse_pa', 'nrmse_percent'}
    assert block['after_over_before']['ratio'] == closure.ratio
    low, high = block['after_over_before']['ci95']
    assert low < closure.ratio < high


def test_parameters_of_model_and_effects_have_intervals(data):
    block = data['cylinders']['cylinder_a']
    assert set(block['parameters_after']) == set(NAMES)
    assert set(block['effect_parameters']) == {'droop'}
    for entry in (*block['parameters_after'].values(), *block['effect_parameters']['droop'].values()):
        assert entry['ci95'][0] < entry['value'] < entry['ci95'][1]
        assert entry['std'] > 0.0
        assert entry['unit']


def test_all_that_was_tried_and_tested_is_there(data):
    closure = closed().channels['cylinder_a'].conclusion
    block = data['cylinders']['cylinder_a']
    assert [trial['effect'] for trial in block['tried']] == [trial.effect for trial in closure.tried]
    assert set(block['tried'][0]) == {'effect', 'delta_bic', 'rss_drop', 'validation_rmse_pa', 'accepted', 'why'}
    assert any(trial['accepted'] for trial in block['tried'])
    for when in ('before', 'after'):
        for test in block['residual_tests'][when]:
            assert set(test) == {'name', 'statistic', 'threshold', 'passed', 'decisive', 'what'}
            assert test['passed'] == (test['statistic'] <= test['threshold'])


def test_where_nothing_is_missing_there_is_no_ratio(data):
    block = data['cylinders']['cylinder_b']
    assert block['verdict'] == 'no_missing_effect'
    assert block['effects'] == []
    assert block['after_over_before'] is None
    assert block['after'] == block['before']


def test_the_force_is_a_block_of_the_same_form_in_newtons():
    data = report_data(with_force(closed()))
    block = json.loads(json.dumps(data['force'], allow_nan=False))
    assert set(block) == ADDED | {'before', 'span_n', 'covariance', 'model_error_n'}
    assert set(block['before']['test']) == {'rmse_n', 'nrmse_percent'}
    assert set(block['tried'][0]) >= {'validation_rmse_n'}
    assert block['parameters_after']['area']['value'] == AREA
    assert block['effect_parameters']['seal_friction']['coulomb']['value'] == 2.5


@pytest.mark.parametrize('cylinder', ['cylinder_a', 'cylinder_b'])
def test_the_covariance_is_that_of_the_parameters_in_the_parameter_file(data, cylinder):
    block = data['cylinders'][cylinder]
    estimates = {**block['parameters_after']}
    for effect, parameters in block['effect_parameters'].items():
        estimates |= {f'{effect}.{name}': estimate for name, estimate in parameters.items()}
    names, matrix = block['covariance']['parameters'], block['covariance']['matrix']
    assert names == [*estimates, 'setpoint_offset']
    for rank, name in enumerate([*estimates]):
        assert math.sqrt(matrix[rank][rank]) == pytest.approx(estimates[name]['std'])


def test_the_model_error_falls_with_the_missing_effect(data):
    before = report_data(open_loop())['cylinders']['cylinder_a']
    after = data['cylinders']['cylinder_a']
    assert before['model_error_pa']['motion'] > 0.5 * before['noise_floor_pa']
    assert after['model_error_pa']['motion'] < 0.25 * before['model_error_pa']['motion']


def test_an_open_loop_says_nothing_of_effects():
    data = report_data(open_loop())
    assert 'force' not in data
    assert not set(data['cylinders']['cylinder_a']) & ADDED


def test_a_verdict_is_taken_over_as_it_is():
    data = report_data(judged(closed(), 'insufficient_data', 'too short'))
    assert data['cylinders']['cylinder_a']['verdict'] == 'insufficient_data'
