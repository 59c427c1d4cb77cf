# SPDX-License-Identifier: Apache-2.0
"""The summary answers four questions, whatever the verdict is."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from identified import closed, judged, with_force

from cfd_pneumatic.device import force_per_pressure, force_per_speed
from cfd_pneumatic.identification import Geometry, Options, identify
from cfd_pneumatic.identification.characteristic import Characteristic
from cfd_pneumatic.model import CORES, EFFECTS, Cylinder, OperatingPoints
from cfd_pneumatic.notices import warning
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.reporting.summary import noise_ratio, summarise
from cfd_pneumatic.rig import device_named, out_and_back, record


def summary_of(identification, name='cylinder_a'):
    return summarise(identification.channels[name], identification)


def changed(**values):
    """Return an identification with another conclusion on cylinder A."""
    found = closed()
    result = found.channels['cylinder_a']
    conclusion = replace(result.conclusion, **values)
    return replace(found, channels={**found.channels, 'cylinder_a': replace(result, conclusion=conclusion)})


def test_an_effect_is_named_with_what_to_inspect():
    summary = summary_of(closed())
    assert summary.diagnosis == f'Droop in cylinder A: {EFFECTS["droop"].description}.'
    assert summary.certainty.startswith('Confirmed. With droop in the model, its error falls from ')
    assert summary.next_steps == f'Inspect {EFFECTS["droop"].inspect}.'


def test_a_tie_names_both_and_what_decides():
    tie = changed(alternatives={'droop': ('heat_transfer',)})
    summary = summary_of(tie)
    assert summary.diagnosis == 'Droop or heat transfer in cylinder A. This recording cannot distinguish them.'
    assert EFFECTS['heat_transfer'].inspect in summary.next_steps
    advice = dict.fromkeys(EFFECTS[name].advice for name in ('droop', 'heat_transfer'))
    assert summary.next_steps.endswith(f'To decide, record {", and ".join(advice)}.')
    assert summary.certainty.startswith('Confirmed that one of them acts.')


def test_several_effects_of_the_force_are_named_together():
    summary = summary_of(with_force(closed()), 'force')
    assert summary.diagnosis.startswith('Seal friction: ')
    assert ' N (RMS) off without seal friction in the model, ' in summary.force_error
    assert 'the contact force follows the piston speed' in summary.force_error


def test_an_unexplained_error_has_a_size_and_the_strongest_hint():
    found = judged(closed(), 'unexplained', 'who knows')
    result = found.channels['cylinder_a']
    drift = 2e3 * np.linspace(-1.0, 1.0, result.comparisons[0].times.size)
    comparison = replace(result.comparisons[0], after=result.comparisons[0].after - drift)
    errors = {part: replace(error, rmse=1e3) for part, error in result.after.items()}
    drifting = replace(
        result, comparisons=(comparison,), after=errors, conclusion=replace(result.conclusion, effects=(), unknown=None)
    )
    summary = summarise(drifting, found)
    assert (
        summary.diagnosis
        == f'Not explained: the model error of cylinder A is {1e3 / result.noise.std:.2g} times the sensor noise.'
    )
    assert re.search(r'a cause that follows time, which explains \d+\u00a0% of the squared error', summary.next_steps)
    assert 'the temperature, the air supply' in summary.next_steps


def test_nothing_missing_is_worded_as_success():
    found = changed(verdict='no_missing_effect', effects=(), unknown=None)
    summary = summary_of(found)
    assert summary.diagnosis.startswith('No fault found. The model explains the recording of cylinder A ')
    assert summary.next_steps == 'No inspection is needed.'
    ratio = noise_ratio(found.channels['cylinder_a'])
    assert (f'to within {ratio:.2f} times' in summary.diagnosis) == (ratio > 1.0)


def test_a_curve_is_described_with_its_place():
    at = np.linspace(-1e-3, 1e-3, 5)
    curve = Characteristic('gain', 'x', (), at, 0.1 + 0.0 * at, 0.0 * at, 0.2 + 0.0 * at, at > -1.0, 0.5)
    summary = summary_of(changed(verdict='shape_found', effects=(), unknown=curve))
    assert summary.diagnosis == f'An unknown characteristic of cylinder A: {curve.cause}.'
    assert summary.next_steps == 'Inspect the bore, the seal and the chamber walls.'


def test_doubtful_data_come_before_an_inspection():
    found = replace(
        changed(has_warning=True), notices=(warning('unit_suspect', 'the stroke is 12 m', 'set `unit: mm`'),)
    )
    summary = summary_of(found)
    assert summary.diagnosis == 'Check the data first. The stroke is 12 m.'
    assert summary.certainty == 'Uncertain until the data are checked. The answer would be droop.'
    assert summary.next_steps == 'Set `unit: mm`.'


def test_too_short_a_recording_says_what_to_record():
    summary = summary_of(changed(verdict='insufficient_data', effects=(), why='too short', next_experiment='strokes'))
    assert summary == ('Too short.', 'No answer: the recording is too short.', summary.force_error, 'Record strokes.')


@pytest.mark.parametrize('growing', [True, False])
def test_the_force_per_speed_is_that_of_the_simulated_cylinder(growing):
    """A long even motion, simulated with the paper's equations."""
    gains = np.array([1.5e6, 20.0, 5.0, 0.01])
    points = OperatingPoints.from_rows({
        'setpoints': (7e4,), **{name: (value,) for name, value in zip(('k_x', 'k_sv', 'k_v', 'tau'), gains)}
    })  # fmt: skip
    times = np.linspace(0.0, 4.0, 4001)
    speed = 2e-3 if growing else -2e-3
    pressure = Cylinder(points, 1e5).simulate(times, speed * times, np.full(times.size, 1.7e5))
    force = abs(pressure[-1] - 1.7e5) * 1e-3
    expected = force_per_speed(gains, 1e-3)
    assert (expected.growing if growing else expected.shrinking) == pytest.approx(force / 2e-3, rel=1e-6)


