"""
The rig's physics: compressible flow through two poppets and a tube into two chambers, and a seal that rubs.

Everything that is compiled stands in this one module, in the order in which air meets it: Numba's cache watches a
function's own file only, so that a callee in another file could change unnoticed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.rig.compiled import compiled
from cfd_pneumatic.rig.parameters import Air, Cylinder, RigParameters, Seal

OUTLET, SENSED = 0, 1
"""Columns of the state of a cylinder: outlet (cylinder) pressure and control chamber pressure, absolute [Pa]."""

REFERENCE_DENSITY = 1.185
"""Density of air at ISO 6358's reference conditions, 100 kPa, 293.15 K and 65 % humidity [kg/m^3]."""

REFERENCE_TEMPERATURE = 293.15
"""Temperature of ISO 6358's reference conditions [K]."""

LAMINAR_RATIO = 0.999
"""Pressure ratio above which an orifice is taken as laminar: the ellipse of ISO 6358 has no finite slope at 1."""


@compiled
def flow_function(ratio: float, critical_ratio: float) -> float:
    """Return an orifice's flow over its choked flow for a ratio of absolute pressures (ISO 6358-1:2013)."""
    if ratio <= critical_ratio:
        return 1.0
    if ratio > LAMINAR_RATIO:
        edge = (LAMINAR_RATIO - critical_ratio) / (1.0 - critical_ratio)
        return math.sqrt(1.0 - edge * edge) * (1.0 - ratio) / (1.0 - LAMINAR_RATIO)
    beyond = (ratio - critical_ratio) / (1.0 - critical_ratio)
    return math.sqrt(1.0 - beyond * beyond)


@compiled
def orifice_flow(
    conductance: float, upstream: float, downstream: float, critical_ratio: float, temperature: float
) -> float:
    """
    Return the mass flow [kg/s] through an orifice of some sonic conductance [m^3/(s Pa)], after ISO 6358-1:2013.

    Pressures are absolute [Pa]. Air flows back where the downstream pressure is the higher one.
    """
    high = max(upstream, downstream)
    low = min(upstream, downstream)
    choked = conductance * high * REFERENCE_DENSITY * math.sqrt(REFERENCE_TEMPERATURE / temperature)
    flow = choked * flow_function(low / high, critical_ratio)
    return flow if upstream >= downstream else -flow


@compiled
def tube_flow(
    diameter: float, length: float, upstream: float, downstream: float, mean_pressure: float, air: Air
) -> float:
    """
    Return the laminar mass flow [kg/s] through a round tube (Hagen and Poiseuille).

    Diameter and length in m; pressures absolute [Pa], the mean one gives the density.
    """
    density = mean_pressure / (air.gas_constant * air.temperature)
    return density * math.pi * diameter**4 / (128.0 * air.viscosity * length) * (upstream - downstream)


@compiled
def felt(pressure: float, cylinder: Cylinder) -> float:
    """Return the absolute pressure [Pa] that the coefficients follow: the true one, unless they are frozen."""
    return cylinder.reference_pressure + cylinder.pressure_dependence * (pressure - cylinder.reference_pressure)


@compiled
def supply_opening(setpoint: float, sensed: float, cylinder: Cylinder, air: Air) -> float:
    """Return the supply valve's sonic conductance [m^3/(s Pa)]: proportional to what is missing, up to the stop."""
    growth = 1.0 + cylinder.supply_gain_growth * max(felt(setpoint, cylinder) - air.ambient_pressure, 0.0)
    return min(max(cylinder.supply_gain * growth * (setpoint - sensed), 0.0), cylinder.supply_conductance)


@compiled
def relief_opening(setpoint: float, sensed: float, cylinder: Cylinder) -> float:
    """Return the relief valve's sonic conductance [m^3/(s Pa)]: proportional to the excess, up to the stop."""
    return min(max(cylinder.relief_gain * (sensed - setpoint), 0.0), cylinder.relief_conductance)


