# SPDX-License-Identifier: Apache-2.0
"""The rig's physics against what physics says, and its behaviour near rest against the paper's Table 1."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.rig import Air, Cylinder, RigParameters, Seal, physics
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.oddities import Oddities
from cfd_pneumatic.units import PSI, PSI_PER_INCH

PRESSURES = st.floats(5e4, 8e5)
AIR = Air()

# Guvenc and Srinivasan, Table 1, repeated rows averaged: psig, K_x [lbf/in^3], K_sv [1/s], K_v [1/s], tau [s].
TABLE_1 = [
    (5, 15.945, 104.32, 19.43, 0.01055),
    (10, 20.119, 164.54, 30.41, 0.0123),
    (15, 21.926, 179.92, 27.27, 0.0093),
    (20, 26.825, 359.85, 57.30, 0.0050),
]


def at(outlet: float, sensed: float) -> physics.CylinderState:
    """Return the state of a cylinder without effects at some absolute pressures [Pa]."""
    return physics.CylinderState(outlet, sensed, outlet, AIR.temperature, 0.0, 0.0, 0.0, 0.0)


def small_signal(psig: float) -> tuple[float, float, float, float]:
    """Return K_x [Pa/m], K_sv [1/s], K_v [1/s] and tau [s] from small changes about rest."""
    rest = AMBIENT_PRESSURE + psig * PSI

    def rates(outlet: float = rest, sensed: float = rest, velocity: float = 0.0) -> tuple[float, float]:
        state = at(outlet, sensed)
        rates = physics.cylinder_rates(state, 0.0, rest, 0.0, velocity, Cylinder(), Effects(), Oddities(), AIR)
        return rates.outlet, rates.sensed

    return (
        -rates(velocity=1e-4)[0] / 1e-4,
        rates(sensed=rest - 1.0)[0],
        -rates(sensed=rest + 1.0)[0],
        1.0 / rates(outlet=rest + 1.0)[1],
    )


@pytest.mark.parametrize(('psig', 'k_x', 'k_sv', 'k_v', 'tau'), TABLE_1)
def test_near_rest_the_rig_is_the_device_of_table_1(
    psig: float, k_x: float, k_sv: float, k_v: float, tau: float
) -> None:
    found = small_signal(psig)
    assert found[0] / PSI_PER_INCH == pytest.approx(k_x, rel=0.1)
    assert found[1:] == pytest.approx((k_sv, k_v, tau), rel=0.4)


def test_stiffness_is_that_of_an_enclosed_gas() -> None:
    cylinder = Cylinder()
    rest = AMBIENT_PRESSURE + 10 * PSI
    expected = cylinder.polytropic_exponent * rest * cylinder.area / cylinder.rest_volume
    assert small_signal(10)[0] == pytest.approx(expected, rel=1e-9)


@given(PRESSURES, st.floats(0.01, 0.99), st.floats(0.1, 0.6))
def test_choked_flow_does_not_feel_the_downstream_pressure(upstream: float, share: float, critical: float) -> None:
    downstream = share * critical * upstream
    expected = 1e-8 * upstream * physics.REFERENCE_DENSITY
    assert physics.orifice_flow(1e-8, upstream, downstream, critical, 0.5, 293.15) == pytest.approx(expected)


@given(PRESSURES, PRESSURES, st.floats(0.1, 0.6))
def test_an_orifice_is_the_same_both_ways_and_never_above_choked(one: float, other: float, critical: float) -> None:
    there = physics.orifice_flow(1e-8, one, other, critical, 0.5, 293.15)
    back = physics.orifice_flow(1e-8, other, one, critical, 0.5, 293.15)
    assert there == -back
    assert (there > 0) == (one > other)
    assert abs(there) <= 1e-8 * max(one, other) * physics.REFERENCE_DENSITY * (1 + 1e-12)


@given(st.floats(0.1, 0.6), st.floats(0.35, 0.7))
def test_flow_function_is_continuous_and_falls(critical: float, index: float) -> None:
    ratios = np.linspace(0.0, 1.0, 20_001)
    flows = np.array([physics.flow_function(ratio, critical, index) for ratio in ratios])
    assert flows[0] == 1.0
    assert flows[-1] == 0.0
    assert np.all(np.diff(flows) <= 0.0)
    assert np.max(-np.diff(flows)) < 0.01


def test_choked_supply_flow_is_that_of_equation_1() -> None:
    """The effective area of ISO 6358's reference flow: m = 0.0404 p A / sqrt(T) in SI for air."""
    conductance = Cylinder().supply_conductance
    supply = AIR.supply_pressure
    area = conductance * physics.REFERENCE_DENSITY * math.sqrt(293.15) / 0.0404
    flow = physics.orifice_flow(conductance, supply, AMBIENT_PRESSURE + 5 * PSI, 0.5, 0.5, 293.15)
    assert flow == pytest.approx(0.0404 * supply * area / math.sqrt(293.15))
    assert flow == pytest.approx(40 * 4.719e-4 * 1.2, rel=0.05), 'the regulator passes 40 scfm'


@given(PRESSURES, PRESSURES)
def test_tube_flow_is_poiseuille(one: float, other: float) -> None:
    mean = 0.5 * (one + other)
    density = mean / (AIR.gas_constant * AIR.temperature)
    expected = density * (2.5e-4) ** 2 / (32 * AIR.viscosity) * (math.pi / 4 * (2.5e-4) ** 2) / 0.02 * (one - other)
    assert physics.tube_flow(2.5e-4, 0.02, one, other, mean, 0.0, AIR) == pytest.approx(expected, abs=1e-15)


