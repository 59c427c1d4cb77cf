# SPDX-License-Identifier: Apache-2.0
"""Waves of the displacement: the sensor's are left out, the piston's stay, and the pressure tells which they are."""

from dataclasses import replace

import numpy as np
import pytest
from measured import MAPPING, ROOT, needs_measured_data

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.data.motion import observed_motion
from cfd_pneumatic.identification.input_checks.sensor_ripple import ripple_of
from cfd_pneumatic.recording import read_mapping, read_recording, recording_of
from cfd_pneumatic.rig import SetPoints, device_named, lay_out, out_and_back, paper_step, record, surface_following

STROKE, PERIOD = 8e-3, 5.0  # of going out and back [m, s]
SIZE, PITCH = 2e-5, 1.1e-3  # of the waves [m]
SHARPNESS = 0.999  # of the turns; 1: at once


def even(times):
    """Return positions and velocities of a piston that goes out and back evenly, from rest on."""
    angle = 2.0 * np.pi * times / PERIOD - 0.5 * np.pi
    place, speed = SHARPNESS * np.sin(angle), SHARPNESS * np.cos(angle) * 2.0 * np.pi / PERIOD
    return STROKE / np.pi * np.arcsin(place), STROKE / np.pi * speed / np.sqrt(1.0 - place**2)


def waving(times):
    """Return the same of a piston whose drive waves as it goes."""
    place, speed = even(times)
    phase = 2.0 * np.pi * place / PITCH
    return place + SIZE * np.sin(phase), speed * (1.0 + SIZE * 2.0 * np.pi / PITCH * np.cos(phase))


def recorded(motion, faults='', seed=11):
    """Return what one cylinder and the displacement's sensor say of a device of full physics."""
    schedule = lay_out('even', motion, [SetPoints(0.0, 7e4, 5e4)], 15_000, 2e-3)
    one = recording_of(record(schedule, device_named('real', faults), seed=seed))
    return replace(one, cylinders={'cylinder_a': one.cylinders['cylinder_a']}, force=None)


def as_a_swaying_target_has_it(one):
    signal = one.displacement
    values = signal.values + SIZE * np.sin(2.0 * np.pi * signal.values / PITCH)
    return replace(one, displacement=replace(signal, values=values))


def identified(one):
    """Return what is said of waves, the conclusion and the error on the test part."""
    found = identify([one], Options(close_loop=True))
    result = found.channels['cylinder_a']
    told = [notice for notice in found.notices if notice.code == 'waves_left_out']
    return told, result.conclusion, result.after['test'].rmse


def test_waves_of_the_sensor_are_left_out_and_said():
    clean = recorded(even)
    said, of_clean, least = identified(clean)
    assert said == []
    (told,), conclusion, error = identified(as_a_swaying_target_has_it(clean))
    assert told.level == 'note'
    assert told.message.startswith('the displacement has sensor ripple of 0.013 mm in even motion, of which')
    assert of_clean.verdict == conclusion.verdict == 'no_missing_effect'
    assert error == pytest.approx(least, rel=0.03)


@pytest.mark.parametrize('faults', ['', 'pickup.displacement_delay=0.05', 'effects_a.sensor_lag=0.02'])
def test_waves_of_the_piston_stay(faults):
    one = recorded(waving, faults)
    assert ripple_of(one, observed_motion(one)[0]) is not None
    told, *_ = identified(one)
    assert told == []


def test_what_was_recorded_stays_as_it_is():
    one = as_a_swaying_target_has_it(recorded(even))
    (kept,) = identify([one], Options()).recordings
    assert kept is one


@pytest.mark.parametrize('schedule', [out_and_back(), paper_step(), surface_following(duration=10.0, seed=1)])
def test_what_never_moves_evenly_for_long_has_no_waves(schedule):
    one = recording_of(record(schedule, device_named('real', ''), seed=1))
    assert ripple_of(one, observed_motion(one)[0]) is None


def test_a_piston_that_rests_most_of_the_time_does_not_move_evenly():
    times = np.arange(5_000) * 2e-3
    one = recorded(even)
    moved = np.interp(times % 4.0, [0.0, 1.9, 2.0, 3.9, 4.0], [0.0, 0.0, STROKE, STROKE, 0.0])
    still = replace(one, displacement=replace(one.displacement, times=times, values=moved))
    assert ripple_of(still, observed_motion(still)[0]) is None


def test_waves_are_told_from_even_motion():
    one = as_a_swaying_target_has_it(recorded(even))
    waves = ripple_of(one, observed_motion(one)[0])
    assert waves.size == pytest.approx(SIZE / np.sqrt(2.0), rel=0.1)  # they fade in and out
    times, moved = waves.without.displacement.times, waves.without.displacement.values
    inside = np.any([(begin <= times) & (times <= end) for begin, end in waves.spans], axis=0)
    left = moved[inside] - even(times[inside])[0]
    assert inside.mean() > 0.6
    assert np.std(left) < 0.1 * SIZE


@needs_measured_data
@pytest.mark.parametrize(('run', 'followed'), [('rerun/2_O-ring257_7bar', ' 2%'), ('friction/O-ring257_3bar', ' 5%')])
def test_a_measured_cylinder_does_not_follow_its_laser(run, followed):
    one = replace(read_recording(ROOT / f'{run}.csv', mapping=read_mapping(MAPPING)), force=None)
    (told,) = (notice for notice in identify([one], Options()).notices if notice.code == 'waves_left_out')
    assert f'of which the pressures follow{followed}.' in told.message
