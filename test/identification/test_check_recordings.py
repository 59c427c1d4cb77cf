# SPDX-License-Identifier: Apache-2.0
"""What a recording looks like: the unit that it was recorded in is named, and the reference."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.identification.input_checks.recordings import check_recording
from cfd_pneumatic.identification.input_checks.thresholds import GAUGE_PRESSURES
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.units import PSI, UNITS

TIMES = np.linspace(0.0, 10.0, 1001)
PISTON = 2e-3 * np.sin(TIMES)
LEVEL = 7e4  # gauge [Pa]
PRESSURES = ['Pa', 'mbar', 'kPa', 'psi', 'bar', 'MPa']


def fixes(displacement=None, pressure=None, setpoint=None):
    """Return what to do about a recording of one cylinder, by the code of the notice."""
    ambient = AMBIENT_PRESSURE
    pressure = pressure or Signal(TIMES, ambient + LEVEL + 1e3 * np.cos(TIMES))
    setpoint = setpoint or Signal(TIMES[:1], np.array([ambient + LEVEL]))
    cylinders = {'cylinder_a': CylinderSignals(pressure, setpoint)}
    recording = Recording('made', 0, displacement or Signal(TIMES, PISTON), cylinders, None, ())
    return {one.code: one.fix for one in check_recording(recording, ambient) if one.level == 'warning'}


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


@pytest.mark.parametrize('size', [3, 10, 50])
def test_times_that_come_in_batches_are_reported(size):
    number = np.arange(TIMES.size)
    stamped = TIMES[np.minimum(number // size * size + size - 1, TIMES.size - 1)] + 1e-5 * (number % size)
    assert 'sample period' in fixes(displacement=Signal(stamped, PISTON))['times_suspect']


@pytest.mark.parametrize('kind', ['jitter', 'exponential jitter', 'missed samples', 'a pause'])
def test_times_that_only_jitter_are_not_batches(kind):
    rng = np.random.default_rng(4)
    times = {
        'jitter': TIMES + 4e-3 * rng.random(TIMES.size),
        'exponential jitter': np.cumsum(rng.exponential(0.01, TIMES.size)),
        'missed samples': TIMES[rng.random(TIMES.size) < 0.5],
        'a pause': TIMES + 300.0 * (TIMES > 5.0),
    }[kind]
    assert 'times_suspect' not in fixes(displacement=Signal(times, PISTON[: times.size]))


def test_the_unit_of_a_set_point_is_asked_for():
    found = fixes(setpoint=Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + 1e-3 * LEVEL]), 'kPa'))
    assert found == {'unit_suspect': 'check the unit of the set-point (it would be 70 kPa if recorded in MPa)'}


@pytest.mark.parametrize(('off', 'higher'), [(1.0, 'pressure'), (-1.0, 'set-point')])
def test_an_atmosphere_between_pressure_and_set_point_is_one_of_the_reference(off, higher):
    found = fixes(setpoint=Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL - off * AMBIENT_PRESSURE])))
    assert found['reference_suspect'].startswith(f'the {higher} may be absolute and is read as gauge, or the ')


@pytest.mark.parametrize(
    ('reference', 'fix'), [('gauge', 'pressure may be absolute'), ('absolute', 'set-point may be gauge')]
)
def test_what_a_mapping_says_tells_whose_reference_it_is(reference, fix):
    held = Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL]), 'kPa', reference)
    read = Signal(TIMES, held.values + AMBIENT_PRESSURE + 1e3 * np.cos(TIMES), 'kPa', reference)
    assert fixes(pressure=read, setpoint=held)['reference_suspect'].startswith(f'the {fix} and is read as')


def test_of_a_pressure_off_its_set_point_the_unit_is_named_in_which_it_is_at_it():
    in_psi = (AMBIENT_PRESSURE + LEVEL) / PSI
    read = Signal(TIMES, AMBIENT_PRESSURE + 1e3 * in_psi + np.cos(TIMES), 'kPa', 'gauge')
    held = Signal(TIMES[:1], np.array([AMBIENT_PRESSURE + LEVEL]), 'bar', 'gauge')
    assert fixes(pressure=read, setpoint=held)['setpoint_suspect'].endswith('(it is if the pressure is absolute psi)')


def test_that_unit_is_named_beside_a_set_point_that_steps_too():
    steps = np.where(TIMES < 6.0, LEVEL, 1.6 * LEVEL)
    read = Signal(TIMES, AMBIENT_PRESSURE + 0.1 * (AMBIENT_PRESSURE + steps), 'mbar', 'gauge')
    held = Signal(np.array([0.0, 6.0]), AMBIENT_PRESSURE + LEVEL * np.array([1.0, 1.6]), 'psi', 'gauge')
    assert fixes(pressure=read, setpoint=held)['setpoint_suspect'].endswith('(it is if the pressure is absolute kPa)')


MOVING = np.linspace(0.0, 10.0, 5001)
STROKES = 2e-3 * np.sin(5.0 * MOVING)


def moved_pressure(noise, by=5e3):
    """Return a pressure that follows the speed of `STROKES` [Pa]."""
    rng = np.random.default_rng(3)
    pressure = AMBIENT_PRESSURE + LEVEL - by * np.cos(5.0 * MOVING) + noise * rng.standard_normal(MOVING.size)
    return np.round(pressure / 50.0) * 50.0


def of_moving(pressure, displacement=STROKES):
    """Return what is warned of a pressure beside strokes, code and message."""
    signal = Signal(MOVING, pressure)
    recording = Recording(
        'made', 0, Signal(MOVING, displacement), {'cylinder_a': CylinderSignals(signal, None)}, None, ()
    )
    return [(one.code, one.message) for one in check_recording(recording, AMBIENT_PRESSURE) if one.level == 'warning']


@pytest.mark.parametrize('noise', [0.0, 20.0, 200.0])
def test_samples_that_leap_out_and_back_are_told(noise):
    pressure = moved_pressure(noise)
    assert of_moving(pressure) == []
    pressure[[1000, 3000, 3001]] = AMBIENT_PRESSURE  # a plug that comes loose
    message = 'cylinder_a pressure: 3 samples of 5,001 leap away and back, first at t = 2 s'
    assert of_moving(pressure) == [('samples_suspect', message)]
    displacement = STROKES.copy()
    displacement[700] = 0.05
    message = 'displacement: 1 sample of 5,001 leaps away and back, first at t = 1.4 s'
    assert of_moving(moved_pressure(noise), displacement) == [('samples_suspect', message)]


def test_a_pulse_that_falls_off_is_no_leap():
    pulse = np.where(MOVING > 5.0, 6e4 * np.exp(-(MOVING - 5.0) / 0.01), 0.0)
    assert of_moving(moved_pressure(20.0) + pulse) == []


@pytest.mark.parametrize('noise', [0.0, 20.0])
def test_a_pressure_that_holds_still_while_the_piston_moves_is_told(noise):
    pressure = moved_pressure(noise, by=4e4)
    ((code, message),) = of_moving(np.minimum(pressure, AMBIENT_PRESSURE + LEVEL + 2e3))
    assert code == 'samples_suspect'
    assert 'the pressure freezes, mostly at its highest value' in message
    stuck = pressure.copy()
    stuck[2000:3500] = stuck[2000]
    ((code, message),) = of_moving(stuck)
    assert code == 'samples_suspect'
    assert 'at the same value' in message


def test_a_pressure_that_holds_still_for_half_of_the_time_is_told_beside_what_is_left_of_its_strokes():
    pressure = moved_pressure(20.0) + 2e4 * np.clip(20.0 * (MOVING - 5.0), 0.0, 1.0)
    assert of_moving(pressure) == []
    ((code, message),) = of_moving(np.minimum(pressure, AMBIENT_PRESSURE + LEVEL + 3e3))
    assert (code, 'mostly at its highest value' in message) == ('samples_suspect', True)


def test_a_logger_that_hangs_for_most_of_the_time_is_told():
    pressure = moved_pressure(20.0)
    pressure[1000:] = pressure[1000]
    ((code, message),) = of_moving(pressure)
    assert (code, 'at the same value, in 80 %' in message) == ('samples_suspect', True)


def test_a_pressure_may_hold_still_while_the_piston_rests():
    rests = np.where(MOVING < 9.0, 0.0, STROKES)
    pressure = np.where(MOVING < 9.0, AMBIENT_PRESSURE + LEVEL, moved_pressure(0.0))
    assert of_moving(pressure, rests) == []


def test_a_pressure_may_hold_still_at_a_steady_speed():
    forwards = np.floor(MOVING / 0.5) % 2 == 0.0
    piston = 2e-3 * np.abs((MOVING % 1.0) - 0.5)
    target = np.where(forwards, -4e3, 4e3)
    pressure = np.zeros(MOVING.size)
    for index in range(1, MOVING.size):
        pressure[index] = pressure[index - 1] + 0.1 * (target[index] - pressure[index - 1])
    assert of_moving(AMBIENT_PRESSURE + LEVEL + np.round(pressure / 200.0) * 200.0, piston) == []


def test_with_a_coarse_sensor_a_pressure_may_hold_still():
    assert of_moving(np.round(moved_pressure(0.0) / 2e3) * 2e3) == []


def test_beside_steps_of_the_set_point_a_pressure_may_hold_still():
    steps = np.where(np.floor(MOVING / 2.0) % 2 == 0.0, 0.0, 2e5)
    assert of_moving(np.round((moved_pressure(20.0, by=500.0) + steps) / 1e3) * 1e3) == []


def test_a_sensor_that_answers_slower_than_it_is_asked_is_not_stuck():
    assert of_moving(np.repeat(moved_pressure(0.0, by=4e4)[::17], 17)[: MOVING.size]) == []


def test_a_piston_at_rest_may_flicker_by_one_count():
    flicker = np.full(MOVING.size, 5e-3)
    flicker[::300] = 5.1e-3
    pressure = 2e5 + 1e5 * np.clip(20.0 * (MOVING - 5.0), 0.0, 1.0) + np.round(20.0 * np.sin(50.0 * MOVING))
    assert of_moving(pressure, flicker) == []


def speeds(seed=2):
    """Return a displacement [m] of many speeds, and the pressure that follows its speed [Pa]."""
    rng = np.random.default_rng(seed)
    phases, rates = rng.uniform(0.0, 6.3, 6), rng.uniform(2.0, 12.0, 6)
    motion = sum(np.sin(rate * MOVING + phase) for rate, phase in zip(rates, phases))
    speed = sum(rate * np.cos(rate * MOVING + phase) for rate, phase in zip(rates, phases))
    return 1e-3 * motion, AMBIENT_PRESSURE + LEVEL - 500.0 * speed


@pytest.mark.parametrize(('share', 'noise'), [(15.0, 50.0), (15.0, 20.0), (25.0, 200.0)])
def test_a_pressure_that_is_clipped_at_both_ends_before_noise_comes_is_reported(share, noise):
    displacement, pressure = speeds()
    noisy = noise * np.random.default_rng(3).standard_normal(MOVING.size)
    assert of_moving(pressure + noisy, displacement) == []
    limits = np.percentile(pressure, (share, 100.0 - share))
    ((code, message),) = of_moving(np.clip(pressure, *limits) + noisy, displacement)
    assert code == 'samples_suspect'
    assert 'piles up at both ends of its range' in message


@pytest.mark.parametrize('noise', [20.0, 200.0])
def test_a_pressure_that_a_set_point_switches_to_and_fro_is_not_clipped(noise):
    displacement, follows = speeds()
    held = Signal(np.arange(0.0, 10.0, 2.0), AMBIENT_PRESSURE + LEVEL + 2e4 * (np.arange(5) % 2))
    steps = np.interp(MOVING % 4.0, [0.0, 0.3, 2.0, 2.3, 4.0], [1.0, 0.0, 0.0, 1.0, 1.0])
    pressure = AMBIENT_PRESSURE + LEVEL + 2e4 * steps + 1e-3 * (follows - AMBIENT_PRESSURE - LEVEL)
    read = Signal(MOVING, pressure + noise * np.random.default_rng(3).standard_normal(MOVING.size))
    cylinders = {'cylinder_a': CylinderSignals(read, held)}
    found = check_recording(Recording('made', 0, Signal(MOVING, displacement), cylinders, None, ()), AMBIENT_PRESSURE)
    assert [one.message for one in found if 'piles up' in one.message] == []


@pytest.mark.parametrize('noise', [20.0, 200.0, 1000.0])
def test_noise_of_a_set_point_is_reported(noise):
    levels = AMBIENT_PRESSURE + LEVEL + 1e4 * (np.floor(MOVING / 2.5) % 2)
    measured = levels + noise * np.random.default_rng(3).standard_normal(MOVING.size)
    read = Signal(MOVING, moved_pressure(20.0))
    found = fixes(Signal(MOVING, STROKES), read, Signal(MOVING, measured))
    assert found['setpoint_suspect'].startswith('record the commanded set-point instead of a measured set-point')
    assert fixes(Signal(MOVING, STROKES), read, Signal(MOVING[::1250], levels[::1250])) == {}


def test_a_controller_that_changes_its_set_point_at_each_sample_is_no_noise():
    rng = np.random.default_rng(3)
    commanded = AMBIENT_PRESSURE + LEVEL + 5e3 * np.sin(3.0 * MOVING) + 20.0 * rng.standard_normal(MOVING.size)
    assert fixes(Signal(MOVING, STROKES), Signal(MOVING, moved_pressure(20.0)), Signal(MOVING, commanded)) == {}


@pytest.mark.parametrize('step', [0.005, 0.01, 0.02])
def test_times_with_too_few_digits_are_reported(step):
    level = np.full(MOVING.size, AMBIENT_PRESSURE + LEVEL)
    for times, is_reported in ((np.floor(MOVING / step + 1e-9) * step, True), (MOVING, False)):
        read = Recording.from_arrays(times, STROKES, {'cylinder_a': moved_pressure(20.0)}, {'cylinder_a': level})
        codes = [one.code for one in check_recording(read, AMBIENT_PRESSURE)]
        assert codes == (['times_suspect'] if is_reported else [])