def test_an_unknown_area_is_named():
    found = replace(closed(), options=replace(closed().options, area=None))
    assert ('Assumed piston area' in summary_of(found).force_error) == (found.geometry.area is None)
    assert force_per_pressure(Geometry(2e-3, -1.5)) == pytest.approx(3e-3)


def test_every_effect_names_what_to_inspect():
    assert [name for name, effect in {**EFFECTS, **CORES}.items() if not effect.inspect] == []


def test_a_leak_costs_force_at_rest():
    """A leak lowers the pressure at rest: the force error states by how much."""
    found = identify(
        [recording_of(record(out_and_back(), device_named('paper', 'effects_a.leak_conductance=2e-10')))],
        Options(close_loop=True),
    )
    result = found.channels['cylinder_a']
    offset = float(result.fit.model.recording_values[0, 0])
    size = re.match(r'At rest: ([\d.]+) N below the set-point[.] ', summary_of(found).force_error)[1]
    assert float(size) == pytest.approx(-offset * force_per_pressure(found.geometry), rel=0.06)
    assert 'At rest' not in summary_of(found, 'cylinder_b').force_error


def test_an_error_within_the_tolerance_is_not_called_noise():
    result = closed().channels['cylinder_a']
    tests = tuple(replace(test, statistic=2.0 * test.threshold) for test in result.findings.tests_after)
    found = changed(verdict='no_missing_effect', effects=(), tests_after=tests)
    summary = summary_of(found)
    assert summary.diagnosis.startswith('Within the tolerance. ')
    assert 'not noise' in summary.diagnosis
    assert summary.certainty.startswith('Accepted by --tolerance.')


def test_without_rests_a_larger_error_is_undecided():
    result = closed().channels['cylinder_a']
    tests = tuple(
        replace(test, statistic=1.4, threshold=1.5) if test.name == 'noise_floor' else test
        for test in result.findings.tests_after
    )
    noise = replace(result.findings.noise, known=False)
    found = changed(verdict='no_missing_effect', effects=(), tests_after=tests, noise=noise)
    assert summary_of(found).certainty.startswith('Only if the noise is autocorrelated. Record rests')


def test_an_effect_without_a_place_to_inspect_has_a_next_step(monkeypatch):
    monkeypatch.setitem(EFFECTS, 'droop', replace(EFFECTS['droop'], inspect=''))
    assert summary_of(closed()).next_steps == 'Inspect the cause of droop.'


def test_a_single_cylinder_moves_the_contact_force_alone():
    found = with_force(closed())
    alone = replace(found, channels={name: found.channels[name] for name in ('cylinder_b', 'force')})
    speeds = force_per_speed(alone.cylinders['cylinder_b'].found.model.parameters, force_per_pressure(alone.geometry))
    text = summary_of(alone, 'force').force_error
    assert f'{float(f"{1e-3 * speeds.shrinking:.2g}"):g} N lower per mm/s while chamber A grows' in text
