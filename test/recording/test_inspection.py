"""What a recording looks like: the unit that it was recorded in is named, and the reference."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.recording.inspection import GAUGE_PRESSURES, doubts
from cfd_pneumatic.units import PSI, UNITS

TIMES = np.linspace(0.0, 10.0, 1001)
PISTON = 2e-3 * np.sin(TIMES)
LEVEL = 7e4  # gauge [Pa]
PRESSURES = ['Pa', 'kPa', 'psi', 'bar', 'MPa']


def fixes(displacement=None, pressure=None, setpoint=None):
    """Return what to do about a recording of one cylinder, by the code of the notice."""
    ambient = AMBIENT_PRESSURE
    pressure = pressure or Signal(TIMES, ambient + LEVEL + 1e3 * np.cos(TIMES))
    setpoint = setpoint or Signal(TIMES[:1], np.array([ambient + LEVEL]))
    cylinders = {'cylinder_a': CylinderSignals(pressure, setpoint)}
    recording = Recording('made', 0, displacement or Signal(TIMES, PISTON), cylinders, None, ())
    return {one.code: one.fix for one in doubts(recording, ambient) if one.level == 'warning'}


def test_a_recording_as_it_should_be_raises_no_doubt():
    assert fixes() == {}


@given(st.sampled_from(PRESSURES), st.sampled_from(PRESSURES), st.floats(2e4, 9e5))
def test_the_unit_that_a_pressure_was_recorded_in_is_named(right, said, level):
    factor = UNITS[said].si / UNITS[right].si
    read = Signal(TIMES, AMBIENT_PRESSURE + factor * (level + np.cos(TIMES)), said)
    held = Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + factor * level]), said)
    found = fixes(pressure=read, setpoint=held)
    if not GAUGE_PRESSURES[0] / 2.0 < factor * level < 2.0 * GAUGE_PRESSURES[1]:
        likely = [name for name in PRESSURES if f'if recorded in {name}' in found['unit_suspect']]
        assert right in likely or len(likely) == 3


@pytest.mark.parametrize(('right', 'said'), [('mm', 'm'), ('m', 'mm'), ('inch', 'mil'), ('mil', 'm')])
def test_the_unit_that_a_displacement_was_recorded_in_is_named(right, said):
    found = fixes(displacement=Signal(TIMES, PISTON * UNITS[said].si / UNITS[right].si, said))
    assert f'if recorded in {right}' in found['unit_suspect']


@pytest.mark.parametrize('factor', [1e3, 1e6])
def test_the_unit_of_the_time_is_asked_for(factor):
    assert (
        'check the unit of the time (it would be ' in fixes(displacement=Signal(factor * TIMES, PISTON))['unit_suspect']
    )


def test_the_unit_of_a_set_point_is_asked_for():
    found = fixes(setpoint=Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + 1e-3 * LEVEL]), 'kPa'))
    assert found == {'unit_suspect': 'check the unit of the set-point (it would be 70 kPa if recorded in MPa)'}


@pytest.mark.parametrize(('off', 'higher'), [(1.0, 'pressure'), (-1.0, 'set-point')])
def test_an_atmosphere_between_pressure_and_set_point_is_one_of_the_reference(off, higher):
    found = fixes(setpoint=Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL - off * AMBIENT_PRESSURE])))
    assert found['reference_suspect'].startswith(f'the {higher} is absolute and said to be gauge, or the ')


@pytest.mark.parametrize(('reference', 'fix'), [('gauge', 'pressure is absolute'), ('absolute', 'set-point is gauge')])
def test_what_a_mapping_says_tells_whose_reference_it_is(reference, fix):
    held = Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL]), 'kPa', reference)
    read = Signal(TIMES, held.values + AMBIENT_PRESSURE + 1e3 * np.cos(TIMES), 'kPa', reference)
    assert fixes(pressure=read, setpoint=held)['reference_suspect'].startswith(f'the {fix} and said to be')


def test_of_a_pressure_off_its_set_point_the_unit_is_named_in_which_it_is_at_it():
    in_psi = (AMBIENT_PRESSURE + LEVEL) / PSI
    read = Signal(TIMES, AMBIENT_PRESSURE + 1e3 * in_psi + np.cos(TIMES), 'kPa', 'gauge')
    held = Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL]), 'bar', 'gauge')
    assert fixes(pressure=read, setpoint=held)['setpoint_suspect'].endswith('(it is if the pressure is absolute psi)')
