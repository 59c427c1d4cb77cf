# SPDX-License-Identifier: Apache-2.0
"""Topics that fall silent, clocks that jump, sensors that are stuck; and sensors that only look like it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.monitoring.feed import Fault, SensorMonitor, StampMonitor

SECOND = 1_000_000_000
PERIOD = SECOND // 500


def faults_of(sensor: SensorMonitor, values: np.ndarray, expected: np.ndarray | None = None) -> list[Fault]:
    """Return what is wrong with values, a hundred to a block."""
    found = []
    for index, value in enumerate(values.tolist()):
        found.append(sensor.check(value, None if expected is None else float(expected[index])))
        if index % 100 == 99:
            found.append(sensor.close_block())
    return [fault for fault in found if fault is not None]


def rounded(values: np.ndarray, step: float) -> np.ndarray:
    return step * np.rint(values / step)


def taught(step: float, noise: float = 50.0, motion: float = 0.0) -> tuple[SensorMonitor, np.random.Generator]:
    """Return a sensor that has learned from a signal that moves or rests."""
    rng = np.random.default_rng(1)
    truth = 2e5 + motion * np.sin(np.arange(20_000) / 50.0)
    sensor = SensorMonitor('cylinder_a/pressure', 'Pa')
    assert faults_of(sensor, rounded(truth + noise * rng.standard_normal(truth.size), step), truth) == []
    sensor.end_learning()
    return sensor, rng


@given(st.lists(st.integers(0, SECOND), min_size=1))
def test_a_clock_that_goes_on_is_sound(steps: list[int]) -> None:
    clock = StampMonitor('piston_state', 1.0)
    stamps = np.cumsum([10**18, *steps]).tolist()
    assert [fault for stamp in stamps if (fault := clock.check(stamp, stamp * 1e-9))] == []


@pytest.mark.parametrize(
    ('moved', 'passed', 'kind', 'words'),
    [
        (-3600.0, 0.002, 'clock', 'the clock of piston_state jumped back by 3.6e+03 s'),
        (3600.0, 0.002, 'clock', 'the clock of piston_state jumped ahead by 3.6e+03 s'),
        (5.0, 5.0, 'silent', 'piston_state was silent for 5 s'),
    ],
)
def test_a_jump_and_a_silence_are_told_apart(moved: float, passed: float, kind: str, words: str) -> None:
    clock = StampMonitor('piston_state', 1.0)
    assert clock.check(10**18, 10.0) is None
    fault = clock.check(10**18 + round(moved * SECOND), 10.0 + passed)
    assert fault == Fault('piston_state', kind, words)
    assert clock.check(10**18 + round(moved * SECOND) + PERIOD, 10.0 + passed + 0.002) is None


@pytest.mark.parametrize('step', [1e-9, 50.0])
def test_a_sensor_with_noise_that_stands_still_is_stuck(step: float) -> None:
    sensor, rng = taught(step)
    truth = np.full(2000, 2e5)
    assert faults_of(sensor, rounded(truth + 50.0 * rng.standard_normal(2000), step), truth) == []
    (first, *_) = faults_of(sensor, np.full(300, 2e5), np.full(300, 2e5))
    assert (first.kind, first.message) == ('stuck', 'cylinder_a/pressure is stuck at 200000 Pa')


def test_a_coarse_sensor_may_rest_but_not_stand_while_it_should_move() -> None:
    sensor, rng = taught(step=1000.0, motion=5000.0)
    resting = np.full(20_000, 2e5)
    assert faults_of(sensor, rounded(resting + 50.0 * rng.standard_normal(20_000), 1000.0), resting) == []
    moving = 2e5 + 5000.0 * np.sin(np.arange(2000) / 50.0)
    assert {fault.kind for fault in faults_of(sensor, np.full(2000, 2e5), moving)} == {'stuck'}


def test_a_sensor_that_has_lost_its_noise_is_stuck() -> None:
    sensor, rng = taught(step=1.0)
    truth = 2e5 + 3000.0 * np.sin(np.arange(1000) / 50.0)
    (first, *_) = faults_of(sensor, truth + 2.0 * rng.standard_normal(1000), truth)
    assert first.message == 'cylinder_a/pressure has lost its usual noise: check for a stuck sensor'


def test_a_displacement_of_which_nothing_is_expected_is_never_stuck_by_itself() -> None:
    sensor = SensorMonitor('piston_state', 'm')
    assert faults_of(sensor, np.sin(np.arange(1000) / 50.0)) == []
    sensor.end_learning()
    assert not sensor.is_paused
    assert faults_of(sensor, np.zeros(1000)) == []
    assert sensor.is_paused