@compiled
def cylinder_rates(
    outlet: float, sensed: float, setpoint: float, position: float, velocity: float, cylinder: Cylinder, air: Air
) -> tuple[float, float]:
    """
    Return the rates of change [Pa/s] of a cylinder's outlet and sensed pressure.

    Mass balance of both chambers with a polytropic change of state: V dp/dt = n (R T dm/dt - p dV/dt). Position [m] and
    velocity [m/s] count in the direction in which the volume grows; pressures and set-point are absolute [Pa].
    """
    pressure = felt(outlet, cylinder)
    heat = air.gas_constant * air.temperature
    supply = orifice_flow(
        supply_opening(setpoint, sensed, cylinder, air),
        air.supply_pressure,
        pressure,
        cylinder.supply_critical_ratio,
        air.temperature,
    )
    relief = orifice_flow(
        relief_opening(setpoint, sensed, cylinder),
        pressure,
        air.ambient_pressure,
        cylinder.relief_critical_ratio,
        air.temperature,
    )
    mean_pressure = 0.5 * (pressure + felt(sensed, cylinder))
    aspirated = tube_flow(cylinder.aspirator_diameter, cylinder.aspirator_length, outlet, sensed, mean_pressure, air)

    volume = cylinder.rest_volume + cylinder.position_dependence * cylinder.area * position
    exponent = cylinder.polytropic_exponent
    outlet_rate = exponent / volume * (heat * (supply - relief - aspirated) - pressure * cylinder.area * velocity)
    sensed_rate = exponent / cylinder.control_volume * heat * aspirated
    return outlet_rate, sensed_rate


@compiled
def rubbed(stretch: float, path: float, seal: Seal) -> float:
    """
    Return the seal's stretch, -1 to 1, after the piston has gone a path [m] one way.

    Dahl's model with exponent 1 is linear in the displacement, so this is exact: it nears 1 or -1 along the path.
    """
    direction = math.copysign(1.0, path)
    return direction + (stretch - direction) * math.exp(-abs(path) / seal.presliding)


@compiled
def friction(stretch: float, velocity: float, gauge_pressures: float, seal: Seal) -> float:
    """Return the friction [N] against +x; `gauge_pressures` is both cylinders' sum [Pa], velocity in m/s."""
    return (seal.coulomb + seal.coulomb_per_pressure * gauge_pressures) * stretch + seal.viscous * velocity


@compiled
def contact_force(
    outlet_a: float, outlet_b: float, stretch: float, velocity: float, acceleration: float, parameters: RigParameters
) -> float:
    """Return the force on the workpiece along +x [N]: the air's, less the piston's inertia and the seals' friction."""
    gauge_a = outlet_a - parameters.air.ambient_pressure
    gauge_b = outlet_b - parameters.air.ambient_pressure
    piston = parameters.piston
    thrust = (gauge_a * parameters.cylinder_a.area - gauge_b * parameters.cylinder_b.area) * piston.geometric_factor
    rubbing = friction(stretch, velocity, gauge_a + gauge_b, parameters.seal)
    return thrust - piston.mass * acceleration - rubbing


