# SPDX-License-Identifier: Apache-2.0
"""A logger that paused: nothing is known of the piston meanwhile, and the model starts anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.recording import Recording, recording_of
from cfd_pneumatic.recording.gaps import split_at_gaps
from cfd_pneumatic.rig import device_named, record, surface_following


def made(times):
    times = np.asarray(times, float)
    return Recording.from_arrays(
        times,
        1e-3 * np.sin(times),
        {'cylinder_a': 2e5 + times},
        {'cylinder_a': np.where(times < 5.0, 1e5, 2e5)},
        name='run',
    )


def paused(recording, begin, end):
    """Return a recording without what lies between two times [s]; set-points that were sent meanwhile stay."""

    def cut(signal):
        kept = (signal.times < begin) | (signal.times >= end)
        return replace(signal, times=signal.times[kept], values=signal.values[kept])

    cylinders = {name: replace(one, pressure=cut(one.pressure)) for name, one in recording.cylinders.items()}
    return replace(recording, displacement=cut(recording.displacement), cylinders=cylinders, force=cut(recording.force))


STEADY = np.arange(0.0, 10.0, 0.01)


@pytest.mark.parametrize(
    'times',
    [
        STEADY,
        STEADY[(STEADY < 4.0) | (STEADY > 4.35)],
        np.arange(0.0, 100.0, 1.0),
        STEADY[::7] + 0.001 * np.sin(STEADY[::7]),
    ],
)
def test_a_recording_without_gaps_is_itself(times):
    recording = made(times)
    assert split_at_gaps(recording) == [recording]


def test_each_piece_is_a_recording_with_the_set_point_that_acts():
    first, second, third = split_at_gaps(
        made(STEADY[(STEADY < 3.0) | ((STEADY > 4.0) & (STEADY < 6.0)) | (STEADY > 7.0)])
    )
    assert [one.name for one in (first, second, third)] == ['run', 'run from 4.01 s', 'run from 7.01 s']
    assert first.displacement.times[-1] == pytest.approx(2.99)
    assert second.displacement.times[[0, -1]] == pytest.approx([4.01, 5.99])
    assert second.cylinders['cylinder_a'].setpoint.values.tolist() == [1e5, 2e5]
    assert third.cylinders['cylinder_a'].setpoint.values.tolist() == [2e5]
    assert any(
        '2 gaps of up to 1.02 s: the parts between the gaps are used as separate recordings' in note
        for note in first.health
    )


def test_what_is_too_short_to_tell_anything_is_left_out():
    whole = made(STEADY[(STEADY < 3.0) | ((STEADY > 4.0) & (STEADY < 4.5)) | (STEADY > 6.0)])
    assert [one.name for one in split_at_gaps(whole)] == ['run', 'run from 6.01 s']


def test_a_piston_at_rest_has_no_gaps():
    resting = replace(made(STEADY[(STEADY < 3.0) | (STEADY > 6.0)]), rests=True)
    assert split_at_gaps(resting) == [resting]


@pytest.mark.parametrize(('faults', 'effects'), [('', ()), ('effects_a.leak_conductance=1e-10', ('leakage',))])
def test_a_pause_is_not_judged(faults, effects):
    whole = recording_of(record(surface_following(duration=20.0, seed=4), device_named('paper', faults), seed=4))
    found = identify([paused(whole, 8.0, 13.0)], Options(close_loop=True))
    assert len(found.recordings) == 2
    assert found.cylinders['cylinder_a'].findings.effects == effects
    assert found.cylinders['cylinder_b'].findings.verdict == 'no_missing_effect'


def noisy(seed=5):
    """Return a recording of both cylinders and the force, with noise on each."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 10.0, 0.002)
    motion = 2e-3 * np.sin(3.0 * times)
    pressures = {
        name: 2e5 + 1e4 * motion / 1e-3 + rng.normal(0.0, 50.0, times.size) for name in ('cylinder_a', 'cylinder_b')
    }
    force = 20.0 + rng.normal(0.0, 0.1, times.size)
    return times, motion + rng.normal(0.0, 1e-6, times.size), pressures, force


def test_a_logger_that_repeats_its_last_row_has_a_gap():
    times, motion, pressures, force = noisy()
    held = slice(3000, 4000)
    for values in (motion, *pressures.values(), force):
        values[held] = values[held.start]
    first, second = split_at_gaps(Recording.from_arrays(times, motion, pressures, force=force, name='run'))
    assert first.displacement.times[-1] == pytest.approx(times[held.start])
    assert second.displacement.times[0] == pytest.approx(times[held.stop], abs=0.003)
    assert 'all signals repeat their last sample' in first.health[0]


def test_a_piston_that_rests_has_no_gap():
    times, motion, pressures, force = noisy()
    motion[3000:4000] = motion[3000]
    (only,) = split_at_gaps(Recording.from_arrays(times, motion, pressures, force=force))
    assert len(only.displacement) == times.size


def test_a_force_is_not_judged_where_a_pressure_paused():
    times, motion, pressures, force = noisy()
    recording = Recording.from_arrays(times, motion, pressures, force=force)
    paused_a = paused(recording, 4.0, 6.0).cylinders['cylinder_a']
    (only,) = split_at_gaps(replace(recording, cylinders={**recording.cylinders, 'cylinder_a': paused_a}))
    assert len(only.displacement) == times.size
    assert not np.any((only.force.times > 4.0) & (only.force.times < 5.99))
    assert len(only.cylinders['cylinder_b'].pressure) == times.size
