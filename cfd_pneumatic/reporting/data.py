# SPDX-License-Identifier: Apache-2.0
"""`report.json`: strict JSON with numbers in SI units, and null for a missing value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

from cfd_pneumatic.identification import (
    PARTS,
    VARIABLES,
    Change,
    ChannelResult,
    Characteristic,
    DeviceState,
    Estimate,
    Identification,
    Outside,
    PartError,
    Test,
    error_beyond_noise,
    residual_dependences,
)
from cfd_pneumatic.reporting.advice import next_plan

SCHEMA = 1


def report_data(identification: Identification, live: Mapping[str, PartError] = MappingProxyType({})) -> dict[str, Any]:
    """Return the report as JSON types; `live` has the errors of `sim_node` by channel, if known."""
    closed_results = {result.name: result for result in identification.closed}
    data: dict[str, Any] = {
        'schema': SCHEMA,
        'recordings': [
            {
                'name': recording.name,
                'displacement_samples': recording.displacement.times.size,
                'duration_s': float(recording.displacement.times[-1] - recording.displacement.times[0]),
                'travel_m': [float(recording.displacement.values.min()), float(recording.displacement.values.max())],
                'notes': list(recording.health),
            }
            for recording in identification.recordings
        ],
        'split': {
            'no_test_part': identification.no_test,
            'recordings': [
                {
                    'part': split.whole,
                    'validation_from_s': _finite(split.bounds[0]),
                    'test_from_s': _finite(split.bounds[1]),
                    'strokes': dict(zip(PARTS, split.strokes)),
                }
                for split in identification.splits
            ],
        },
        'ambient_pressure_pa': identification.ambient_pressure,
        'interrupted': identification.is_interrupted,
        'cylinders': {
            name: _cylinder_data(result, identification)
            | (_findings_data(closed_results[name]) if name in closed_results else {})
            for name, result in identification.cylinders.items()
        },
    }
    for name, result in closed_results.items():
        if name not in identification.cylinders:
            before = {f'span_{result.quantity.key}': result.span, 'before': _error_data(result.before, result)}
            data[name] = before | _uncertainty_data(result) | _findings_data(result)
    for name, error in live.items():
        block = data['cylinders'][name] if name in identification.cylinders else data.get(name)
        if block is not None:
            block['live'] = _error_data({identification.channels[name].judged_on: error}, identification.channels[name])
    data['next_plan'] = next_plan(identification)
    data['changes'] = [_change_data(change) for change in identification.changes]
    data['drifts'] = [
        {
            'channel': drift.channel,
            'recording': drift.recording,
            'total_pa': drift.total,
            'rate_pa_per_s': drift.rate,
            'text': drift.text,
        }
        for drift in identification.drifts
    ]
    data['warnings'] = [asdict(notice) for notice in identification.notices]
    return data


def _change_data(change: Change) -> dict[str, Any]:
    """Return a change of the device: when, what differs, and the channel before and after the change."""
    return {
        'channel': change.channel,
        'recording': change.recording,
        'time_s': change.time,
        'ci95_s': list(change.interval),
        'text': change.text,
        'differences': [difference._asdict() for difference in change.differences],
        'before': _state_data(change.before),
        'after': _state_data(change.after),
    }


def _state_data(state: DeviceState) -> dict[str, Any]:
    """Return a channel before or after a change."""
    return {
        'parameters': _gain_data(state.gains),
        'offset_pa': state.offset,
        'offset_std_pa': state.offset_std,
        'effects': list(state.effects),
        'verdict': state.verdict or None,
        'why': state.why or None,
        'rmse_pa': state.error,
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _cylinder_data(result: ChannelResult, identification: Identification) -> dict[str, Any]:
    name = result.channel.name
    cylinders = [identification.recordings[comparison.recording].cylinders[name] for comparison in result.comparisons]
    recorded_setpoints = [cylinder.setpoint is not None for cylinder in cylinders]
    return {
        'parameters': _gain_data(result.fit.estimates),
        'schedule': [
            {'setpoint_pa': point.setpoint, 'parameters': _gain_data(point.fit.estimates)} for point in result.schedule
        ],
        'setpoints': [
            {
                'recording': experiment.recording,
                'recorded': recorded,
                ('offset_pa' if recorded else 'estimated_pa'): (
                    offset if recorded else float(experiment.inputs['setpoint'][0]) + offset
                ),
                'std_pa': std,
                **({} if recorded else {'drift_pa_per_s': drift}),
                'displacement_noise_m': experiment.motion.noise,
            }
            for experiment, recorded, (offset, _, drift), (std, *_) in zip(
                result.experiments,
                recorded_setpoints,
                result.fit.model.recording_values.tolist(),
                result.fit.stds.tolist(),
            )
        ],
        'span_pa': result.span,
        'noise_floor_pa': result.noise.std,
        'before': _error_data(result.before, result),
        'notes': list(result.notes),
        **_uncertainty_data(result),
    }


def _uncertainty_data(result: ChannelResult) -> dict[str, Any]:
    """Return the uncertainty of the model of `parameters.yaml`: covariance of its parameters, and its error."""
    covariance = result.found.covariance
    return {
        'covariance': {'parameters': list(covariance.names), 'matrix': covariance.matrix.tolist()},
        f'model_error_{result.quantity.key}': asdict(error_beyond_noise(result)),
    }


def _error_data(errors: Mapping[str, PartError], result: ChannelResult) -> dict[str, Any]:
    key = result.quantity.key
    return {part: {f'rmse_{key}': error.rmse, 'nrmse_percent': error.nrmse_percent} for part, error in errors.items()}


def _gain_data(estimates: Sequence[Estimate]) -> dict[str, Any]:
    return _estimate_data({estimate.name: estimate for estimate in estimates})


def _estimate_data(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {
        name: {
            'value': estimate.value,
            'std': estimate.std,
            'ci95': None if estimate.interval is None else list(estimate.interval),
            'unit': estimate.unit,
            'identifiable': estimate.identifiable,
            'reason': estimate.reason,
        }
        for name, estimate in estimates.items()
    }


def _findings_data(result: ChannelResult) -> dict[str, Any]:
    """Return the verdict on a channel, its effects, candidates and residual tests as JSON types."""
    findings = result.findings
    key = result.quantity.key
    return {
        'verdict': findings.verdict,
        'why': findings.why,
        'core': findings.core,
        'core_parameters': {name: _estimate_data(result.parameters(name)) for name in result.found.model.core},
        'effects': list(findings.effects),
        'status': findings.status,
        'explained_to_within_noise': findings.explained_to_within,
        'effect_parameters': {effect: _estimate_data(result.parameters(effect)) for effect in findings.effects},
        'parameters_after': _gain_data(result.gains),
        'alternatives': {effect: list(findings.alternatives.get(effect, ())) for effect in findings.effects},
        'unknown': None if findings.unknown is None else _characteristic_data(findings.unknown),
        'after': _error_data(result.after, result),
        'after_over_before': _ratio_data(result),
        'left': _remaining_error_data(result),
        'tried': [
            {
                'effect': trial.effect,
                'delta_bic': _finite(trial.delta_bic),
                'rss_drop': _finite(trial.rss_drop),
                f'validation_rmse_{key}': _finite(trial.validation_rmse),
                'accepted': bool(trial.accepted),
                'why': trial.why,
            }
            for trial in findings.tried
        ],
        'residual_tests': {'before': _test_data(findings.tests_before), 'after': _test_data(findings.tests_after)},
        'not_visible': list(findings.not_visible),
        'not_tried': list(findings.not_tried),
        'not_tested': list(findings.not_tested),
        'outside_of_range': [_outside_data(outside, result) for outside in findings.outside],
        'next_experiment': findings.next_experiment,
    }


def _characteristic_data(characteristic: Characteristic) -> dict[str, Any]:
    """Return an estimated curve; each pair under `or` names an alternative place and variable of the curve."""
    return {
        'enters': characteristic.enters,
        'or': [list(alternative) for alternative in characteristic.alternatives],
        'against': characteristic.against,
        'unit': characteristic.unit,
        'unit_against': characteristic.unit_against,
        'curve': {
            name: getattr(characteristic, name)[characteristic.visited].tolist()
            for name in ('at', 'value', 'low', 'high')
        },
        'formula': characteristic.formulas[0].text if len(characteristic.formulas) == 1 else None,
        'formulas': [formula.text for formula in characteristic.formulas],
        'explains': characteristic.explains,
        'words': characteristic.description,
    }


def _remaining_error_data(result: ChannelResult) -> dict[str, Any]:
    """Return the remaining error and the signals on which the residual depends."""
    error = result.rmse(1)
    return {
        f'rmse_{result.quantity.key}': error,
        'over_noise': error / result.noise.std,
        'percent_of_span': 100.0 * error / result.span,
        'depends_on': [
            {'on': dependence.on, 'share': dependence.share, 'look_at': dependence.suggestion}
            for dependence in residual_dependences(result)
        ],
    }


def _ratio_data(result: ChannelResult) -> dict[str, Any] | None:
    ratio, interval = result.findings.ratio, result.findings.ratio_interval
    if ratio is None:
        return None
    return {'ratio': ratio, 'ci95': None if interval is None else list(interval)}


def _outside_data(outside: Outside, result: ChannelResult) -> dict[str, Any]:
    key = result.quantity.key
    return {
        'variable': outside.variable,
        'unit': VARIABLES[outside.variable].unit,
        'range': [outside.low, outside.high],
        'reached': outside.reached,
        'share': outside.share,
        f'inside_rmse_{key}': _finite(outside.inside_rmse),
        f'outside_rmse_{key}': _finite(outside.outside_rmse),
    }


def _test_data(tests: Sequence[Test]) -> list[dict[str, Any]]:
    return [
        {
            'name': test.name,
            'statistic': _finite(test.statistic),
            'threshold': _finite(test.threshold),
            'passed': bool(test.passed),
            'decisive': bool(test.decisive),
            'what': test.what,
        }
        for test in tests
    ]
