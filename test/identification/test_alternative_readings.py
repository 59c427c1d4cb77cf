# SPDX-License-Identifier: Apache-2.0
"""Recordings that are misread: signs; units and references of all pressures, which only the physical core sees."""

from dataclasses import replace

import numpy as np
import pytest
from reference import AMBIENT, PSI

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.input_checks.alternative_readings import alternative_reading
from cfd_pneumatic.identification.residual_dependence import describe_remaining_error
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import CylinderSignals, Signal, recording_of
from cfd_pneumatic.reporting import next_plan
from cfd_pneumatic.rig import device_named, out_and_back, record, surface_following
from cfd_pneumatic.units import INCH, POUND_FORCE

SHORT = {'duration': 8.0, 'setpoint': 1e5, 'amplitude': 2e-3}
"""Strokes large enough to tell pressures from others within seconds."""


def read_with(shift, factor=1.0, said=(None, None), faults='', **surface):
    """Return what is warned of cylinder A of a device of full physics, its pressures times `factor` shifted."""
    schedule = surface_following(seed=3, **{**SHORT, **surface})
    one = recording_of(record(schedule, device_named('real', faults), seed=3))
    own = one.cylinders['cylinder_a']
    shifted = CylinderSignals(
        *(Signal(signal.times, factor * signal.values + shift, *said) for signal in (own.pressure, own.setpoint))
    )
    found = identify([replace(one, cylinders={'cylinder_a': shifted}, force=None)], Options(close_loop=True))
    return [one for one in found.notices if one.level == WARNING]


@pytest.mark.long
def test_what_is_explained_with_an_atmosphere_more_has_another_reference():
    (found,) = read_with(-AMBIENT, duration=15.0, setpoint=1.6e5, setpoint_b=1.3e5, amplitude=0.8e-3)
    assert found.code == 'reference_suspect'
    assert 'read as absolute, but look like gauge' in found.message


def test_what_is_explained_in_another_unit_is_in_it():
    (found,) = read_with(AMBIENT, factor=1e3 / PSI, said=('kPa', 'gauge'))
    assert found.code == 'unit_suspect'
    assert 'read as gauge kPa, but look like absolute psi' in found.message


@pytest.mark.parametrize('said', [(None, None), ('kPa', 'gauge'), ('psi', 'absolute')])
def test_what_is_explained_as_it_is_read_is_no_suspect(said):
    assert read_with(0.0, said=said) == []


@pytest.mark.parametrize('faults', ['', pytest.param('effects_a.leak_conductance=1.5e-10', marks=pytest.mark.long)])
def test_of_two_references_that_leave_noise_the_one_that_leaves_clearly_less_is_named(faults):
    small = {'faults': faults, 'duration': 10.0, 'setpoint': 10.0 * PSI, 'amplitude': 1e-3}
    assert read_with(0.0, said=('Pa', 'absolute'), **small) == []
    (found,) = read_with(AMBIENT, said=('Pa', 'gauge'), **small)
    assert found.code == 'reference_suspect'
    assert found.fix == 'check their reference: with `reference: absolute` the remaining error is clearly smaller'


def noticed_of_linear(factor=1.0, shift=0.0):
    """Return the notices of cylinder A of a device of the paper's law, its pressures times `factor` shifted, as kPa."""
    one = recording_of(record(surface_following(duration=10.0, seed=3), device_named('paper', ''), seed=3))
    signals = (one.cylinders['cylinder_a'].pressure, one.cylinders['cylinder_a'].setpoint)
    own = CylinderSignals(*(Signal(it.times, factor * it.values + shift, 'kPa', 'gauge') for it in signals))
    return identify([replace(one, cylinders={'cylinder_a': own}, force=None)], Options()).notices


@pytest.mark.parametrize('shift', [0.0, AMBIENT])
def test_how_long_the_chamber_would_be_is_said_and_with_the_other_reference_where_that_may_be(shift):
    found = noticed_of_linear(shift=shift)
    (told,) = [one for one in found if one.code == 'chamber_told']
    length = float(told.message.partition(' mm')[0].rpartition(' ')[2])
    assert (30.0 < length < 40.0) == (shift == 0.0)
    assert ('mm if the pressures are absolute' in told.fix) == (shift > 0.0)
    assert not any(one.level == WARNING for one in found)


def test_which_other_units_make_a_usual_chamber_and_a_usual_bore_is_said():
    one = recording_of(record(surface_following(duration=10.0, seed=3), device_named('paper', ''), seed=3))
    in_inches = Signal(one.displacement.times, INCH / 1e-2 * one.displacement.values, 'inch')
    in_newtons = Signal(one.force.times, one.force.values / POUND_FORCE, 'N')
    notices = identify([replace(one, displacement=in_inches, force=in_newtons)], Options()).notices
    fixes = {one.code: one.fix for one in notices}
    assert fixes['chamber_told'].endswith(' mm if the displacement is in cm')
    assert fixes['area_told'].endswith('; the bore would be 38.1 mm if the force is in lbf')


