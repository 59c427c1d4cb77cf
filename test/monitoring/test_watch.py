# SPDX-License-Identifier: Apache-2.0
"""The watch beside the rig: what is an alarm, what is a fault of the feed, and what is neither."""

from __future__ import annotations

import numpy as np
import pytest
from patrolled import EPOCH, LEARNED, SETTINGS, Patrol, Sample, Spoil, close_loop, learned

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.monitoring import Finding, describe_departure, describe_diagnosis
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.rig import Sensors

SECOND = 1_000_000_000


def test_a_healthy_device_gives_no_alarm_and_a_leak_is_named_with_its_size() -> None:
    findings: list[Finding] = []

    def close_loop_twice(recording: Recording) -> Finding:
        findings.append(close_loop(recording) if len(findings) < 2 else findings[-1])
        return findings[-1]

    patrol = Patrol(close_loop_twice).go_on(LEARNED + 15.0)
    watch = patrol.watch
    assert (watch.learned_share, watch.alarms, patrol.faults) == (1.0, {}, [])
    assert len(patrol.asked) == 1, 'the loop is closed on the healthy device, to tell what is new later'
    noise = Sensors().pressure_noise
    for name in CYLINDERS:
        residuals = np.array([value for channel, _, value in patrol.residuals if channel == name])
        assert np.std(residuals[500:]) == pytest.approx(noise, rel=0.1)
    patrol.let(leak_conductance=1e-10).go_on(2.0)
    assert describe_diagnosis(watch.alarms['cylinder_a']) == 'the diagnosis is running'
    assert not watch.is_confirmed(watch.alarms['cylinder_a'])
    patrol.go_on(14.0)
    alarm = watch.alarms['cylinder_a']
    assert watch.is_confirmed(alarm)
    departure = watch.departure('cylinder_a')
    assert departure.is_mean_shift
    assert departure.shift < -300.0
    assert (alarm.since - EPOCH) / SECOND == pytest.approx(LEARNED + 15.0, abs=1.0)
    assert describe_departure(departure).startswith('cylinder A loses ')
    assert 'looks like leakage (conductance ' in describe_diagnosis(alarm)
    assert 'cylinder_b' not in watch.alarms
    assert describe_diagnosis(watch.alarms[CONTACT_FORCE], follows=True) == 'follows from the pressures'
    patrol.let(leak_conductance=0.0).go_on(SETTINGS.window + 3.0)
    assert watch.alarms == {}, 'it ends when nothing rings any more'


def test_while_nothing_moves_the_words_say_at_rest() -> None:
    patrol = learned()
    held: list[Sample] = []

    def resting(sample: Sample) -> Sample:
        held.append(sample)
        rng = np.random.default_rng(sample.stamp % 2**32)
        lost = (held[0].setpoints[0] - 1200.0, held[0].setpoints[1])
        pressures = tuple(level + 52.0 * rng.standard_normal() for level in lost)
        return held[0]._replace(stamp=sample.stamp, pressures=pressures, force=sample.force)

    patrol.go_on(4.0, resting)
    assert (
        describe_departure(patrol.watch.departure('cylinder_a'))
        == 'cylinder A loses 1.2 kPa more than its model at rest'
    )


def test_a_sensor_that_lags_is_told_by_its_energy() -> None:
    patrol = learned().let(sensor_lag=1e-3).go_on(3.0)
    departure = patrol.watch.departure('cylinder_a')
    assert not departure.is_mean_shift
    assert describe_departure(departure).startswith('cylinder A deviates from its model by ')


def silent(sample: Sample) -> None:
    return None


def stuck_pressure(sample: Sample) -> Sample:
    return sample._replace(pressures=(AMBIENT_PRESSURE + 7e4, sample.pressures[1]))


def stuck_piston(sample: Sample) -> Sample:
    return sample._replace(position=1e-4)


def stuck_force(sample: Sample) -> Sample:
    return sample._replace(force=12.5)


def ahead(sample: Sample) -> Sample:
    return sample._replace(stamp=sample.stamp + 3600 * SECOND)


def back(sample: Sample) -> Sample:
    return sample._replace(stamp=sample.stamp - 3600 * SECOND)


