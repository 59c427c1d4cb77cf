"""Recordings that are misread: signs; gauge for absolute in all pressures, which only the physical core sees."""

from dataclasses import replace

import pytest
from reference import AMBIENT

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import CylinderSignals, Signal, recording_of
from cfd_pneumatic.rig import device_named, record, surface_following


def read_with(shift, **levels):
    """Return what is warned of in a healthy device of full physics, its pressures and set-points shifted [Pa]."""
    schedule = surface_following(duration=40.0, seed=3, **levels)
    recording = recording_of(record(schedule, device_named('real', ''), seed=3))
    cylinders = {
        name: CylinderSignals(*(Signal(own.times, own.values + shift) for own in (one.pressure, one.setpoint)))
        for name, one in recording.cylinders.items()
    }
    found = identify([replace(recording, cylinders=cylinders, force=None)], Options(close_loop=True))
    return [one for one in found.notices if one.level == WARNING]


@pytest.mark.parametrize(
    ('shift', 'levels', 'said', 'true'),
    [
        (AMBIENT, {}, 'gauge', 'absolute'),
        (-AMBIENT, {'setpoint': 1.6e5, 'setpoint_b': 1.3e5}, 'absolute', 'gauge'),
    ],
)
def test_what_is_explained_with_an_atmosphere_more_or_less_has_another_reference(shift, levels, said, true):
    found = read_with(shift, **levels)
    assert {one.code for one in found} == {'reference_suspect'}
    assert all(f'{true} ones that are said to be {said}' in one.message for one in found)


def test_what_is_explained_as_it_is_read_is_no_suspect():
    assert read_with(0.0) == []


def test_in_recordings_that_are_misread_nothing_is_searched_for():
    schedule = surface_following(duration=20.0, seed=1)
    recording = recording_of(record(schedule, device_named('paper', ''), seed=1))
    turned = Signal(recording.displacement.times, -recording.displacement.values)
    found = identify([replace(recording, displacement=turned)], Options(close_loop=True))
    assert {one.code for one in found.notices if one.level == WARNING} == {'sign_suspect'}
    assert all(one.conclusion.tried == () and not one.found.model.parts for one in found.cylinders.values())
