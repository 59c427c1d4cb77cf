# SPDX-License-Identifier: Apache-2.0
"""The schedules: what they ask of the rig."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import (
    SCHEDULES,
    Schedule,
    SetPoints,
    Stroke,
    lay_out,
    out_and_back,
    paper_step,
    schedule_named,
    surface_following,
)
from cfd_pneumatic.units import INCH, PSI

MIL = 1e-3 * INCH


def sampled(schedule: Schedule) -> np.ndarray:
    """Return the displacement [m] at the samples."""
    return schedule.positions[schedule.knots_per_sample - 1 :: schedule.knots_per_sample]


@pytest.mark.parametrize('name', SCHEDULES)
def test_a_schedule_fits_together(name: str) -> None:
    schedule = schedule_named(name)
    knot = schedule.sampling_period / schedule.knots_per_sample
    assert schedule.name == name
    assert schedule.sampling_period == 2e-3
    assert schedule.setpoints.shape == (schedule.samples, 2)
    assert schedule.positions.shape == schedule.velocities.shape == (schedule.samples * schedule.knots_per_sample,)
    assert schedule.velocities[0] == schedule.positions[0] == 0.0
    rebuilt = np.cumsum(0.5 * (schedule.velocities[1:] + schedule.velocities[:-1])) * knot
    assert schedule.positions[1:] == pytest.approx(rebuilt, abs=2e-6), 'velocity is the derivative of position'
    assert np.max(np.abs(np.diff(schedule.velocities))) / knot < 500.0, 'acceleration [m/s^2]'
    assert np.max(np.abs(schedule.positions)) < 6.35e-3


@pytest.mark.parametrize('amplitude', [60 * MIL, 17 * MIL, -60 * MIL])
@pytest.mark.parametrize('psig', [5, 10, 15, 20])
def test_the_papers_step(psig: float, amplitude: float) -> None:
    schedule = paper_step(psig * PSI, amplitude)
    displacement = sampled(schedule)
    assert schedule.samples == 350
    assert np.all(displacement[:50] == 0.0), '50 samples before the trigger'
    assert abs(displacement[50]) > 0.0
    assert displacement[-1] == pytest.approx(amplitude)
    assert 2 <= np.count_nonzero(np.abs(np.diff(displacement)) > 0.01 * abs(amplitude)) <= 6, 'a fast ramp'
    assert np.all(schedule.setpoints == psig * PSI)


def test_out_and_back_has_two_amplitudes_and_two_set_points() -> None:
    schedule = out_and_back()
    displacement = sampled(schedule)
    resting = np.abs(np.diff(displacement, prepend=1.0)) < 1e-9
    assert np.unique(np.round(displacement[resting] / MIL, 3)) == pytest.approx([0.0, 17.0, 60.0])
    assert np.unique(schedule.setpoints[:, 0]) == pytest.approx([5 * PSI, 10 * PSI])
    assert np.all(schedule.setpoints[:, 1] == 5 * PSI)
    assert displacement[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_surface_of_a_minute() -> None:
    schedule = surface_following()
    assert schedule.samples == 30_001
    assert schedule.duration == pytest.approx(60.0)
    assert 10 < np.count_nonzero(np.any(np.diff(schedule.setpoints, axis=0), axis=1)) < 60
    assert np.all(np.abs(schedule.setpoints - [10 * PSI, 5 * PSI]) <= [2 * PSI, 1 * PSI])
    displacement = sampled(schedule)
    power = np.abs(np.fft.rfft(displacement * np.hanning(len(displacement)))) ** 2
    frequencies = np.fft.rfftfreq(len(displacement), 2e-3)
    assert power[frequencies > 40.0].sum() < 1e-6 * power.sum()
    assert np.std(displacement) == pytest.approx(0.8e-3, rel=0.15)


@given(st.floats(2.0, 10.0), st.integers(0, 2**31), st.floats(1.0, 40.0))
def test_surfaces_begin_and_end_flat(duration: float, seed: int, bandwidth: float) -> None:
    schedule = surface_following(duration=duration, seed=seed, bandwidth=bandwidth)
    assert schedule.positions[0] == schedule.velocities[0] == 0.0
    assert abs(schedule.velocities[-1]) < 1e-4
    assert np.max(np.abs(schedule.positions)) <= 3.5 * 0.8e-3


def test_a_seed_picks_the_surface() -> None:
    first, again, other = (surface_following(duration=5.0, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.positions, again.positions)
    assert np.array_equal(first.setpoints, again.setpoints)
    assert not np.array_equal(first.positions, other.positions)


@given(st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3))
def test_a_stroke_goes_from_rest_to_rest_smoothly(start: float, end: float) -> None:
    times = np.linspace(-0.01, 0.05, 3001)
    positions, velocities = Stroke.flight(0.0, start, end)(times)
    assert positions[0] == start
    assert positions[-1] == pytest.approx(end, abs=1e-15)
    assert velocities[0] == velocities[-1] == 0.0
    assert np.gradient(positions, times) == pytest.approx(velocities, abs=2e-3)
    direction = np.sign(end - start)
    assert np.all(direction * np.diff(positions) >= -1e-15)


def test_a_set_point_acts_from_the_sample_next_to_its_time_on() -> None:
    def still(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(times), np.zeros_like(times)

    changes = [SetPoints(0.0, 1e4, 2e4), SetPoints(0.006, 3e4, 2e4)]
    schedule = lay_out('still', still, changes, 6, 2e-3)
    assert schedule.setpoints[:, 0].tolist() == [1e4, 1e4, 1e4, 1e4, 3e4, 3e4], 'on the way from the sample at 6 ms'


@pytest.mark.parametrize(
    ('name', 'options', 'message'),
    [
        ('paper', {}, "schedule 'paper' is not known: use one of paper_step, out_and_back, surface_following"),
        ('paper_step', {'duration': 3.0}, "no option 'duration': its options are setpoint, amplitude"),
        ('surface_following', {'duration': 0.5}, '2 to 1200 s'),
        ('paper_step', {'sampling_period': 0.0}, 'must be a positive number'),
        ('out_and_back', {'repeats': 0}, 'must be 1 or more'),
    ],
)
def test_a_schedule_that_is_not_there(name: str, options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        schedule_named(name, **options)
