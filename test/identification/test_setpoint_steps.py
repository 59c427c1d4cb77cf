# SPDX-License-Identifier: Apache-2.0
"""A set-point that was not recorded: when it was stepped, and where to, is said before anything is searched for."""

from dataclasses import replace

import pytest
from measured import MAPPING, ROOT, needs_measured_data

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import CylinderSignals, read_mapping, read_recording, recording_of
from cfd_pneumatic.rig import device_named, out_and_back, record, surface_following

STEPS = 'effects_a.jump=3000 effects_a.jump_time=8'
DRIFTS = 'effects_a.drift=100'
SWINGS = 'effects_a.pulsation=300 effects_a.pulsation_frequency=0.1'
CREEPS = 'odd_a.creep=1000 odd_a.creep_time=4'


def recorded(schedule, faults=''):
    """Return what was recorded of cylinder A alone, without its set-point."""
    one = recording_of(record(schedule, device_named('paper', faults), seed=17200))
    own = CylinderSignals(one.cylinders['cylinder_a'].pressure, None)
    return replace(one, cylinders={'cylinder_a': own}, force=None)


def at_one_set_point(faults):
    """Return what is found of a recording at one set-point, without a search."""
    schedule = surface_following(duration=20.0, seed=4, setpoint_steps=0.0)
    return identify([recorded(schedule, faults)], Options())


def steps_of(found):
    return [one.message for one in found.notices if one.code == 'setpoint_assumed' and one.level == WARNING]


def test_when_it_steps_and_where_to_is_said_and_nothing_is_searched_for():
    found = identify([recorded(surface_following(duration=20.0, seed=1))], Options(close_loop=True))
    (message,) = steps_of(found)
    for told in ('about 69.1 kPa above ambient', '66.3 kPa from 7.33 s on', '77 kPa from 14.53 s on'):
        assert told in message
    conclusion = found.cylinders['cylinder_a'].findings
    assert (conclusion.verdict, conclusion.status, conclusion.tried) == ('unexplained', 'hypothesis', ())
    assert 'Effects were not searched: the warning' in conclusion.why


def test_a_pressure_that_steps_and_so_does_not_follow_the_piston_is_said_to():
    with pytest.raises(InputError, match=r'was not recorded, and it steps: about 34.* 68.* from 1\.31 s on'):
        identify([recorded(out_and_back())])


def test_one_step_is_enough():
    assert 'about 69 kPa above ambient, 72 kPa from 8.01 s on' in steps_of(at_one_set_point(STEPS))[0]


@needs_measured_data
def test_recordings_at_pressures_far_apart_are_neither_stepped_nor_misread():
    """The gains of one pressure leave strokes at another, which look like steps, or like those of another sign."""
    files = [ROOT / 'friction' / f'O-ring257_{bar}bar.csv' for bar in (1, 5, 7)]
    together = identify([read_recording(one, mapping=read_mapping(MAPPING)) for one in files], Options())
    assert together.cylinders['cylinder_a'].fit.spans_pressures
    assert [one.code for one in together.notices if one.level == WARNING] == []


@pytest.mark.parametrize('faults', ['', DRIFTS, SWINGS, CREEPS], ids=('healthy', 'drifts', 'swings', 'creeps'))
def test_what_does_not_step_is_no_staircase(faults):
    assert steps_of(at_one_set_point(faults)) == []


@pytest.mark.parametrize(('faults', 'rate'), [('', 0.0), (DRIFTS, 100.0)])
@pytest.mark.parametrize('close_loop', [False, True])
def test_a_set_point_that_was_not_recorded_may_drift(faults, rate, close_loop):
    one = recorded(surface_following(duration=20.0, seed=4, setpoint_steps=0.0), faults)
    found = identify([one], Options(close_loop=close_loop))
    result = found.cylinders['cylinder_a']
    assert result.found.model.recording_values[0, 2] == pytest.approx(rate, abs=2.0)
    (told,) = [notice.message for notice in found.notices if notice.code == 'setpoint_drifts']
    assert told.startswith('cylinder_a: the assumed set-point drifts by ')
    if close_loop:
        assert (result.conclusion.verdict, result.conclusion.effects) == ('no_missing_effect', ())
