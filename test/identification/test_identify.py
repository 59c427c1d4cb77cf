# SPDX-License-Identifier: Apache-2.0
"""From recordings to a report, on recordings of known truth."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from reference import AMBIENT, PSI, pressure_between_samples
from rich.console import Console

from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.device.live_error import live_errors
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.model import NAMES, SPECS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.reporting import print_report, report_data, write_report

GAINS = {5.0: np.array([4.3e6, 104.0, 19.4, 0.0105]), 10.0: np.array([5.5e6, 165.0, 30.0, 0.0123])}


def strokes(seed, levels=(5.0,), noise=50.0, duration=6.0, setpoint_recorded=True, offset=0.0, cylinder='cylinder_a'):
    """Return a recording of smooth strokes, pressure sampled between the displacement's samples."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration, 0.002)
    displacement = 1e-3 * (1.0 - np.cos(2.0 * np.pi * 1.3 * np.clip(times - 0.2, 0.0, None)))
    level = np.repeat(levels, -(-times.size // len(levels)))[: times.size]
    # a hold-from-time set-point acts on the steps that begin at or after it
    acts = np.concatenate([level[:1], level[:-1]])
    setpoint = AMBIENT + offset + acts * PSI
    grows = displacement if cylinder == 'cylinder_a' else -displacement
    exact = np.empty(times.size)
    for psig in set(levels):
        exact[acts == psig] = pressure_between_samples(GAINS[psig], times, grows, setpoint)[acts == psig]
    changes = np.flatnonzero(np.diff(level, prepend=np.nan))
    return Recording(
        f'strokes {seed}',
        0,
        Signal(times, displacement + 2e-7 * rng.normal(size=times.size)),
        {
            cylinder: CylinderSignals(
                Signal(times, exact + noise * rng.normal(size=times.size)),
                Signal(times[changes], AMBIENT + level[changes] * PSI) if setpoint_recorded else None,
            )
        },
        None,
        (),
    )


@pytest.fixture(scope='module')
def one():
    return identify([strokes(0)])


def assert_close(estimates, truth, stds=4.0):
    for estimate, true in zip(estimates, truth):
        assert estimate.identifiable
        assert abs(estimate.value - true) < stds * estimate.std
        assert estimate.std < 0.05 * true


def test_finds_the_truth_and_reaches_the_noise(one):
    result = one.cylinders['cylinder_a']
    assert_close(result.fit.estimates, GAINS[5.0])
    assert result.noise.std == pytest.approx(50.0, rel=0.06)
    for error in result.before.values():
        assert error.rmse == pytest.approx(50.0, rel=0.08)
        assert error.nrmse_percent == pytest.approx(100.0 * error.rmse / result.span)


def test_cylinder_b_shrinks_where_a_grows():
    found = identify([strokes(1, cylinder='cylinder_b')])
    assert_close(found.cylinders['cylinder_b'].fit.estimates, GAINS[5.0])


def test_a_set_point_that_is_not_recorded_is_found():
    found = identify([strokes(2, setpoint_recorded=False)]).cylinders['cylinder_a']
    assert_close(found.fit.estimates, GAINS[5.0])
    assert found.schedule[0].setpoint == pytest.approx(5.0 * PSI, abs=15.0)


def test_the_offset_of_a_recorded_set_point_is_found():
    found = identify([strokes(3, offset=700.0)]).cylinders['cylinder_a']
    assert found.fit.model.recording_values[0, 0] == pytest.approx(700.0, abs=5.0 * found.fit.stds[0, 0])
    assert found.fit.stds[0, 0] < 20.0


def test_several_recordings_share_parameters_but_not_their_set_points():
    recordings = [
        strokes(4, offset=500.0, duration=4.0),
        strokes(5, offset=-300.0, setpoint_recorded=False, duration=4.0, noise=100.0),
    ]
    found = identify(recordings).cylinders['cylinder_a']
    single = identify(recordings[:1]).cylinders['cylinder_a']
    assert_close(found.fit.estimates, GAINS[5.0])
    assert found.fit.model.recording_values[0, 0] == pytest.approx(500.0, abs=20.0)
    for joint, alone in zip(found.fit.estimates, single.fit.estimates):
        assert joint.std < alone.std


def test_each_set_point_gets_its_own_row():
    found = identify([strokes(6, levels=(5.0, 10.0), duration=12.0)], Options(per_setpoint=True))
    result = found.cylinders['cylinder_a']
    assert [point.setpoint / PSI for point in result.schedule] == pytest.approx([5.0, 10.0], abs=0.01)
    for psig, point in zip((5.0, 10.0), result.schedule):
        for estimate, true in zip(point.fit.estimates, GAINS[psig]):
            assert estimate.value == pytest.approx(true, rel=0.05)
    data = yaml.safe_load(identified_device(found).text)['/**']['ros__parameters']['cylinder_a']
    assert all(len(data[name]) == 2 for name in ('setpoints', *NAMES))


def test_a_set_point_of_the_test_part_alone_gets_no_row():
    recording = strokes(6, levels=(5.0, 5.0, 5.0, 5.0, 5.0, 10.0), duration=12.0)
    result = identify([recording], Options(per_setpoint=True)).cylinders['cylinder_a']
    assert [point.setpoint / PSI for point in result.schedule] == pytest.approx([5.0], abs=0.01)
    (note,) = result.notes
    assert note.endswith('is not in the schedule: only the test part contains it')


def test_nothing_reads_the_test_part(one):
    """Spoil the test part: what was fitted stays the same to the last bit, only the test error grows."""
    recording = strokes(0)
    signals = recording.cylinders['cylinder_a']
    spoilt = signals.pressure.values.copy()
    spoilt[signals.pressure.times > one.splits[0].bounds[1]] += 500.0
    spoilt_signals = replace(signals, pressure=Signal(signals.pressure.times, spoilt))
    found = identify([replace(recording, cylinders={'cylinder_a': spoilt_signals})]).cylinders['cylinder_a']
    before = one.cylinders['cylinder_a']
    np.testing.assert_array_equal(found.fit.model.parameters, before.fit.model.parameters)
    assert found.before['train'].rmse == before.before['train'].rmse
    assert found.before['test'].rmse > 400.0


def test_pressure_may_have_times_of_its_own():
    recording = strokes(7)
    signals = recording.cylinders['cylinder_a']
    some = np.random.default_rng(0).random(signals.pressure.times.size) < 0.3
    thinned = replace(signals, pressure=Signal(signals.pressure.times[some], signals.pressure.values[some]))
    found = identify([replace(recording, cylinders={'cylinder_a': thinned})])
    for estimate, true in zip(found.cylinders['cylinder_a'].fit.estimates, GAINS[5.0]):
        assert abs(estimate.value - true) < 4.0 * estimate.std


def test_a_recording_may_begin_while_the_piston_moves():
    recording = strokes(8)
    begin = 1.0

    def later(signal):
        kept = signal.times >= begin
        return Signal(signal.times[kept], signal.values[kept])

    signals = recording.cylinders['cylinder_a']
    cut = Recording(
        'cut',
        0,
        later(recording.displacement),
        {'cylinder_a': CylinderSignals(later(signals.pressure), None)},
        None,
        (),
    )
    found = identify([cut]).cylinders['cylinder_a']
    assert_close(found.fit.estimates, GAINS[5.0])
    assert found.before['train'].rmse == pytest.approx(50.0, rel=0.1)


def test_the_report_is_strict_json_in_the_agreed_form(one, tmp_path):
    write_report(one, tmp_path)
    data = json.loads((tmp_path / 'report.json').read_text(), parse_constant=lambda name: pytest.fail(name))
    written = {name: data.pop(name) for name in ('run', 'files')}
    assert data == report_data(one, live_errors(one, identified_device(one)))
    assert set(written['files']) == {'parameters.yaml'}
    assert f'run {written["run"]}' in (tmp_path / 'parameters.yaml').read_text()
    assert data['schema'] == 1
    cylinder = data['cylinders']['cylinder_a']
    assert set(cylinder) >= {'parameters', 'schedule', 'span_pa', 'noise_floor_pa', 'before'}
    for spec in SPECS:
        entry = cylinder['parameters'][spec.name]
        assert set(entry) >= {'value', 'std', 'ci95', 'unit', 'identifiable'}
        assert entry['ci95'][0] < entry['value'] < entry['ci95'][1]
        assert entry['unit'] == spec.unit
    assert 'setpoint_pa' in cylinder['schedule'][0]
    assert set(cylinder['before']) == {'train', 'validation', 'test'}
    assert set(cylinder['before']['test']) == {'rmse_pa', 'nrmse_percent'}


def test_what_is_not_identifiable_is_null_in_the_report_and_named_in_the_parameters():
    recording = strokes(9, duration=0.56)  # one growing stroke: the regulator only charges
    found = identify([recording])
    entry = report_data(found)['cylinders']['cylinder_a']['parameters']
    names = [name for name in NAMES if not entry[name]['identifiable']]
    assert 'k_v' in names
    for name in names:
        assert entry[name]['value'] is None
        assert entry[name]['std'] is None
        assert entry[name]['ci95'] is None
        assert entry[name]['reason']
    text = identified_device(found).text
    used = dict(zip(NAMES, found.cylinders['cylinder_a'].fit.model.parameters))
    assert yaml.safe_load(text)['/**']['ros__parameters']['cylinder_a']['k_v'] == [used['k_v']]
    (line,) = (line for line in text.splitlines() if 'k_v:' in line)
    assert 'not identifiable, value assumed in the fit' in line


def test_the_table_shows_the_papers_units_beside_si(one):
    stream = io.StringIO()
    print_report(one, Console(file=stream, width=120))
    text = stream.getvalue()
    assert 'lbf/in^3' in text
    assert 'Pa/m' in text
    assert 'RMSE, psi' in text
    assert 'psi) gauge' in text


def test_no_motion_is_said():
    recording = strokes(10)
    still = replace(
        recording,
        displacement=Signal(
            recording.displacement.times, 1e-6 * np.random.default_rng(0).normal(size=recording.displacement.times.size)
        ),
    )
    with pytest.raises(InputError, match='the piston does not move'):
        identify([still])


def test_a_frozen_displacement_is_no_motion():
    recording = strokes(11)
    frozen = replace(recording, displacement=Signal(recording.displacement.times, 0.0 * recording.displacement.times))
    with pytest.raises(InputError, match='the piston does not move'):
        identify([frozen])


def test_too_few_samples_are_said():
    recording = strokes(12)
    short = replace(
        recording, displacement=Signal(recording.displacement.times[:10], recording.displacement.values[:10])
    )
    with pytest.raises(InputError, match='10 displacement samples are too few'):
        identify([short])


def test_pressures_apart_from_the_motion_are_said():
    recording = strokes(13)
    signals = recording.cylinders['cylinder_a']
    apart = replace(signals, pressure=Signal(signals.pressure.times + 5.99, signals.pressure.values))
    with pytest.raises(InputError, match='cylinder_a/pressure are between'):
        identify([replace(recording, cylinders={'cylinder_a': apart})])


def test_a_recording_that_begins_with_its_only_stroke_may_be_the_test_part():
    """It has no sample that counts as train, not even one at rest."""

    def late(seed):
        one = strokes(seed, duration=1.2)
        cylinder = one.cylinders['cylinder_a']
        pressure = Signal(cylinder.pressure.times + 0.02, cylinder.pressure.values)
        return replace(one, cylinders={'cylinder_a': replace(cylinder, pressure=pressure)})

    recordings = [late(seed).between(0.33 if seed > 1 else 0.0, 1.2) for seed in range(4)]
    found = identify(recordings, Options(close_loop=True))
    assert [split.whole for split in found.splits] == ['train', 'train', 'validation', 'test']
    result = found.cylinders['cylinder_a']
    assert not np.any(result.experiments[3].part < 2)
    assert result.conclusion.effects == ('transport_delay',)
    assert result.after['test'].rmse < 0.9 * result.before['test'].rmse


@pytest.mark.parametrize('what', ['displacement', 'pressure'])
def test_numbers_that_no_device_makes_are_told(what):
    one = strokes(0)
    cylinder = one.cylinders['cylinder_a']
    if what == 'pressure':
        huge = replace(cylinder, pressure=Signal(cylinder.pressure.times, 1e150 * cylinder.pressure.values))
        one = replace(one, cylinders={'cylinder_a': huge})
    else:
        one = replace(one, displacement=Signal(one.displacement.times, 1e7 * one.displacement.values))
    with pytest.raises(InputError, match=rf'{what} goes from .* which is beyond any device. Check the topic'):
        identify([one])