@pytest.mark.parametrize(
    ('spoil', 'kind', 'words'),
    [
        (silent, 'silent', 'piston_state has been silent for '),
        (stuck_pressure, 'stuck', f'cylinder_a/pressure is stuck at {AMBIENT_PRESSURE + 7e4:.6g} Pa'),
        (stuck_piston, 'stuck', 'piston_state is stuck at 0.0001 m while the pressures move'),
        (stuck_force, 'stuck', 'measured_force is stuck at 12.5 N'),
        (ahead, 'clock', 'the clock of piston_state jumped ahead by 3.6e+03 s'),
        (back, 'clock', 'the clock of piston_state jumped back by 3.6e+03 s'),
    ],
)
def test_a_fault_of_the_feed_is_named_as_such_and_the_test_begins_anew_behind_it(
    spoil: Spoil, kind: str, words: str
) -> None:
    patrol = learned()
    patrol.go_on(4.0, spoil)
    assert kind in patrol.kinds
    assert any(message.startswith(words) for message in patrol.faults), patrol.faults
    settled = spoil if kind == 'clock' else lambda sample: sample
    patrol.go_on(12.0, settled)
    assert patrol.watch.faults(patrol.now) == []
    assert patrol.watch.alarms == {}
    assert all(channel.baseline is not None for channel in patrol.watch.signals().values())
    patrol.let(leak_conductance=1e-10).go_on(3.0, settled)
    assert 'cylinder_a' in patrol.watch.alarms, 'it watches again'


def test_an_alarm_ends_where_its_topic_falls_silent_and_comes_back_with_another_clock() -> None:
    watch = learned().let(leak_conductance=1e-10).go_on(3.0).watch
    assert 'cylinder_a' in watch.alarms
    later = SETTINGS.timeout + 1.0
    now = LEARNED + 3.0 + later
    assert 'silent' in {fault.kind for fault in watch.faults(now)}
    watch.add_measurement('cylinder_a', watch.latest_stamp + 3600 * SECOND, 2e5, now)
    assert all(watch.departure(name) for name in watch.alarms)
    assert 'cylinder_a' not in watch.alarms


def test_a_diagnosis_of_a_broken_feed_names_nothing() -> None:
    patrol = Patrol(close_loop).go_on(LEARNED)
    patrol.go_on(20.0, stuck_pressure)
    assert all(alarm.new_findings is None for name, alarm in patrol.watch.alarms.items() if name != CONTACT_FORCE)
    assert 'cylinder_a' not in patrol.watch.alarms


def test_measurements_between_the_piston_s_samples_are_compared_with_what_lies_between() -> None:
    watch = Patrol().watch
    predicted, residuals = [], []
    for index in range(10):
        stamp, now = EPOCH + index * 2_000_000, index * 2e-3
        watch.add_measurement('cylinder_a', stamp - 1_000_000, 0.0, now)
        predicted.append(watch.add_piston_sample(stamp, 1e-5 * index, (2e5, 1.5e5), now).values[0])
        residuals += [residual.value for residual in watch.new_residuals(now)]
    between = 0.5 * (np.array(predicted[1:]) + predicted[:-1])
    assert np.ptp(between) > 10.0
    assert residuals == pytest.approx(-between)


def test_a_topic_that_is_not_there_is_missing_and_a_force_need_not_be() -> None:
    patrol = Patrol()
    patrol.go_on(0.1, silent)
    assert patrol.watch.missing_topics() == ['piston_state', 'cylinder_a/pressure', 'cylinder_b/pressure']
    patrol.go_on(0.1)
    assert patrol.watch.missing_topics() == []


def test_where_the_loop_knows_nothing_the_words_say_so() -> None:
    patrol = Patrol(lambda recording: Finding({}, 'the piston does not move')).go_on(LEARNED)
    patrol.let(leak_conductance=1e-10).go_on(8.0)
    assert describe_diagnosis(patrol.watch.alarms['cylinder_a']) == (
        'the cause is not determined (the piston does not move)'
    )


def test_the_healthy_device_is_diagnosed_again_later_if_the_process_was_ended() -> None:
    ends = iter([True, False, False])
    patrol = Patrol(lambda recording: Finding({}, ended_early=next(ends))).go_on(LEARNED)
    assert len(patrol.asked) == 1
    patrol.go_on(10.0)
    assert len(patrol.asked) == 2
    patrol.go_on(10.0)
    assert len(patrol.asked) == 2


def test_a_displacement_that_rests_and_one_that_is_stuck_are_told_apart_also_after_rests() -> None:
    patrol = Patrol()
    held: list[Sample] = []

    def resting(sample: Sample) -> Sample:
        held.append(sample)
        noise = 52.0 * np.random.default_rng(sample.stamp % 2**32).standard_normal(2)
        pressures = tuple((noise + sample.setpoints).tolist())
        return held[0]._replace(stamp=sample.stamp, setpoints=sample.setpoints, pressures=pressures, force=sample.force)

    patrol.go_on(4.0).go_on(2.0, resting).go_on(LEARNED)
    held.clear()
    patrol.go_on(8.0, resting)
    assert patrol.kinds == set()
    patrol.go_on(8.0, stuck_piston)
    assert patrol.kinds == {'stuck'}
    assert any('piston_state is stuck' in message for message in patrol.faults)