def test_a_chamber_that_is_long_for_its_stroke_is_suspected_where_other_units_make_it_usual():
    (told,) = [one for one in noticed_of_linear(1e3 / PSI, AMBIENT) if one.level == WARNING]
    assert told.code == 'unit_suspect'
    assert 'mm if the pressures are absolute psi' in told.fix


@pytest.mark.parametrize(
    'schedule', [out_and_back(), surface_following(duration=20.0, seed=17202)], ids=['two', 'many']
)
def test_a_sign_is_told_beside_steps_of_a_set_point_that_was_not_recorded(schedule):
    one = recording_of(record(schedule, device_named('real', ''), seed=17202))
    cylinders = {'cylinder_a': CylinderSignals(one.cylinders['cylinder_a'].pressure, None)}
    turned = Signal(one.displacement.times, -one.displacement.values)
    assert alternative_reading([replace(one, cylinders=cylinders, force=None)], Options()) is None
    found = alternative_reading([replace(one, cylinders=cylinders, force=None, displacement=turned)], Options())
    assert found.code == 'sign_suspect'


def test_steps_of_a_set_point_alone_tell_no_sign():
    device = device_named('real', 'effects_a.leak_conductance=1e-9')
    one = recording_of(record(surface_following(duration=30.0, seed=14), device, seed=14))
    pressure = one.cylinders['cylinder_a'].pressure
    as_kpa = CylinderSignals(Signal(pressure.times, 1e3 / PSI * pressure.values + AMBIENT), None)
    assert alternative_reading([replace(one, cylinders={'cylinder_a': as_kpa}, force=None)], Options()) is None


def test_where_the_unit_of_the_time_is_wrong_nothing_is_searched_for():
    recording = recording_of(record(surface_following(duration=10.0, seed=1), device_named('real', ''), seed=1))
    quick = replace(
        recording,
        displacement=Signal(1e-3 * recording.displacement.times, recording.displacement.values),
        cylinders={
            name: CylinderSignals(
                *(Signal(1e-3 * signal.times, signal.values) for signal in (own.pressure, own.setpoint))
            )
            for name, own in recording.cylinders.items()
        },
        force=None,
    )
    found = identify([quick], Options(close_loop=True))
    assert any('unit of the time' in one.fix for one in found.notices)
    assert all(one.conclusion.tried == () for one in found.cylinders.values())


@pytest.mark.parametrize('what', ['a clipped pressure', 'a noisy set-point'])
def test_where_a_sensor_hides_effects_nothing_is_searched_for(what):
    recording = recording_of(record(surface_following(duration=10.0, seed=1), device_named('real', ''), seed=1))
    own, rng = recording.cylinders['cylinder_a'], np.random.default_rng(1)
    pressure, held = own.pressure, own.setpoint
    values, times = pressure.values, pressure.times
    if what == 'a clipped pressure':
        pressure = replace(pressure, values=np.clip(values, *np.percentile(values, (15.0, 85.0))))
        pressure = replace(pressure, values=pressure.values + 100.0 * rng.standard_normal(len(times)))
    else:
        levels = held.values[np.searchsorted(held.times[1:], times, side='right')]
        held = Signal(times, levels + 200.0 * rng.standard_normal(len(times)))
    cylinders = {'cylinder_a': CylinderSignals(pressure, held)}
    found = identify([replace(recording, cylinders=cylinders, force=None)], Options(close_loop=True))
    assert {one.code for one in found.notices if one.level == WARNING} & {'samples_suspect', 'setpoint_suspect'}
    assert all(one.conclusion.tried == () for one in found.cylinders.values())


def test_in_recordings_that_are_misread_nothing_is_searched_for():
    schedule = surface_following(duration=20.0, seed=1)
    recording = recording_of(record(schedule, device_named('paper', ''), seed=1))
    turned = Signal(recording.displacement.times, -recording.displacement.values)
    found = identify([replace(recording, displacement=turned)], Options(close_loop=True))
    assert {one.code for one in found.notices if one.level == WARNING} == {'sign_suspect'}
    assert all(one.conclusion.tried == () and not one.found.model.parts for one in found.cylinders.values())
    assert not any(
        one.conclusion.next_experiment or 'depends most' in describe_remaining_error(one)
        for one in found.cylinders.values()
    )
    assert next_plan(found) is None
