# SPDX-License-Identifier: Apache-2.0
"""A change of the device is found and timed; a drift, wider strokes and few set-point steps are no change."""

from dataclasses import fields, replace

import numpy as np
import pytest
from drawn import experiments_of, recorded, recording_of
from reference import AMBIENT

from cfd_pneumatic.identification import Estimate, Options, identify
from cfd_pneumatic.identification.changes import Change, DeviceState, cut_of_curve, find_cut, find_drift, without_drift
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.recording import CylinderSignals
from cfd_pneumatic.reporting import report_data
from cfd_pneumatic.rig import Rig, RigParameters, Schedule, Sensors, out_and_back, surface_following, with_changes
from cfd_pneumatic.rig.bench import Bench
from cfd_pneumatic.rig.sensors import Readings
from cfd_pneumatic.units import PSI
from studies.panel import draw

CHANNEL = Pressure('cylinder_a', AMBIENT)
KINK = {'effects_a.line_resistance': 5e7}
"""A line that lets a fifth of the flow pass, as K_sv shows."""


def played(schedule: Schedule, changes=None, at=0.0, seed=0, name='played'):
    """Return cylinder A of the rig with full physics; from a time on [s] with changes."""
    parameters = RigParameters()
    rig = Rig(
        tuple(schedule.setpoints[0]), parameters, position=float(schedule.positions[0]), time=-schedule.sampling_period
    )
    bench = Bench(rig, schedule.sampling_period, Sensors(), seed)
    first = round(at / schedule.sampling_period)
    pieces = []
    for samples in (slice(0, first), slice(first, schedule.samples)):
        knots = slice(samples.start * schedule.knots_per_sample, samples.stop * schedule.knots_per_sample)
        if samples.stop > samples.start:
            pieces.append(
                bench.advance(schedule.positions[knots], schedule.velocities[knots], schedule.setpoints[samples])
            )
        if changes:
            bench.change(with_changes(parameters, changes))
    joined = {
        field.name: np.concatenate([getattr(piece, field.name) for piece in pieces]) for field in fields(Readings)
    }
    times, displacement = joined['times'], joined['displacement']
    return recorded(times, displacement, joined['setpoints'][:, 0], joined['pressures'][:, 0], name)


def surface(seed, duration=30.0):
    """Return a surface and set-points of a seed."""
    rng = np.random.default_rng(seed)
    return surface_following(
        rng.uniform(8.0, 12.0) * PSI,
        rng.uniform(0.7e-3, 1.6e-3),
        setpoint_steps=rng.uniform(1.5, 4.0) * PSI,
        duration=duration,
        seed=seed,
    )


def cut_of(recording):
    (experiment,) = experiments_of([recording])
    return find_cut(CHANNEL, experiment)


@pytest.mark.parametrize(('schedule', 'seeds'), [('out_and_back', range(20)), ('surface_following', range(10))])
def test_healthy_devices_do_not_change(schedule, seeds):
    assert [cut_of(recording_of(draw(None, schedule, seed))) for seed in seeds] == [None] * len(seeds)


def test_healthy_devices_of_full_physics_do_not_change():
    schedules = [surface(seed) for seed in range(3)]
    schedules += [out_and_back(setpoint * PSI, 2e-3, repeats=5) for setpoint in (6.0, 9.0)]
    assert [cut_of(played(schedule)) for schedule in schedules] == [None] * len(schedules)


def test_a_kinked_hose_is_found_and_timed():
    found = [cut_of(played(surface(seed), KINK, 13.0, seed)) for seed in range(4)]
    assert all(cut is not None and abs(cut.time - 13.0) < 0.5 for cut in found), found
    assert all(cut.low <= 13.0 <= cut.high for cut in found), found


def drifting(shape, total=5e3, duration=40.0):
    """Return a recording to whose pressure a drift was added [Pa]."""
    recording = played(surface(3, duration))
    signals = recording.cylinders['cylinder_a']
    share = signals.pressure.times / signals.pressure.times[-1]
    drift = total * {'linear': share, 'exponential': np.expm1(-share / 0.3) / np.expm1(-1.0 / 0.3)}[shape]
    pressure = replace(signals.pressure, values=signals.pressure.values + drift)
    return replace(recording, cylinders={'cylinder_a': replace(signals, pressure=pressure)})


@pytest.mark.parametrize('shape', ['linear', 'exponential'])
def test_a_slow_drift_is_no_change(shape):
    assert cut_of(drifting(shape)) is None


def test_a_bent_drift_is_found_and_removed():
    recording = drifting('exponential')
    (experiment,) = experiments_of([recording])
    drift = find_drift(CHANNEL, experiment)
    assert drift.total == pytest.approx(5e3, rel=0.15)
    share = experiment.sample_times / experiment.sample_times[-1]
    true = 5e3 * np.expm1(-share / 0.3) / np.expm1(-1.0 / 0.3)
    assert np.std(drift.values - true) < 0.1 * np.std(true)
    cleaned = without_drift(recording, drift).cylinders['cylinder_a'].pressure.values
    np.testing.assert_allclose(cleaned, experiment.measured - drift.values, atol=1.0)
    assert 'drifts slowly' in drift.text


