# SPDX-License-Identifier: Apache-2.0
"""The kernel against an independent integrator, its own finite differences, and what physics demands."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from reference import AMBIENT, PSI, pressure_to_thirty_digits

from cfd_pneumatic.model import TABLE_1, Course, Cylinder, CylinderState, Movement, OperatingPoints
from studies.documents.parameter_sets import simulate_parameter_sets

GAINS = st.tuples(st.floats(1e5, 1e8), st.floats(0.1, 500.0), st.floats(0.1, 500.0), st.floats(1e-4, 1.0)).map(np.array)


def random_record(seed, samples=60):
    """Return irregular times [s], a rough displacement [m] and a stepping set-point [Pa]."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.001, 0.002, 0.01, 0.3], samples))
    displacement = np.cumsum(rng.normal(size=samples)) * 1e-4
    setpoint = AMBIENT + 5.0 * PSI + 2000.0 * rng.integers(0, 3, samples).repeat(10)[:samples]
    return times, displacement, setpoint


def simulate(gains, record, shift=0.0, start=0.0):
    times, displacement, setpoint = record
    cylinder = Cylinder(OperatingPoints.constant(*gains), AMBIENT)
    setpoint = setpoint + shift
    return cylinder.simulate(times, displacement, setpoint, CylinderState(*[setpoint[0] + start] * 2))


@pytest.mark.parametrize('seed', range(4))
def test_agrees_with_thirty_digits(seed):
    record = random_record(seed)
    gains = np.array([4e6, 100.0, 20.0, 0.01]) * np.exp(np.random.default_rng(seed).normal(size=4))
    error = simulate(gains, record) - pressure_to_thirty_digits(gains, *record)
    assert np.max(np.abs(error)) < 1e-10 * PSI


def simulate_with_sensitivities(gains, record, start=0.0):
    times, displacement, setpoint = record
    return Course(gains, setpoint[0] + start).simulate_piece(times, displacement, setpoint)


def worst_sensitivity(gains, record):
    """Return the largest error of a sensitivity against central differences, as a share of its largest value."""
    pressure, jacobian = simulate_with_sensitivities(gains, record, start=300.0)
    np.testing.assert_allclose(pressure, simulate(gains, record, start=300.0), rtol=0, atol=1e-7)
    steps = [*(1e-5 * np.diag(gains)), None, None]
    worst = 0.0
    for column, step in enumerate(steps):
        if step is not None:
            ahead, behind = (simulate(gains + sign * step, record, start=300.0) for sign in (1.0, -1.0))
            scale = 1.0 / (2e-5 * gains[column])
        else:
            shift, start = (0.1, 0.0) if column == 4 else (0.0, 0.1)
            ahead, behind = (
                simulate(gains, record, shift=sign * shift, start=300.0 + sign * start) for sign in (1.0, -1.0)
            )
            scale = 5.0
        error = np.abs(scale * (ahead - behind) - jacobian[:, column])
        # rounding of pressures about 1e5 Pa is all that a parameter without influence shows
        worst = max(worst, np.max(error) / (np.max(np.abs(jacobian[:, column])) + 1e-5 * scale))
    return worst


@pytest.mark.parametrize('seed', range(8))
def test_sensitivities_are_the_derivatives(seed):
    gains = np.array([4e6, 100.0, 20.0, 0.01]) * np.exp(np.random.default_rng(seed).normal(size=4))
    assert worst_sensitivity(gains, random_record(seed)) < 1e-5


@given(GAINS, st.integers(0, 1000))
def test_sensitivities_hold_for_any_gains(gains, seed):
    """More loosely: where the sensed pressure grazes the switch, differences are coarse, derivatives are not."""
    assert worst_sensitivity(gains, random_record(seed)) < 0.03


