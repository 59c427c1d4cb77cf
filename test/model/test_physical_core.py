# SPDX-License-Identifier: Apache-2.0
"""The physical core: what gases do, the paper's linear law as its limit, and the same in one step as in a recording."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import AMBIENT
from scipy.optimize import brentq

from cfd_pneumatic.model import Cylinder, CylinderState, ExtendedCylinder, Movement, OperatingPoints
from cfd_pneumatic.model.effects import CORES, EFFECTS, physical_core

LEVEL = 2.5e5
K_X = 6e6
SHUT = (K_X, 1e-3, 1e-3, 1e2)
"""Gains of a regulator that hardly passes anything."""

GAINS = (K_X, 120.0, 30.0, 0.01)
NAMES = [one.name for one in CORES['physical_core'].parameters]


def core(**values):
    told = dict(zip(NAMES, CORES['physical_core'].null)) | {'pressure': LEVEL, 'supply': 7e5} | values
    return {'physical_core': tuple(told[name] for name in NAMES)}


def squeezed(own, travel, duration, rest=0.0):
    """Return the pressure after the piston has gone some way, and then rested, with the regulator shut [Pa]."""
    count = 2000
    times = np.linspace(0.0, duration, count)
    moved = np.linspace(0.0, travel, count)
    if rest:
        times = np.append(times, duration + np.linspace(rest / count, rest, count))
        moved = np.append(moved, np.full(count, travel))
    return ExtendedCylinder(SHUT, own, AMBIENT).simulate(times, moved, np.full(times.size, LEVEL))[-1]


@given(st.floats(1.0, 1.4), st.floats(-0.02, 0.03))
def test_a_shut_chamber_is_compressed_as_a_polytropic_gas(exponent, travel):
    """Equation (11) without flow: p V^n stays, V / A = n p / K_x at the reference."""
    length = exponent * LEVEL / K_X
    expected = LEVEL * (length / (length + travel)) ** exponent
    assert squeezed(core(exponent=exponent), travel, 1e-3) == pytest.approx(expected, rel=1e-4)


def test_walls_make_it_isothermal_in_the_end():
    length = 1.4 * LEVEL / K_X
    expected = LEVEL * length / (length + 0.01)
    assert squeezed(core(exponent=1.4, wall_loss=20.0), 0.01, 1e-3, rest=2.0) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize('speed', [-0.1, 0.05])
def test_motion_stirs_what_the_walls_take_up(speed):
    """At one speed walls that are stirred take up as much as better ones that are not."""
    better = 20.0 * math.hypot(1.0, 10.0 * speed)
    stirred, still = core(exponent=1.4, wall_loss=20.0, stirring=10.0), core(exponent=1.4, wall_loss=better)
    duration = 0.01 / abs(speed)
    travel = speed * duration
    assert squeezed(stirred, travel, duration) == pytest.approx(squeezed(still, travel, duration), rel=1e-6)
    assert squeezed(stirred, travel, duration) != pytest.approx(
        squeezed(core(exponent=1.4), travel, duration), rel=1e-3
    )


@pytest.mark.parametrize('interval', [1e-3, 1e-2])
@pytest.mark.parametrize('loss', [40.0, 300.0, 1000.0])
def test_stirred_walls_stay_stable_whatever_the_speed(loss, interval):
    """Air between isothermal and adiabatic changes: the pressure keeps near the isothermal one."""
    times = np.arange(0.0, 1.0, interval)
    moved = 0.01 * np.abs((100.0 * times) % 2.0 - 1.0)  # 1 m/s
    held = np.full(times.size, LEVEL)
    stirred, isothermal = (
        ExtendedCylinder(GAINS, own, AMBIENT).simulate(times, moved, held)
        for own in (core(exponent=1.4, wall_loss=loss, stirring=50.0), core(exponent=1.0))
    )
    assert np.max(np.abs(stirred - isothermal)) < 3e4


def test_where_the_gains_hold_it_is_the_papers_linear_law():
    """What it makes of a small motion differs from the linear model in second order only."""
    times = np.arange(0.0, 0.5, 1e-3)
    shape = np.interp(times, [0.1, 0.12, 0.3, 0.32], [0.0, 1.0, 1.0, 0.0])
    held = np.full(times.size, LEVEL)
    own = core(wall_loss=0.0)

    def departure(amplitude):
        linear = ExtendedCylinder(GAINS, {}, AMBIENT).simulate(times, amplitude * shape, held)
        return np.max(np.abs(ExtendedCylinder(GAINS, own, AMBIENT).simulate(times, amplitude * shape, held) - linear))

    assert departure(1e-4) == pytest.approx(100.0 * departure(1e-5), rel=0.05)
    assert departure(1e-5) < 1e-3 * K_X * 1e-5


@given(st.floats(0.0, 1.0), st.floats(0.1, 0.6))
def test_flow_is_an_ellipse_beyond_the_critical_ratio(ratio, critical):
    beyond = max(ratio - critical, 0.0) / (1.0 - critical)
    expected = max(math.sqrt(1.0 - beyond**2), physical_core.SMALLEST_FLOW)
    assert physical_core.orifice_flow(3e5, ratio * 3e5, critical) == pytest.approx(expected * 3e5)


@pytest.mark.parametrize(
    ('setpoint', 'pressure', 'values', 'expected'),
    [
        (5e5, 2.4e5, {}, 1.0),  # choked
        (5e5, 2.4e5, {'supply_growth': 2.0}, 4.0),
        (5e5, 2.4e5, {'supply': 3e5}, 1.0 / math.sqrt(1.0 - ((2.5 / 3.0 - 0.4) / 0.6) ** 2)),
        (2e5, 5e5, {'critical_ratio': 0.5}, 2.0),  # choked at twice the reference
        (2e5, 5e5, {'critical_ratio': 0.5, 'relief_growth': 1.0}, 2.0 * 0.8),
    ],
)
def test_flows_follow_the_pressures(setpoint, pressure, values, expected):
    """Against the linear valve at the reference, in the first instant at a pressure."""
    if values.get('supply') == 3e5:
        expected *= math.sqrt(1.0 - ((pressure / 3e5 - 0.4) / 0.6) ** 2)
    elif pressure > setpoint:
        expected /= math.sqrt(1.0 - max((AMBIENT / LEVEL - 0.5) / 0.5, 0.0) ** 2)
        expected *= math.sqrt(1.0 - max((AMBIENT / pressure - 0.5) / 0.5, 0.0) ** 2)
    cylinder = ExtendedCylinder(GAINS, core(**values), AMBIENT)
    begin = cylinder.begin(pressure, pressure, 0.0)
    duration = 1e-7
    rate = (cylinder.step(begin, Movement(duration, duration, 0.0, 0.0), setpoint).p - pressure) / duration
    gain = GAINS[1] if setpoint > pressure else GAINS[2]
    assert rate / (gain * (setpoint - pressure)) == pytest.approx(expected, rel=1e-3)


def test_the_control_chamber_draws_on_the_cylinder():
    """In the end it has taken its share of the air that was pressed into both."""
    gains = (K_X, 1e-3, 1e-3, 0.01)
    times = np.linspace(0.0, 0.5, 2000)
    moved = np.interp(times, [0.0, 1e-4], [0.0, 1e-4])
    held = np.full(times.size, LEVEL)
    alone, shared = (
        ExtendedCylinder(gains, core(control_volume=share), AMBIENT).simulate(times, moved, held)[-1] - LEVEL
        for share in (0.0, 0.1)
    )
    assert shared == pytest.approx(alone / 1.1, rel=0.01)


def test_it_rests_at_the_set_point_wherever_that_is():
    times = np.arange(0.0, 0.2, 1e-3)
    for level in (1.3e5, 2.5e5, 6e5):
        held = np.full(times.size, level)
        made = ExtendedCylinder(GAINS, core(wall_loss=3.0), AMBIENT).simulate(times, np.full(times.size, 2e-3), held)
        np.testing.assert_allclose(made, held, rtol=1e-12)


def test_step_by_step_it_is_what_it_is_over_a_recording():
    times = np.arange(0.0, 0.3, 1e-3)
    moved = 2e-3 * np.sin(20.0 * times)
    held = np.where(times < 0.15, LEVEL, 1.2 * LEVEL)
    cylinder = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT, core(wall_loss=5.0, control_volume=0.02))
    whole = ExtendedCylinder(GAINS, cylinder.effects, AMBIENT).simulate(times, moved, held)
    np.testing.assert_allclose(cylinder.simulate(times, moved, held), whole, rtol=1e-5)


@pytest.mark.parametrize(('pressure', 'setpoint'), [(0.0, 0.0), (LEVEL, -1e5), (1e9, LEVEL), (math.nan, LEVEL)])
def test_a_live_step_bears_whatever_pressure(pressure, setpoint):
    """One of which a power is none, and one that has run away; whoever steps on looks whether it is finite."""
    cylinder = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT, core(supply_growth=-2.0, relief_growth=-2.0))
    movement = Movement(1e-3, 1e-3, 0.0, 1e-5)
    assert not cylinder.step(CylinderState(pressure, pressure), movement, setpoint).is_finite
    assert cylinder.step(CylinderState(5e3, 5e3), movement, 2e3).is_finite


def test_it_is_no_effect_and_covers_three():
    assert EFFECTS.keys().isdisjoint(CORES)
    assert set(CORES['physical_core'].covers) < EFFECTS.keys()


def first_rates(cylinder, pressure, sensed, setpoint):
    """Return the rates of outlet and sensed pressure in the first instant [Pa/s]."""
    duration = 1e-7
    begin = cylinder.begin(pressure, sensed, 0.0)
    state = cylinder.step(begin, Movement(duration, duration, 0.0, 0.0), setpoint)
    return (state.p - pressure) / duration, (state.p_f - sensed) / duration


@pytest.mark.parametrize('share', [0.2, 0.6, 1.0, 2.0, 5.0])
def test_a_silencer_is_a_second_orifice_in_a_row(share):
    """Against the pressure between two orifices of ISO 6358 that pass the same flow, for a valve opened so far."""

    def passed(opened, upstream, downstream):
        beyond = max(downstream / upstream - 0.4, 0.0) / 0.6
        return opened * upstream * math.sqrt(1.0 - beyond**2)

    between = brentq(lambda p: passed(share, LEVEL, p) - passed(1.0, p, AMBIENT), AMBIENT, LEVEL)
    expected = passed(1.0, between, AMBIENT) / passed(share, LEVEL, AMBIENT)
    error = 2e4
    own = [core(silencer=one) for one in (share / error, 0.0)]
    muffled, free = (first_rates(ExtendedCylinder(GAINS, one, AMBIENT), LEVEL, LEVEL, LEVEL - error)[0] for one in own)
    assert muffled / free == pytest.approx(expected, rel=1e-6)


@given(st.floats(0.01, 20.0), st.floats(1.01, 10.0), st.floats(0.1, 0.6))
def test_two_orifices_in_a_row_pass_the_same(opened, ratio, critical):
    upstream = ratio * AMBIENT
    behind = physical_core.pressure_between(opened, upstream, AMBIENT, critical)
    assert behind * (1.0 + 1e-9) >= AMBIENT
    assert behind <= upstream * (1.0 + 1e-9)

    def squared(upstream, downstream):
        beyond = max(downstream - critical * upstream, 0.0) / (1.0 - critical)
        return upstream**2 - beyond**2

    flow = opened**2 * squared(upstream, behind)
    assert flow == pytest.approx(squared(behind, AMBIENT), rel=1e-6, abs=1e-9 * upstream**2)


@given(st.floats(1e2, 1e5), st.floats(1e-6, 1e-3))
def test_the_entrance_of_the_tube_takes_its_share_with_the_square_of_the_flow(drop, entrance):
    """The drop is the wall's, which goes with the flow, and the entrance's."""
    _, rate = first_rates(ExtendedCylinder(GAINS, core(entrance=entrance), AMBIENT), LEVEL, LEVEL - drop, LEVEL)
    along = rate * GAINS[3] * 2.0 * LEVEL / (2.0 * LEVEL - drop)
    assert along + entrance * along**2 == pytest.approx(drop, rel=1e-3)