def test_healthy_devices_and_changes_are_no_bent_drift():
    recordings = [played(surface(seed)) for seed in range(2)]
    recordings += [recording_of(draw(None, 'surface_following', 2)), played(surface(1), KINK, 13.0), drifting('linear')]
    found = [find_drift(CHANNEL, experiments_of([recording])[0]) for recording in recordings]
    assert found == [None] * len(found)


def test_wider_strokes_at_the_end_are_no_change():
    narrow = surface(4, 24.0)
    wide = np.where(np.arange(narrow.positions.size) > 0.75 * narrow.positions.size, 2.0, 1.0)
    smooth = np.convolve(wide, np.ones(1001) / 1001, 'same')
    schedule = replace(narrow, positions=narrow.positions * smooth, velocities=narrow.velocities * smooth)
    assert cut_of(played(schedule)) is None


def test_no_set_point_steps_at_the_end_are_no_change():
    schedule = surface(6, 24.0)
    levels = schedule.setpoints.copy()
    levels[len(levels) // 2 :] = levels[len(levels) // 2]
    quiet = replace(schedule, setpoints=levels)
    assert cut_of(played(quiet)) is None


def test_a_set_point_that_was_not_recorded_is_not_tested():
    recording = played(surface(0), KINK, 13.0)
    signals = recording.cylinders['cylinder_a']
    unknown = replace(recording, cylinders={'cylinder_a': CylinderSignals(signals.pressure, None)})
    assert cut_of(unknown) is None


def test_both_parts_are_identified_and_the_report_states_what_differs():
    found = identify([played(surface(1, 20.0), KINK, 9.0)], Options(close_loop=True))
    (change,) = found.changes
    assert abs(change.time - 9.0) < 0.5
    names = [difference.name for difference in change.differences]
    assert names[0] == 'k_sv'
    assert change.before.gains[1].value > 3.0 * change.after.gains[1].value
    assert 'the device changed at t = 9.0 s' in change.text
    assert 'k_sv fell from' in change.text
    (data,) = report_data(found)['changes']
    assert data['ci95_s'] == list(change.interval)
    assert data['differences'][0]['name'] == 'k_sv'
    assert {data['before']['verdict'], data['after']['verdict']} <= {'no_missing_effect', 'effect_added', 'unexplained'}
    assert sum(notice.code == 'changed_during_recording' for notice in found.notices) == 1
    assert found.recordings[0].displacement.times[0] >= change.interval[1]


def state(value, std, effects=()):
    gains = (Estimate('k_v', '1/s', value, std, (value - 2 * std, value + 2 * std), None),)
    return DeviceState(gains, 0.0, 1.0, effects, 'no_missing_effect', '', 50.0)


@pytest.mark.parametrize(
    ('before', 'after', 'text'),
    [
        (state(30.0, 0.1), state(10.0, 0.1), 'k_v fell from 30.0 to 10.0 1/s'),
        (state(30.0, 0.1), state(31.0, 0.1), 'the error of the model changed from 50.0 to 50.0 Pa'),
        (state(30.0, 9.0), state(10.0, 9.0), 'the error of the model changed'),
        (state(30.0, 0.1), state(30.0, 0.1, ('leakage',)), 'only after the change there is leakage'),
    ],
)
def test_a_difference_exceeds_its_standard_errors_and_errors_of_the_model(before, after, text):
    change = Change('cylinder_a', 'monday', 30.0, (29.0, 31.0), before, after)
    assert text in change.text
    assert 'changed at t = 30.0 s (95 %: 29.0 to 31.0 s)' in change.text


def test_a_curve_that_steps_shows_a_change_and_a_curve_that_creeps_does_not():
    times = np.linspace(0.0, 40.0, 41)
    cut = cut_of_curve(times, np.where(times < 15.5, 0.0, 100.0))
    assert cut.low <= 15.5 <= cut.high
    assert cut_of_curve(times, 100.0 * times) is None
    assert cut_of_curve(times, -np.expm1(-times / 10.0)) is None


def test_an_effect_that_explains_the_whole_recording_is_no_change():
    """Valves that saturate misfit the linear core in parts of a surface, as if the device had changed."""
    drawn = recording_of(draw('flow_saturation', 'surface_following', 1000))
    (experiment,) = experiments_of([drawn])
    assert find_cut(CHANNEL, experiment) is not None, 'the linear core alone suggests a change'
    found = identify([drawn], Options(close_loop=True))
    assert not found.changes
    assert found.cylinders['cylinder_a'].findings.effects == ('flow_saturation',)