@given(GAINS, st.integers(0, 1000), st.integers(1, 58))
def test_a_step_may_be_cut_anywhere(gains, seed, at):
    times, displacement, setpoint = random_record(seed)
    middle = 0.37 * times[at] + 0.63 * times[at + 1]
    finer = (
        np.insert(times, at + 1, middle),
        np.insert(displacement, at + 1, np.interp(middle, times, displacement)),
        np.insert(setpoint, at + 1, setpoint[at + 1]),
    )
    whole = simulate(gains, (times, displacement, setpoint))
    cut = np.delete(simulate(gains, finer), at + 1)
    np.testing.assert_allclose(cut, whole, rtol=0, atol=1e-6 * np.max(np.abs(whole)))


@given(GAINS, st.integers(0, 1000), st.sampled_from([None, 0.0, 1e-12, 1e-9, 1e-7]))
@example(np.array([1e8, 451.8560737, 0.2435208490, 1.0]), 187, 1e-12)  # the pressure comes within 61 Pa of zero
@example(np.array([1e8, 0.1, 75.69136646, 0.006377697790]), 382, 0.0)
def test_stepping_equals_the_whole_recording(gains, seed, rounding):
    """The kernel keeps exponentials from step to step where periods are one but for the rounding of their times."""
    times, displacement, setpoint = random_record(seed)
    if rounding is not None:
        times = 0.002 * np.arange(times.size) + rounding * np.random.default_rng(seed).uniform(-1.0, 1.0, times.size)
    cylinder = Cylinder(OperatingPoints.constant(*gains), AMBIENT)
    state = CylinderState.at_rest(setpoint[0])
    stepped = [state.p]
    for i in range(1, times.size):
        movement = Movement(times[i] - times[0], times[i] - times[i - 1], displacement[i - 1], displacement[i])
        state = cylinder.step(state, movement, setpoint[i])
        stepped.append(state.p)
    whole = cylinder.simulate(times, displacement, setpoint)
    np.testing.assert_allclose(stepped, whole, rtol=0, atol=1e-10 * np.max(np.abs(whole)))


@given(GAINS)
def test_rests_at_the_set_point(gains):
    times = np.linspace(0.0, 1.0, 11)
    setpoint = np.full(11, AMBIENT + 3e4)
    np.testing.assert_array_equal(simulate(gains, (times, np.full(11, 0.02), setpoint)), setpoint)


@given(GAINS)
def test_a_long_rest_ends_at_the_set_point(gains):
    times = np.array([0.0, 0.01, 1e4])
    pressure = simulate(gains, (times, np.array([0.0, 1e-3, 1e-3]), np.full(3, 2e5)))
    assert abs(pressure[-1] - 2e5) < 1e-3


@pytest.mark.parametrize(('k_sv', 'k_v', 'tau'), [(5e3, 5e3, 1e-5), (5e3, 1e-3, 1e2), (1e-3, 5e3, 1e2)])
def test_corners_of_the_parameter_ranges_stay_finite(k_sv, k_v, tau):
    times, displacement, setpoint = random_record(1)
    pressure, jacobian = simulate_with_sensitivities(
        np.array([1e7, k_sv, k_v, tau]), (10.0 * times, displacement, setpoint)
    )
    assert np.all(np.isfinite(pressure))
    assert np.all(np.isfinite(jacobian))


@pytest.mark.parametrize('wild', [1e300, np.inf, np.nan])
def test_a_wild_displacement_ends_as_nan_and_not_never(wild):
    times, displacement, setpoint = random_record(1)
    displacement[30] = wild
    pressure = simulate(np.array([4e6, 100.0, 20.0, 0.01]), (times, displacement, setpoint))
    assert np.all(np.isfinite(pressure[:30]))
    assert not np.isfinite(pressure[-1])


@pytest.mark.parametrize('tau', [1e-5, 1e-2, 1e2])
def test_a_gap_of_a_day_is_crossed_at_once(tau):
    times = np.array([0.0, 0.002, 86_400.0])
    gains = np.array([4e6, 5e3, 5e3, tau])
    pressure, jacobian = simulate_with_sensitivities(gains, (times, np.array([0.0, 1e-3, 1e-3]), np.full(3, 2e5)))
    assert abs(pressure[-1] - 2e5) < 1e-3
    assert np.all(np.isfinite(jacobian))


