"""Recordings that are misread: signs; gauge for absolute in all pressures, which only the physical core sees."""

from dataclasses import replace

import pytest
from reference import AMBIENT

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import CylinderSignals, Signal, recording_of
from cfd_pneumatic.rig import device_named, record, surface_following


def read_with(shift, duration=30.0, **levels):
    """Return what is warned of cylinder A of a healthy device of full physics, pressure and set-point shifted [Pa]."""
    schedule = surface_following(duration=duration, seed=3, **levels)
    one = recording_of(record(schedule, device_named('real', ''), seed=3))
    own = one.cylinders['cylinder_a']
    shifted = CylinderSignals(*(Signal(signal.times, signal.values + shift) for signal in (own.pressure, own.setpoint)))
    found = identify([replace(one, cylinders={'cylinder_a': shifted}, force=None)], Options(close_loop=True))
    return [one for one in found.notices if one.level == WARNING]


@pytest.mark.parametrize(
    ('shift', 'levels', 'said', 'true'),
    [
        (AMBIENT, {}, 'gauge', 'absolute'),
        (-AMBIENT, {'duration': 15.0, 'setpoint': 1.6e5, 'setpoint_b': 1.3e5}, 'absolute', 'gauge'),
    ],
)
def test_what_is_explained_with_an_atmosphere_more_or_less_has_another_reference(shift, levels, said, true):
    (found,) = read_with(shift, **levels)
    assert found.code == 'reference_suspect'
    assert f'{true} ones that are said to be {said}' in found.message


def test_what_is_explained_as_it_is_read_is_no_suspect():
    assert read_with(0.0) == []


def test_in_recordings_that_are_misread_nothing_is_searched_for():
    schedule = surface_following(duration=20.0, seed=1)
    recording = recording_of(record(schedule, device_named('paper', ''), seed=1))
    turned = Signal(recording.displacement.times, -recording.displacement.values)
    found = identify([replace(recording, displacement=turned)], Options(close_loop=True))
    assert {one.code for one in found.notices if one.level == WARNING} == {'sign_suspect'}
    assert all(one.conclusion.tried == () and not one.found.model.parts for one in found.cylinders.values())