@compiled
def position_between(fraction: float, period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """
    Return the position [m] at a fraction of the time between two knots a period [s] apart (cubic Hermite).

    x0, x1 are the knots' positions [m], v0, v1 their velocities [m/s].
    """
    rest = 1.0 - fraction
    return rest * rest * ((1.0 + 2.0 * fraction) * x0 + fraction * period * v0) + fraction * fraction * (
        (1.0 + 2.0 * rest) * x1 - rest * period * v1
    )


@compiled
def velocity_between(fraction: float, period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """Return the velocity [m/s] at a fraction of the time between two knots, the derivative of `position_between`."""
    rest = 1.0 - fraction
    return (
        6.0 * fraction * rest * (x1 - x0) / period
        + rest * (1.0 - 3.0 * fraction) * v0
        + fraction * (3.0 * fraction - 2.0) * v1
    )


@compiled
def acceleration_at_end(period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """Return the acceleration [m/s^2] with which a piece of motion arrives at its second knot."""
    return (6.0 * (x0 - x1) / period + 2.0 * v0 + 4.0 * v1) / period


@compiled
def step_cylinder(
    state: NDArray[np.float64],
    setpoint: float,
    start: tuple[float, float],
    middle: tuple[float, float],
    end: tuple[float, float],
    duration: float,
    cylinder: Cylinder,
    air: Air,
) -> None:
    """
    Advance a cylinder's state in place by one step of the classical Runge-Kutta method, `duration` [s] long.

    `start`, `middle` and `end` are the position [m] and velocity [m/s] at those times of the step.
    """
    p, f = state[OUTLET], state[SENSED]
    p1, f1 = cylinder_rates(p, f, setpoint, start[0], start[1], cylinder, air)
    half = 0.5 * duration
    p2, f2 = cylinder_rates(p + half * p1, f + half * f1, setpoint, middle[0], middle[1], cylinder, air)
    p3, f3 = cylinder_rates(p + half * p2, f + half * f2, setpoint, middle[0], middle[1], cylinder, air)
    p4, f4 = cylinder_rates(p + duration * p3, f + duration * f3, setpoint, end[0], end[1], cylinder, air)
    state[OUTLET] += duration / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
    state[SENSED] += duration / 6.0 * (f1 + 2.0 * f2 + 2.0 * f3 + f4)


@compiled
def advance(
    pressures: NDArray[np.float64],
    stretch: float,
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    setpoints: NDArray[np.float64],
    period: float,
    steps: int,
    parameters: RigParameters,
    trajectory: NDArray[np.float64],
    forces: NDArray[np.float64],
    accelerations: NDArray[np.float64],
) -> float:
    """
    Carry the rig along a motion and return the seal's stretch at its end.

    Parameters
    ----------
    pressures : (2, 2)
        State of the cylinders A and B, absolute [Pa]; advanced in place.
    stretch
        State of the seal, -1 to 1.
    positions, velocities : (knots + 1,)
        Knots of the motion [m], [m/s], the present one first; cubic in between.
    setpoints : (knots, 2)
        Absolute set pressure [Pa] on the way to each knot.
    period
        Time between knots [s].
    steps
        Integration steps between knots.
    parameters
        The rig.
    trajectory : (knots, 2, 2)
        Receives the state at each knot [Pa].
    forces, accelerations : (knots,)
        Receive the contact force [N] and the acceleration [m/s^2] at each knot.

    """
    duration = period / steps
    for knot in range(setpoints.shape[0]):
        x0, v0 = positions[knot], velocities[knot]
        x1, v1 = positions[knot + 1], velocities[knot + 1]
        x, v = x0, v0
        for step in range(steps):
            middle = (step + 0.5) / steps
            end = (step + 1.0) / steps
            x_middle = position_between(middle, period, x0, v0, x1, v1)
            v_middle = velocity_between(middle, period, x0, v0, x1, v1)
            x_end = position_between(end, period, x0, v0, x1, v1)
            v_end = velocity_between(end, period, x0, v0, x1, v1)
            step_cylinder(
                pressures[0],
                setpoints[knot, 0],
                (x, v),
                (x_middle, v_middle),
                (x_end, v_end),
                duration,
                parameters.cylinder_a,
                parameters.air,
            )
            step_cylinder(
                pressures[1],
                setpoints[knot, 1],
                (-x, -v),
                (-x_middle, -v_middle),
                (-x_end, -v_end),
                duration,
                parameters.cylinder_b,
                parameters.air,
            )
            stretch = rubbed(stretch, x_end - x, parameters.seal)
            x, v = x_end, v_end
        trajectory[knot] = pressures
        accelerations[knot] = acceleration_at_end(period, x0, v0, x1, v1)
        forces[knot] = contact_force(
            pressures[0, OUTLET], pressures[1, OUTLET], stretch, v1, accelerations[knot], parameters
        )
    return stretch
