# SPDX-License-Identifier: Apache-2.0
"""
Model parameters from a data sheet's dimensions, by equations (1) to (11).

The paper's equation (1) is an empirical fit of the flow through an orifice in British units. This module uses the
isentropic nozzle flow that the fit approximates, in SI, with the choked branch below the critical pressure ratio. K_1
to K_5 are the lumped constants of equations (2), (3), (5), (9) and (10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

GAS_CONSTANT = 287.058
"""Specific gas constant of dry air [J/(kg K)]."""

HEAT_RATIO = 1.4
"""Ratio of the specific heats of air [-]."""

CRITICAL_RATIO = (2.0 / (HEAT_RATIO + 1.0)) ** (HEAT_RATIO / (HEAT_RATIO - 1.0))
"""Downstream / upstream pressure at and below which an orifice is choked, 0.528 [-]."""


def flow_per_area(upstream: float, downstream: float, temperature: float) -> float:
    """
    Return the mass flow through an ideal orifice for each unit of its effective area [kg/(s m^2)]: equation (1).

    Parameters
    ----------
    upstream, downstream
        Absolute pressures; upstream is the larger [Pa].
    temperature
        Upstream temperature [K].

    Raises
    ------
    ValueError
        If a pressure or temperature is not positive, or the pressures are reversed.

    """
    if not 0.0 < downstream <= upstream:
        raise ValueError(f'must be 0 < downstream <= upstream; got {downstream:g} and {upstream:g} Pa')
    if not temperature > 0.0:
        raise ValueError(f'temperature must be positive; got {temperature:g} K')
    ratio = max(downstream / upstream, CRITICAL_RATIO)
    expansion = ratio ** (2.0 / HEAT_RATIO) - ratio ** ((HEAT_RATIO + 1.0) / HEAT_RATIO)
    return upstream * math.sqrt(2.0 * HEAT_RATIO / ((HEAT_RATIO - 1.0) * GAS_CONSTANT * temperature) * expansion)


@dataclass(frozen=True)
class AspiratorTube:
    """
    The tube through which the control chamber senses the outlet pressure: equations (4) to (8).

    Attributes
    ----------
    inner_diameter, length
        Dimensions [m].
    chamber_volume
        Volume of the control chamber behind the tube [m^3].
    viscosity
        Dynamic viscosity of air [Pa s].

    """

    inner_diameter: float
    length: float
    chamber_volume: float
    viscosity: float = 1.82e-5

    def k_1(self, pressure: float, temperature: float) -> float:
        """Return K_1, laminar mass flow for each unit of pressure drop [kg/(s Pa)]: equations (4) and (5)."""
        density = pressure / (GAS_CONSTANT * temperature)
        area = 0.25 * math.pi * self.inner_diameter**2
        return density * self.inner_diameter**2 / (32.0 * self.viscosity) * area / self.length

    def tau(self, pressure: float, temperature: float, polytropic_exponent: float) -> float:
        """Return the sensing time constant M_a / (n p_f K_1) [s]: equation (8)."""
        mass = pressure * self.chamber_volume / (GAS_CONSTANT * temperature)
        return mass / (polytropic_exponent * pressure * self.k_1(pressure, temperature))


@dataclass(frozen=True)
class Regulator:
    """
    A relieving precision regulator: equations (1) to (3), (9) and (10).

    Attributes
    ----------
    supply_pressure
        Absolute pressure [Pa].
    temperature
        Temperature of supply and chamber [K].
    k_4, k_5
        Effective orifice area for each unit of pressure error, supply and relief valve [m^2/Pa].
    aspirator
        The sensing tube.

    """

    supply_pressure: float
    temperature: float
    k_4: float
    k_5: float
    aspirator: AspiratorTube

    def k_2(self, pressure: float) -> float:
        """Return K_2, supply flow for each unit of valve area [kg/(s m^2)]: equations (1) and (2)."""
        return flow_per_area(self.supply_pressure, pressure, self.temperature)

    def k_3(self, pressure: float, ambient_pressure: float) -> float:
        """Return K_3, vented flow for each unit of valve area [kg/(s m^2)]: equation (3)."""
        return flow_per_area(pressure, ambient_pressure, self.temperature)


def first_guess(
    regulator: Regulator,
    area: float,
    volume: float,
    pressure: float,
    ambient_pressure: float,
    polytropic_exponent: float = HEAT_RATIO,
) -> dict[str, float]:
    """
    Return k_x [Pa/m], k_sv, k_v [1/s] and tau [s] at an operating point, from dimensions: equations (8), (11), (12).

    Parameters
    ----------
    regulator
        Valves, supply and sensing tube.
    area, volume
        Piston area and volume of the cylinder's chamber [m^2, m^3].
    pressure, ambient_pressure
        Absolute pressures [Pa].
    polytropic_exponent
        n, 1 (isothermal) to 1.4 (adiabatic) [-].

    """
    mass = pressure * volume / (GAS_CONSTANT * regulator.temperature)
    by_flow = polytropic_exponent * pressure / mass
    return {
        'k_x': polytropic_exponent * pressure * area / volume,
        'k_sv': regulator.k_2(pressure) * regulator.k_4 * by_flow,
        'k_v': regulator.k_3(pressure, ambient_pressure) * regulator.k_5 * by_flow,
        'tau': regulator.aspirator.tau(pressure, regulator.temperature, polytropic_exponent),
    }
