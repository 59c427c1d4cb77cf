# SPDX-License-Identifier: Apache-2.0
"""Recordings of a user's own arrays, and parts of recordings."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import Recording, read_recording, write_recording

TIMES = np.linspace(5.0, 7.0, 1001)
DISPLACEMENT = 1e-3 * np.sin(TIMES)
PRESSURE = 1.5e5 + 1e3 * TIMES
SETPOINT = np.where(TIMES < 6.0, 1.5e5, 1.7e5)


def made(**changes):
    given = {
        'times': TIMES,
        'displacement': DISPLACEMENT,
        'pressures': {'cylinder_a': PRESSURE},
        'setpoints': {'cylinder_a': SETPOINT},
        'force': 2.0 * TIMES,
    }
    return Recording.from_arrays(**{**given, **changes})


def test_arrays_become_signals():
    found = made(name='mine')
    assert (found.name, found.epoch, found.health, found.rests) == ('mine', 5 * 10**9, (), False)
    np.testing.assert_allclose(found.displacement.times, TIMES - 5.0, atol=1e-9)
    np.testing.assert_array_equal(found.displacement.values, DISPLACEMENT)
    np.testing.assert_array_equal(found.cylinders['cylinder_a'].pressure.values, PRESSURE)
    np.testing.assert_allclose(found.cylinders['cylinder_a'].setpoint.times, [0.0, 1.0], atol=1e-9)
    np.testing.assert_array_equal(found.cylinders['cylinder_a'].setpoint.values, [1.5e5, 1.7e5])
    np.testing.assert_array_equal(found.force.values, 2.0 * TIMES)


def test_what_the_user_has_stays_as_it_is():
    given = [array.copy() for array in (TIMES, DISPLACEMENT, PRESSURE, SETPOINT)]
    found = made()
    found.displacement.values[:] = 7.0
    for array, before in zip((TIMES, DISPLACEMENT, PRESSURE, SETPOINT), given):
        np.testing.assert_array_equal(array, before)


def test_times_may_be_dates_and_lists_do_as_well():
    dates = np.datetime64('2024-05-01T12:00:00') + np.array([0, 2, 4], 'timedelta64[ms]')
    found = made(
        times=dates, displacement=[0, 1, 2], pressures={'cylinder_b': [1e5, 2e5, 3e5]}, setpoints={}, force=None
    )
    assert found.epoch == 1_714_564_800 * 10**9
    np.testing.assert_allclose(found.displacement.times, [0.0, 2e-3, 4e-3])
    assert found.displacement.values.tolist() == [0.0, 1.0, 2.0]


AWARE = timezone(timedelta(hours=2))
DATES = {
    'durations of NumPy': (np.array([0, 250, 500], 'timedelta64[ms]'), 0),
    'durations of NumPy in ns': (np.array([0, 250_000_000, 500_000_000], 'timedelta64[ns]'), 0),
    'durations of Python': ([timedelta(seconds=0.25 * step) for step in range(3)], 0),
    'dates of Python': (
        [datetime(2024, 5, 1, 12) + timedelta(seconds=0.25 * step) for step in range(3)],
        1_714_564_800,
    ),
    'dates of Python with a zone': (
        [datetime(2024, 5, 1, 14, tzinfo=AWARE) + timedelta(seconds=0.25 * step) for step in range(3)],
        1_714_564_800,
    ),
    'texts': (['2024-05-01T12:00:00', '2024-05-01 12:00:00.25', '2024-05-01T12:00:00.500'], 1_714_564_800),
    'texts with a zone': (
        ['2024-05-01T14:00:00+02:00', '2024-05-01T12:00:00.25Z', '2024-05-01T12:00:00.5'],
        1_714_564_800,
    ),
    'texts of numbers': (['5.0', '5.25', '5.5'], 5),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(('times', 'epoch'), DATES.values(), ids=DATES.keys())
def test_times_may_be_dates_durations_and_texts(times, epoch):
    found = Recording.from_arrays(times, [0.0, 1.0, 2.0], {'cylinder_a': [1e5, 2e5, 3e5]})
    assert found.epoch == epoch * 10**9
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.25, 0.5])


@pytest.mark.parametrize('kind', [float, int])
def test_masked_values_are_left_out_as_nan_is(kind):
    displacement = np.ma.masked_array(np.arange(1001), np.arange(1001) > 900, dtype=kind)
    found = made(displacement=displacement)
    assert len(found.displacement) == 901
    assert 'displacement: dropped 100 samples not finite' in found.health


def test_a_set_point_may_be_one_number_and_a_piston_may_rest():
    found = made(setpoints={'cylinder_a': 1.5e5}, displacement=None)
    assert found.cylinders['cylinder_a'].setpoint.values.tolist() == [1.5e5]
    assert found.rests
    assert not found.displacement.values.any()


def test_it_is_cleaned_as_files_are():
    displacement = DISPLACEMENT.copy()
    displacement[[10, 20]] = np.nan, np.inf
    times = TIMES.copy()
    times[[30, 31]] = times[[31, 30]]
    found = made(times=times, displacement=displacement)
    assert len(found.displacement) == 999
    assert 'displacement: dropped 2 samples not finite' in found.health
    assert any('out of order' in note for note in found.health)
    assert np.all(np.diff(found.displacement.times) > 0.0)


def test_it_is_written_and_read_as_it_is(tmp_path):
    write_recording(tmp_path / 'bag', made())
    read = read_recording(tmp_path / 'bag')
    np.testing.assert_allclose(read.displacement.values, DISPLACEMENT)
    np.testing.assert_allclose(read.displacement.times, TIMES - 5.0, atol=1e-9)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'times': TIMES[:5]}, 'displacement has the shape (1001,): give one value for each of the 5 times'),
        ({'times': 1.0}, 'times have the shape ()'),
        ({'times': ['a', 'b']}, 'times holds something that is no number'),
        ({'times': np.full(1001, np.nan)}, 'a time is not finite'),
        ({'times': 1e12 * TIMES}, 'far too large'),
        ({'times': np.full(1001, 'NaT', 'datetime64[ns]')}, 'a time is no date (NaT)'),
        ({'times': np.ma.masked_less(TIMES, 5.5)}, 'a time is not finite'),
        (
            {'times': (TIMES + 1.7e9).astype('float32')},
            'times are float32, which holds them to 128 s only: give float64',
        ),
        ({'times': np.datetime64('9999-01-01', 's') + np.arange(1001)}, 'a date is far too late'),
        ({'times': [[1.0], [1.0, 2.0]]}, 'times cannot be made an array'),
        ({'displacement': DISPLACEMENT + 0j}, 'displacement is complex: give an array of real numbers'),
        ({'pressures': PRESSURE}, 'pressures must be a dictionary such as pressures={"cylinder_a": ...}, not ndarray'),
        ({'pressures': None}, 'pressures must be a dictionary such as pressures={"cylinder_a": ...}, not None'),
        ({'setpoints': 1.5e5}, 'setpoints must be a dictionary such as setpoints={"cylinder_a": ...}, not float'),
        ({'setpoints': {'cylinder_a': None}}, 'the set-point of cylinder_a is None: leave cylinder_a out of setpoints'),
        ({'name': 5}, 'name must be a text, not int'),
        ({'displacement': np.full(1001, np.nan)}, 'displacement holds no finite number'),
        ({'displacement': 1.0}, 'displacement has the shape ()'),
        ({'pressures': {}}, 'no pressure: give'),
        ({'pressures': {'a': PRESSURE}}, "'a' is no cylinder"),
        ({'pressures': {'cylinder_b': PRESSURE}}, 'cylinder_a has a set-point and no pressure'),
        ({'pressures': {'cylinder_a': np.stack([PRESSURE, PRESSURE])}}, 'has the shape (2, 1001)'),
        ({'force': ['x'] * 1001}, 'force holds something that is no number'),
    ],
)
def test_what_is_no_recording_is_refused(changes, message):
    with pytest.raises(InputError) as caught:
        made(**changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ('begin', 'end', 'first', 'last'), [(0.5, 1.5, 0.5, 1.5), (None, 1.0, 0.0, 1.0), (1.2, None, 1.2, 2.0)]
)
def test_a_part_is_between_two_times_after_the_first_sample(begin, end, first, last):
    part = made().part(begin, end)
    assert part.displacement.times[0] == pytest.approx(first, abs=2e-3)
    assert part.displacement.times[-1] == pytest.approx(last, abs=2.1e-3)
    assert part.cylinders['cylinder_a'].setpoint.values[0] == (1.7e5 if first > 1.0 else 1.5e5)


@pytest.mark.parametrize(
    ('begin', 'end'), [(-1.0, None), (2.5, None), (None, 2.5), (1.0, 1.0), (1.5, 0.5), (None, 0.0), (np.nan, None)]
)
def test_a_part_outside_of_the_recording_is_refused(begin, end):
    with pytest.raises(InputError, match='is not within its 2 s'):
        made().part(begin, end)


def test_a_part_is_between_numbers():
    with pytest.raises(InputError, match='begin must be a number, not str'):
        made().part('1', '2')
