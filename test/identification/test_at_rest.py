# SPDX-License-Identifier: Apache-2.0
"""Recordings without displacement: a piston at rest, whose set-points change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.recording import Signal, recording_of
from cfd_pneumatic.rig import SetPoints, device_named, lay_out, record, surface_following

PERIOD = 2e-3  # [s]
HELD = 1.0  # for which a set-point is held [s]
STEPS = 24


def still(times):
    return np.zeros(times.size), np.zeros(times.size)


@pytest.fixture(scope='module')
def steps():
    """Return steps of both set-points, by chance."""
    levels = np.random.default_rng(5).uniform([30e3, 20e3], [60e3, 50e3], (STEPS, 2)).tolist()
    changes = [SetPoints(HELD * rank, *both) for rank, both in enumerate(levels)]
    return lay_out('steps', still, changes, round(STEPS * HELD / PERIOD), PERIOD)


def at_rest(schedule, faults=''):
    """Return what is recorded of the paper's device, without its displacement."""
    recording = recording_of(record(schedule, device_named('paper', faults), seed=3))
    displacement = Signal(recording.displacement.times, np.zeros(len(recording.displacement)))
    cylinders = {'cylinder_a': recording.cylinders['cylinder_a']}
    return replace(recording, displacement=displacement, cylinders=cylinders, force=None, rests=True)


@pytest.mark.parametrize(
    ('faults', 'effects'),
    [('', ()), ('effects_a.dead_band=600', ('valve_dead_band',)), ('effects_a.leak_conductance=2e-10', ('leakage',))],
)
def test_steps_of_the_set_point_tell_all_but_the_velocity_gain(steps, faults, effects):
    result = identify([at_rest(steps, faults)], Options(close_loop=True))
    assert [one.code for one in result.notices if one.code == 'displacement_assumed']
    cylinder = result.cylinders['cylinder_a']
    k_x, *gains = cylinder.gains
    assert not k_x.identifiable
    assert cylinder.findings.effects == effects
    assert 'displacement_delay' in cylinder.findings.not_visible
    for estimate, truth in zip(gains, (60.0, 29.0, 9.6e-3)):
        assert estimate.identifiable
        assert estimate.value == pytest.approx(truth, rel=0.03)


def test_a_displacement_that_is_recorded_and_does_not_move_may_be_an_unplugged_sensor(steps):
    recording = at_rest(steps)
    noisy = 1e-7 * np.random.default_rng(1).normal(size=len(recording.displacement))
    recorded = replace(recording, displacement=Signal(recording.displacement.times, noisy), rests=False)
    with pytest.raises(InputError, match=r'does not move .* leave the displacement out of the mapping'):
        identify([recorded])


def test_without_steps_nothing_is_told(steps):
    held = replace(steps, setpoints=np.full_like(steps.setpoints, 4e4))
    with pytest.raises(InputError, match='no displacement was recorded, and no set-point changes'):
        identify([at_rest(held)])


def test_a_motion_that_was_not_recorded_is_no_verdict(steps):
    recording = recording_of(record(surface_following(duration=6.0), device_named('paper'), seed=1))
    cylinders = {
        name: replace(own, setpoint=Signal(np.array([0.0, 3.0]), own.setpoint.values[0] + np.array([0.0, 1e3])))
        for name, own in recording.cylinders.items()
    }
    unmoved = replace(
        recording,
        displacement=Signal(recording.displacement.times, np.zeros(len(recording.displacement))),
        cylinders=cylinders,
        rests=True,
    )
    try:
        result = identify([unmoved], Options(close_loop=True))
    except InputError:
        return
    assert all(one.findings.verdict == 'unexplained' for one in result.cylinders.values())


def test_a_pressure_at_rest_that_does_not_follow_its_set_point_is_told(steps):
    recording = at_rest(steps)
    own = recording.cylinders['cylinder_a']
    noise = 50.0 * np.random.default_rng(1).normal(size=len(own.pressure))
    alone = replace(own, pressure=Signal(own.pressure.times, 1.4e5 + noise))
    with pytest.raises(InputError, match='the piston rests, and the pressure does not follow the set-point') as caught:
        identify([replace(recording, cylinders={'cylinder_a': alone})])
    assert 'let it move' not in str(caught.value)