@given(PRESSURES, PRESSURES, st.floats(1e3, 1e5))
def test_an_entrance_takes_what_the_square_of_the_flow_says(one: float, other: float, loss: float) -> None:
    def flow(higher: float, lower: float, entrance: float) -> float:
        return physics.tube_flow(2.5e-4, 0.02, higher, lower, 2e5, entrance, AIR)

    assert flow(loss + 1e5, 1e5, loss) == pytest.approx(0.5 * flow(loss + 1e5, 1e5, 0.0))
    slowed, laminar = flow(one, other, loss), flow(one, other, 0.0)
    assert abs(slowed) <= abs(laminar)
    # of two losses one grows with the flow, the other with its square
    per_flow = loss / flow(loss + 1e5, 1e5, 0.0)
    assert per_flow * abs(slowed) + 2.0 * per_flow**2 * slowed**2 / loss == pytest.approx(abs(one - other))


@given(st.floats(0.0, 1e5))
def test_a_silencer_passes_as_much_as_two_orifices_in_a_row(error: float) -> None:
    """Inverse cubes of conductances add up, the usual approximation for orifices in series."""
    silenced = Cylinder(silencer_conductance=2e-9)
    opened = physics.relief_opening(-error, Cylinder())
    behind = physics.relief_opening(-error, silenced)
    assert behind <= min(opened, 2e-9)
    if behind > 1e-15:
        assert behind**-3 == pytest.approx(opened**-3 + 2e-9**-3)


@given(st.floats(1.2e5, 3e5), st.floats(-3e4, 3e4))
def test_one_valve_at_a_time_is_open_and_only_so_far(setpoint: float, error: float) -> None:
    cylinder = Cylinder(supply_conductance=1e-10, relief_conductance=1e-10)
    supply = physics.supply_opening(error, setpoint, cylinder, AIR)
    relief = physics.relief_opening(error, cylinder)
    assert supply * relief == 0.0
    assert 0.0 <= supply <= 1e-10
    assert 0.0 <= relief <= 1e-10
    if error == 0.0:
        assert supply == relief == 0.0


def test_frozen_coefficients_are_linear() -> None:
    frozen = Cylinder(pressure_dependence=0.0, position_dependence=0.0)
    rest = frozen.reference_pressure

    def rates(error: float, velocity: float) -> np.ndarray:
        state = at(rest - 0.5 * error, rest - error)
        return np.array(physics.cylinder_rates(state, 0.0, rest, 1e-3, velocity, frozen, Effects(), Oddities(), AIR))

    together = rates(3000.0, 0.02)
    assert rates(1000.0, 0.01) + rates(2000.0, 0.01) == pytest.approx(together, rel=1e-9)


def test_friction_turns_round_after_a_reversal() -> None:
    seal = Seal(coulomb=2.0, coulomb_per_pressure=1e-5, viscous=0.0, presliding=1e-4)
    forth = physics.seal_stretch(0.0, 2e-3, seal)
    assert physics.friction(forth, 0.1, 1e5, seal) == pytest.approx(3.0)
    turning = physics.seal_stretch(forth, -1e-4 * math.log(2), seal)
    assert turning == pytest.approx(0.0, abs=1e-6), 'Dahl: after ln 2 of the presliding distance friction is nil'
    assert physics.seal_stretch(turning, -2e-3, seal) == pytest.approx(-1.0)


def test_a_slow_seal_rubs_more() -> None:
    seal = Seal(coulomb=2.0, coulomb_per_pressure=0.0, viscous=0.0, breakaway=1.0, stribeck_speed=1e-2)
    assert physics.friction(1.0, 0.0, 1e5, seal) == pytest.approx(3.0)
    assert physics.friction(-1.0, -1e-2, 1e5, seal) == pytest.approx(-2.0 - 1.0 / math.e)
    assert physics.friction(1.0, 0.1, 1e5, seal) == pytest.approx(2.0)


@given(st.floats(-1.0, 1.0), st.lists(st.floats(-1e-3, 1e-3), max_size=10))
def test_friction_stays_within_coulomb(stretch: float, paths: list[float]) -> None:
    for path in paths:
        stretch = physics.seal_stretch(stretch, path, Seal())
    assert -1.0 <= stretch <= 1.0


def test_force_is_what_air_inertia_and_friction_leave() -> None:
    parameters = RigParameters(seal=Seal(coulomb=1.0, coulomb_per_pressure=0.0, viscous=5.0))
    gauge_a, gauge_b = 60e3, 20e3
    force = physics.contact_force(
        (AMBIENT_PRESSURE + gauge_a, AMBIENT_PRESSURE + gauge_b), 1.0, (0.0, 0.1, 20.0), parameters
    )
    piston = parameters.piston
    assert force == pytest.approx((gauge_a - gauge_b) * parameters.cylinder_a.area - piston.mass * 20.0 - 1.0 - 0.5)


@pytest.mark.parametrize(('between', 'derivative'), [(physics.position_between, physics.velocity_between)])
def test_motion_between_knots_is_a_cubic(between: Callable[..., float], derivative: Callable[..., float]) -> None:
    cubic = np.polynomial.Polynomial([1.0, -2.0, 3.0, 4.0])
    slope = cubic.deriv()
    start, period = 0.3, 0.5
    knots = (cubic(start), slope(start), cubic(start + period), slope(start + period))
    for fraction in (0.0, 0.3, 0.5, 1.0):
        time = start + fraction * period
        assert between(fraction, period, *knots) == pytest.approx(cubic(time))
        assert derivative(fraction, period, *knots) == pytest.approx(slope(time))
    assert physics.acceleration_at_end(period, *knots) == pytest.approx(cubic.deriv(2)(start + period))
