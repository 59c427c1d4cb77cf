# SPDX-License-Identifier: Apache-2.0
"""What was identified is what runs: from the result, from its file, smoothed as reported, and live."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from identified import recording

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.device import DESCRIPTORS, Device
from cfd_pneumatic.device.identified import estimated_setpoints, identified_device, identified_recordings
from cfd_pneumatic.device.live_error import live_errors
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Identification, Options, identify
from cfd_pneumatic.model import LiveDevice
from cfd_pneumatic.recording import Recording


def alone(one: Recording) -> Recording:
    """Return a recording of one cylinder."""
    return replace(one, cylinders={'cylinder_a': one.cylinders['cylinder_a']}, force=None)


def resting(one: Recording) -> Recording:
    """Return the stretch of a recording with one set-point, as if nobody had recorded it."""
    setpoint = one.cylinders['cylinder_a'].setpoint
    piece = one.between(0.0, float(setpoint.times[1])) if len(setpoint) > 1 else one
    cylinders = {name: replace(signals, setpoint=None) for name, signals in piece.cylinders.items()}
    return replace(piece, cylinders=cylinders)


CASES = {
    'two cylinders': (lambda: recording(), Options()),
    'two cylinders with effects': (lambda: recording(), Options(close_loop=True)),
    'one cylinder': (lambda: alone(recording()), Options()),
    'one cylinder with effects': (lambda: alone(recording()), Options(close_loop=True)),
    'estimated set-points': (lambda: resting(recording()), Options()),
    'one cylinder, estimated set-point, effects': (lambda: alone(resting(recording())), Options(close_loop=True)),
}
"""Recordings, and how they are identified."""


@cache
def identified(case: str) -> Identification:
    make, options = CASES[case]
    return identify([make()], options)


def rmse(identification: Identification, channel: str, answers: Recording) -> float:
    """Return the error of answers on the part on which the report gives it."""
    result = identification.channels[channel]
    (one,) = result.comparisons
    measured, answered = (result.channel.signal(each) for each in (identification.recordings[0], answers))
    at = np.searchsorted(measured.times, answered.times)
    assert np.array_equal(measured.times[at], answered.times), 'answers at the measured times'
    (split,) = identification.splits
    judged = split.part_of(answered.times) == 2 if result.judged_on == 'test' else np.ones(len(answered), bool)
    assert np.count_nonzero(judged) == pytest.approx(np.count_nonzero(result.judged(one)), abs=2)
    return float(np.sqrt(np.mean((measured.values[at] - answered.values)[judged] ** 2)))


@pytest.mark.parametrize('case', CASES)
def test_the_file_holds_the_device(case, tmp_path):
    device = identified_device(identified(case))
    device.save(tmp_path / 'parameters.yaml')
    loaded = Device.load(tmp_path / 'parameters.yaml')
    assert loaded == device
    before, after = (one.simulate(identified(case).recordings[0]) for one in (device, loaded))
    for name, signals in before.cylinders.items():
        np.testing.assert_allclose(after.cylinders[name].pressure.values, signals.pressure.values, rtol=1e-9)


@pytest.mark.parametrize('case', CASES)
def test_it_simulates_with_the_error_of_the_report(case):
    found = identified(case)
    (as_identified,) = identified_recordings(found)
    answers = identified_device(found).simulate(as_identified)
    for name, result in found.cylinders.items():
        assert rmse(found, name, answers) == pytest.approx(result.rmse(1), rel=0.01)
    if 'force' in found.channels:
        answers = identified_device(found).simulate(as_identified, measured_pressures=True)
        assert rmse(found, 'force', answers) == pytest.approx(found.channels['force'].rmse(1), rel=0.01)


def test_some_of_the_cases_have_effects():
    assert [case for case in CASES if identified(case).cylinders['cylinder_a'].found.model.effects] == [
        case for case in CASES if 'effects' in case
    ]


@pytest.mark.parametrize('case', CASES)
def test_estimated_set_points_stand_in_the_file_and_are_an_argument(case):
    found = identified(case)
    device, (estimated,) = identified_device(found), estimated_setpoints(found)
    assert set(estimated) == (set(found.cylinders) if 'estimated' in case else set())
    assert estimated == pytest.approx({name: device.initial_setpoints[name] for name in estimated}, rel=1e-12)
    other = {name: level + 1000.0 for name, level in device.initial_setpoints.items()}
    shifted = device.simulate(found.recordings[0], setpoints=other)
    for name in found.cylinders:
        assert shifted.cylinders[name].setpoint.values == pytest.approx([other[name] + AMBIENT_PRESSURE])
        usual = device.simulate(found.recordings[0], setpoints=device.initial_setpoints).cylinders[name].pressure
        assert np.mean(shifted.cylinders[name].pressure.values - usual.values) == pytest.approx(1000.0, rel=0.05)


def test_the_file_says_that_a_drift_goes_on_from_the_start_of_a_node():
    one = alone(recording())
    signals = one.cylinders['cylinder_a']
    drifting = replace(signals.pressure, values=signals.pressure.values + 100.0 * signals.pressure.times)
    found = identify(
        [replace(one, cylinders={'cylinder_a': replace(signals, pressure=drifting)})], Options(close_loop=True)
    )
    assert 'set_point_drift' in found.cylinders['cylinder_a'].found.model.effects
    assert 'enabled: true  # depends on the time since the recording' in identified_device(found).text


def test_live_it_answers_each_sample_as_the_model_steps():
    found = identified('two cylinders with effects')
    device, one = identified_device(found), recording().between(0.0, 1.0)
    answers = device.simulate(one, raw=True)
    live = LiveDevice(device.model, 1.0)
    for index, (time, position) in enumerate(zip(one.displacement.times, one.displacement.values)):
        held = [
            signals.setpoint.values[max(np.searchsorted(signals.setpoint.times, time - 1e-9) - 1, 0)]
            for signals in one.cylinders.values()
        ]
        live.sample(round(time * 1e9), float(position), (float(held[0]), float(held[1])))
        state = live.committed.state
        assert answers.cylinders['cylinder_a'].pressure.values[index] == state.a.reading
        assert answers.cylinders['cylinder_b'].pressure.values[index] == state.b.reading
        assert answers.force.values[index] == device.model.contact_force(state)


def test_the_live_error_is_that_of_answers_on_the_test_part():
    found = identified('two cylinders with effects')
    device = identified_device(found)
    answers = device.simulate(found.recordings[0], raw=True)
    errors = live_errors(found, device)
    assert set(errors) == {'cylinder_a', 'cylinder_b', 'force'}
    for name, error in errors.items():
        measured, answered = (found.channels[name].channel.signal(one) for one in (found.recordings[0], answers))
        judged = found.splits[0].part_of(measured.times) == 2
        left = measured.values - np.interp(measured.times, answered.times, answered.values)
        assert error.rmse == pytest.approx(float(np.sqrt(np.mean(left[judged] ** 2))), rel=0.01)


def test_operating_points_are_interpolated_with_effects_too():
    """A schedule with effects is stepped, one set of gains is followed: once they have settled they agree."""
    one = recording().between(0.0, 2.0)
    gains = {'k_x': 5e6, 'k_sv': 100.0, 'k_v': 30.0, 'tau': 0.01}
    effect = {'cylinder_a.leakage.enabled': True, 'cylinder_a.leakage.conductance': 0.3}
    single = {f'cylinder_a.{name}': [value] for name, value in gains.items()}
    double = {f'cylinder_a.{name}': [value] * 2 for name, value in gains.items()}
    pressures = [
        Device({**effect, **values, 'cylinder_a.setpoints': setpoints}).simulate(one).cylinders['cylinder_a'].pressure
        for values, setpoints in ((single, [5e4]), (double, [3e4, 9e4]))
    ]
    assert pressures[1].values[100:] == pytest.approx(pressures[0].values[100:], abs=1.0)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'cylinder_a.taau': [0.1]}, 'cylinder_a.taau is not a parameter of a device'),
        ({'area': 'large'}, 'area: give a number'),
        ({'area': 5.0}, 'area = 5 is outside 1e-06 to 1 m^2'),
        ({'cylinder_a.enabled': 1}, 'cylinder_a.enabled: give true or false'),
        ({'cylinder_a.k_x': 'none'}, 'cylinder_a.k_x: give a list of numbers'),
        ({'cylinder_a.k_x': [1.0] * 4}, 'cylinder_a.k_x[0] = 1 is outside'),
        ({'cylinder_a.not_identifiable': [1.0]}, 'cylinder_a.not_identifiable: give a list of names'),
        ({'geometric_factor': 0.0}, 'geometric_factor is 0'),
        ({'cylinder_a.enabled': False, 'cylinder_b.enabled': False}, 'are both false: leave one of them true'),
    ],
)
def test_a_bad_value_is_one_line(values, message):
    with pytest.raises(InputError) as refused:
        Device(values)
    assert message in str(refused.value)


def test_a_misspelt_name_in_a_file_is_found(tmp_path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('/**:\n  ros__parameters:\n    timeout: 2.0\n    cylinder_a:\n      taau: [0.1]\n')
    told = r'line 5: no parameter of a device has this name: did you mean cylinder_a\.tau\?'
    with pytest.raises(InputError, match=told):
        Device.load(file)


def test_set_points_of_no_cylinder_and_a_short_recording_are_refused():
    device = identified_device(identified('one cylinder'))
    with pytest.raises(InputError, match='there is no cylinder_b for a set-point: the cylinders are cylinder_a'):
        device.simulate(recording(), setpoints={'cylinder_b': 5e4})
    with pytest.raises(InputError, match='too few: give at least'):
        device.simulate(recording().between(0.0, 0.005))


def test_every_parameter_is_described():
    for one in DESCRIPTORS.values():
        assert one.description
        assert one.checked(list(one.default) if isinstance(one.default, tuple) else one.default) == one.default


def test_live_a_set_point_acts_from_the_sample_after_it():
    """As in a node, which hears it after the sample of its time; one sample earlier was the report's error."""
    times = np.arange(0.0, 0.2, 2e-3)
    levels = np.where(times < times[50], 1.5e5, 1.7e5)
    still = Recording.from_arrays(
        times,
        np.zeros(times.size),
        {'cylinder_a': levels, 'cylinder_b': levels},
        {'cylinder_a': levels, 'cylinder_b': 1.5e5},
    )
    answers = Device({}).simulate(still, raw=True).cylinders['cylinder_a'].pressure.values
    assert np.ptp(answers[:51]) == 0.0
    assert answers[51] > answers[50]
