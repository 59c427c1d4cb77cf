# SPDX-License-Identifier: Apache-2.0
"""Equations (1) to (11) from dimensions, against textbook values and against each other."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.model.first_principles import CRITICAL_RATIO, AspiratorTube, Regulator, first_guess, flow_per_area

TUBE = AspiratorTube(inner_diameter=1e-3, length=0.03, chamber_volume=2e-5)
REGULATOR = Regulator(supply_pressure=6.2e5, temperature=293.0, k_4=2e-10, k_5=4e-11, aspirator=TUBE)


def as_printed(upstream: float, downstream: float, temperature: float) -> float:
    """Return equation (1) in British units [lbm/(s in^2)]; pressures in psia, temperature in degrees Rankine."""
    ratio = downstream / upstream
    return 0.449 * upstream / math.sqrt(temperature) * (1.0 + 0.537 * ratio) * math.sqrt(1.0 - ratio)


def test_choked_flow_is_the_textbooks():
    """0.0404 p / sqrt(T) for air, White, Fluid Mechanics, section 9.4."""
    assert flow_per_area(1e5, 1e4, 293.0) == pytest.approx(0.0404 * 1e5 / math.sqrt(293.0), rel=2e-3)


@given(st.floats(1e5, 1e6), st.floats(0.01, 1.0), st.floats(250.0, 350.0))
def test_flow_falls_with_the_pressure_ratio_and_stays_below_choked(upstream, ratio, temperature):
    flow = flow_per_area(upstream, ratio * upstream, temperature)
    choked = flow_per_area(upstream, 0.01 * upstream, temperature)
    assert 0.0 <= flow <= choked
    if ratio <= CRITICAL_RATIO:
        assert flow == choked
    assert flow_per_area(upstream, min(1.0, 1.1 * ratio) * upstream, temperature) <= flow


def test_no_flow_without_a_pressure_drop():
    assert flow_per_area(2e5, 2e5, 293.0) == 0.0


def test_the_printed_equation_follows_the_subsonic_flow_up_to_a_factor():
    """Equation (1) in British units lies 16 to 37 % below an ideal nozzle; the effective area absorbs the factor."""
    ratios = np.array([0.2, 0.4, 0.6, 0.8, 0.95])
    pound_per_inch2 = 0.45359237 / 0.0254**2
    printed = [as_printed(90.0, 90.0 * ratio, 293.0 * 1.8) * pound_per_inch2 for ratio in ratios]
    ideal = [flow_per_area(90.0 * 6894.757, 90.0 * 6894.757 * ratio, 293.0) for ratio in ratios]
    quotient = np.array(printed) / ideal
    assert np.all((quotient > 0.6) & (quotient < 0.85))


@pytest.mark.parametrize(
    ('upstream', 'downstream', 'temperature'), [(1e5, 2e5, 293.0), (1e5, 0.0, 293.0), (2e5, 1e5, 0.0)]
)
def test_impossible_flows_are_refused(upstream, downstream, temperature):
    with pytest.raises(ValueError, match=r'upstream|temperature'):
        flow_per_area(upstream, downstream, temperature)


def test_k_x_is_the_stiffness_of_the_enclosed_air():
    guess = first_guess(REGULATOR, area=1.1e-3, volume=5e-5, pressure=2e5, ambient_pressure=1e5)
    assert guess['k_x'] == pytest.approx(1.4 * 2e5 * 1.1e-3 / 5e-5)


def test_gains_scale_as_equations_8_and_12_say():
    small = first_guess(REGULATOR, 1.1e-3, 5e-5, 2e5, 1e5)
    large = first_guess(REGULATOR, 1.1e-3, 1e-4, 2e5, 1e5)
    for name in ('k_x', 'k_sv', 'k_v'):
        assert large[name] == pytest.approx(0.5 * small[name])
    assert large['tau'] == small['tau']
    assert small['k_v'] < small['k_sv']


def test_tau_is_the_chambers_capacity_over_the_tubes_conductance():
    """With M_a = p V / (R T), tau of equation (8) is V / (n R T K_1)."""
    pressure, temperature, exponent = 2e5, 293.0, 1.4
    k_1 = TUBE.k_1(pressure, temperature)
    expected = TUBE.chamber_volume / (exponent * 287.058 * temperature * k_1)
    assert TUBE.tau(pressure, temperature, exponent) == pytest.approx(expected)


def test_sensing_slows_with_a_longer_tube():
    longer = AspiratorTube(inner_diameter=1e-3, length=0.06, chamber_volume=2e-5)
    assert longer.tau(2e5, 293.0, 1.4) == pytest.approx(2.0 * TUBE.tau(2e5, 293.0, 1.4))