def test_charging_gain_acts_below_the_set_point_and_discharging_gain_above():
    """The paper's printed switch of equation (12) is reversed; equations (9) and (10) say which valve opens."""
    times = np.arange(0.0, 0.2, 0.002)
    grows = np.clip(times, 0.0, 0.01) * 0.1
    setpoint = np.full(times.size, 2e5)
    gains = np.array([4e6, 50.0, 20.0, 1e-3])
    other_relief = gains * [1.0, 1.0, 3.0, 1.0]
    other_supply = gains * [1.0, 3.0, 1.0, 1.0]
    record = (times, grows, setpoint)
    falls = slice(1, 10)
    np.testing.assert_array_equal(simulate(gains, record)[falls], simulate(other_relief, record)[falls])
    assert np.all(simulate(other_supply, record)[5:10] > simulate(gains, record)[5:10])


def test_the_papers_step_drops_and_overshoots_as_measured():
    """Figure 6b: about -0.9 and +0.2 psi at 5 psig for 60 mil."""
    times = np.arange(350) * 0.002
    displacement = np.interp(times, [0.1, 0.108], [0.0, 60e-3 * 0.0254])
    setpoint = np.full(350, AMBIENT + 5.0 * PSI)
    change = (Cylinder(TABLE_1, AMBIENT).simulate(times, displacement, setpoint) - setpoint) / PSI
    assert change.min() == pytest.approx(-0.9, abs=0.1)
    assert change.max() == pytest.approx(0.2, abs=0.05)


def test_gains_follow_the_set_point():
    setpoints = np.array([5.0, 7.5, 10.0, 40.0]) * PSI
    at = TABLE_1.interpolate(setpoints)
    assert at.k_x[1] == pytest.approx(0.5 * (at.k_x[0] + at.k_x[2]))
    assert at.k_sv[3] == TABLE_1.k_sv[-1]
    times = np.arange(50) * 0.002
    displacement = np.linspace(0.0, 1e-3, 50)
    scheduled = Cylinder(TABLE_1, AMBIENT)
    for index, setpoint in enumerate(setpoints):
        fixed = Cylinder(OperatingPoints.constant(at.k_x[index], at.k_sv[index], at.k_v[index], at.tau[index]), AMBIENT)
        held = np.full(50, AMBIENT + setpoint)
        np.testing.assert_allclose(
            scheduled.simulate(times, displacement, held), fixed.simulate(times, displacement, held), atol=1e-6
        )


def test_parameter_sets_are_simulated_as_one_by_one():
    times, displacement, setpoint = random_record(3)
    gains = np.array([4e6, 100.0, 20.0, 0.01]) * np.random.default_rng(4).uniform(0.3, 3.0, (37, 4))
    together = simulate_parameter_sets(gains, times, displacement, setpoint)
    for one, pressure in zip(gains, together):
        np.testing.assert_array_equal(pressure, simulate(one, (times, displacement, setpoint)))


@given(GAINS, st.integers(0, 1000), st.lists(st.integers(1, 58), min_size=1, max_size=4, unique=True))
def test_a_recording_in_pieces_is_followed_as_a_whole(gains, seed, cuts):
    record = random_record(seed)
    whole = simulate_with_sensitivities(gains, record, start=300.0)
    course = Course(gains, record[2][0] + 300.0)
    edges = [0, *sorted(cuts), record[0].size - 1]
    for begin, end in pairwise(edges):
        piece = course.simulate_piece(*(one[begin : end + 1] for one in record))
        for part, all_of_it in zip(piece, whole):
            scale = np.maximum(np.max(np.abs(all_of_it), axis=0), 1e-30)
            np.testing.assert_allclose(part / scale, all_of_it[begin : end + 1] / scale, rtol=0, atol=1e-5)
