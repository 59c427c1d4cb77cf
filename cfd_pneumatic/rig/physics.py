# SPDX-License-Identifier: Apache-2.0
"""
The rig's physics: compressible flow through valves and a tube into two chambers, and friction of the seals.

All compiled functions are in this module, in the order of the air's path. Numba's cache tracks changes of a function's
file only and would miss a change of a called function in another file.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.compilation import compiled, inner
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.oddities import ForceOddities, Oddities
from cfd_pneumatic.rig.parameters import Air, Cylinder, RigParameters, Seal


class CylinderState(NamedTuple):
    """A cylinder's state, or its rates of change; all but the first two are constant without effects."""

    outlet: float
    """Absolute pressure in the cylinder [Pa]."""

    sensed: float
    """Absolute pressure in the regulator's control chamber [Pa]."""

    regulator: float
    """Absolute pressure upstream of a line's resistance [Pa]."""

    temperature: float
    """Temperature of the cylinder's air, if heat is exchanged [K]."""

    droop: float
    """Decrease of the set pressure by the flow [Pa]."""

    poppet: float
    """Position of a valve with mass, as the error at which the valve would rest there [Pa]."""

    poppet_rate: float
    """Speed of a valve with mass [Pa/s]."""

    starved: float
    """Loss of supply pressure at the supply valve [Pa]."""


OUTLET, SENSED = 0, 1
"""Columns of a cylinder's state that other modules read, as in `CylinderState`."""

PLAY = len(CylinderState._fields)
"""Column after those of `CylinderState`: the error after the valve's backlash [Pa]."""

STATES = PLAY + 1
"""Number of columns."""

ADIABATIC_EXPONENT = 1.4
"""Ratio of the specific heats of air."""

SPECIFIC_HEAT = 717.6
"""Specific heat of air at constant volume [J/(kg K)]."""

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

SEATING_SPEED = 5e-3
"""Speed above which a lifting seal has taken the position of its direction of travel [m/s]."""

ONE_WAY_SPEED = 2e-3
"""Speed above which a rolling seal has rolled over [m/s]."""

LEAK_CRITICAL_RATIO = 0.4
"""Critical pressure ratio of a hole with rough edges."""

ELLIPSE = 0.5
"""Subsonic index that makes an orifice's flow an ellipse [-]."""

REFERENCE_DENSITY = 1.185
"""Density of air at ISO 6358's reference conditions, 100 kPa, 293.15 K and 65 % humidity [kg/m^3]."""

REFERENCE_TEMPERATURE = 293.15
"""Temperature of ISO 6358's reference conditions [K]."""

LAMINAR_RATIO = 0.999
"""Pressure ratio above which an orifice is laminar; the ellipse of ISO 6358 has no finite slope at 1."""


@inner
def flow_function(ratio: float, critical_ratio: float, index: float) -> float:
    """
    Return the flow / choked flow of an orifice at a ratio of absolute pressures (ISO 6358-1:2013).

    `index` is the subsonic index: 0.5 makes the flow an ellipse.
    """
    if ratio <= critical_ratio:
        return 1.0
    beyond = (min(ratio, LAMINAR_RATIO) - critical_ratio) / (1.0 - critical_ratio)
    subsonic: float = (1.0 - beyond * beyond) ** index
    return subsonic * (1.0 - ratio) / (1.0 - LAMINAR_RATIO) if ratio > LAMINAR_RATIO else subsonic


@inner
def orifice_flow(
    conductance: float, upstream: float, downstream: float, critical_ratio: float, index: float, temperature: float
) -> float:
    """
    Return the mass flow [kg/s] through an orifice by its sonic conductance [m^3/(s Pa)] and ISO 6358-1:2013.

    Pressures are absolute [Pa]. The flow is negative if the downstream pressure is higher.
    """
    high = max(upstream, downstream)
    low = min(upstream, downstream)
    choked = conductance * high * REFERENCE_DENSITY * math.sqrt(REFERENCE_TEMPERATURE / temperature)
    flow = choked * flow_function(low / high, critical_ratio, index)
    return flow if upstream >= downstream else -flow


@inner
def tube_flow(
    diameter: float,
    length: float,
    upstream: float,
    downstream: float,
    mean_pressure: float,
    entrance_loss: float,
    air: Air,
) -> float:
    """
    Return the mass flow [kg/s] through a round tube with a loss at its entrance (Hagen and Poiseuille).

    Diameter and length are in m, pressures absolute [Pa]; the mean pressure gives the density. The entrance halves the
    flow at a pressure difference of `entrance_loss` [Pa]; 0: no loss.
    """
    density = mean_pressure / (air.gas_constant * air.temperature)
    laminar = density * math.pi * diameter**4 / (128.0 * air.viscosity * length) * (upstream - downstream)
    if entrance_loss == 0.0:
        return laminar
    return 2.0 * laminar / (1.0 + math.sqrt(1.0 + 8.0 * abs(upstream - downstream) / entrance_loss))


@inner
def effective_pressure(pressure: float, cylinder: Cylinder) -> float:
    """Return the absolute pressure on which the coefficients depend [Pa]; constant for the paper's device."""
    return cylinder.reference_pressure + cylinder.pressure_dependence * (pressure - cylinder.reference_pressure)


@inner
def backlash(held: float, target: float, half_width: float) -> float:
    """Return the position of a part that follows its target with backlash, from its last position."""
    return min(max(held, target - half_width), target + half_width)


@inner
def valve_error(state: CylinderState, setpoint: float, effects: Effects) -> float:
    """Return the error that moves the valves [Pa]: that of the diaphragm, or the position of a poppet with mass."""
    return state.poppet if effects.poppet_frequency > 0.0 else setpoint - state.droop - state.sensed


@inner
def gaussian(position: float, middle: float, width: float) -> float:
    """Return a Gaussian: 1 in the middle, and exp(-1) at a width from the middle."""
    return math.exp(-(((position - middle) / width) ** 2))


@inner
def worn_valve_error(error: float, odd: Oddities) -> float:
    """Return the error [Pa] at which a valve with a good seat has the same opening."""
    if odd.groove == 0.0:
        return error
    return error * (1.0 + odd.groove * gaussian(abs(error), odd.groove_error, odd.groove_width))


@inner
def odd_error(position: float, velocity: float, odd: Oddities) -> float:
    """Return the additional valve error by a ledge along the stroke and by suction at the control port [Pa]."""
    suction = 0.0
    if odd.port != 0.0:
        suction = odd.port * (1.0 - gaussian(velocity, 0.0, odd.port_speed))
    if odd.ledge == 0.0:
        return suction
    return suction + 0.5 * odd.ledge * (1.0 + math.tanh((position - odd.ledge_position) / odd.ledge_length))


@inner
def odd_leak(gauge: float, velocity: float, odd: Oddities) -> float:
    """Return the mass flow [kg/s] past a seal that lifts at speed, and through an open relief valve."""
    past_seal = odd.lifting * velocity**2 / (velocity**2 + odd.lifting_speed**2) * gauge
    return past_seal + odd.pop * max(gauge - odd.pop_pressure, 0.0)


@inner
def swept_velocity(position: float, velocity: float, odd: Oddities) -> float:
    """Return the speed [m/s] at which a piston in an even bore sweeps the same volume."""
    if odd.bulge != 0.0:
        velocity *= 1.0 + odd.bulge * gaussian(position, odd.bulge_position, odd.bulge_length)
    if odd.one_way != 0.0:
        velocity *= 1.0 + odd.one_way * math.tanh(velocity / ONE_WAY_SPEED)
    return velocity


@inner
def compliance_factor(gauge: float, odd: Oddities) -> float:
    """Return the factor of the chamber's volume at a gauge pressure [Pa]."""
    if odd.soft == 0.0:
        return 1.0
    return 1.0 + 0.5 * odd.soft * (1.0 + math.tanh((gauge - odd.soft_pressure) / odd.soft_width))


@inner
def valve_characteristic(error: float, effects: Effects) -> float:
    """Return the error [Pa] at which a linear valve has the same opening, with dead band and exponent."""
    beyond = 0.0
    if error > effects.dead_band:
        beyond = error - effects.dead_band
    elif error < -effects.dead_band:
        beyond = error + effects.dead_band
    if effects.valve_exponent == 1.0:
        return beyond
    share = abs(beyond) / effects.valve_pivot
    return math.copysign(effects.valve_pivot * share**effects.valve_exponent, beyond)


@inner
def supply_opening(error: float, setpoint: float, cylinder: Cylinder, air: Air) -> float:
    """Return the supply valve's sonic conductance [m^3/(s Pa)], proportional to a positive error up to the stop."""
    growth = 1.0 + cylinder.supply_gain_growth * max(effective_pressure(setpoint, cylinder) - air.ambient_pressure, 0.0)
    return min(max(cylinder.supply_gain * growth * error, 0.0), cylinder.supply_conductance)


@inner
def relief_opening(error: float, cylinder: Cylinder) -> float:
    """
    Return the relief valve's sonic conductance [m^3/(s Pa)], proportional to a negative error up to the stop.

    A silencer is a second orifice in series; the inverse cubes of the conductances add up.
    """
    opened = min(max(cylinder.relief_gain * -error, 0.0), cylinder.relief_conductance)
    if cylinder.silencer_conductance == 0.0:
        return opened
    throttled: float = (1.0 + (opened / cylinder.silencer_conductance) ** 3) ** (1.0 / 3.0)
    return opened / throttled


@inner
def seal_lift(position: float, velocity: float, effects: Effects) -> float:
    """Return the lift of the seal, 0 to 1, at a position [m] and velocity [m/s]."""
    near = 0.5 * (1.0 + math.tanh(effects.lift_end * (position - effects.lift_position) / effects.lift_width))
    if effects.lift_direction == 0.0:
        return near
    return near * 0.5 * (1.0 + math.tanh(effects.lift_direction * velocity / SEATING_SPEED))


@inner
def leak_flow(outlet: float, position: float, velocity: float, effects: Effects, air: Air) -> float:
    """Return the leak from the cylinder to ambient [kg/s], through a hole, a gap and a lifting seal."""
    flow = effects.leak_admittance * (outlet - air.ambient_pressure)
    if effects.leak_conductance > 0.0:
        flow += orifice_flow(
            effects.leak_conductance, outlet, air.ambient_pressure, LEAK_CRITICAL_RATIO, ELLIPSE, air.temperature
        )
    if effects.lift_admittance > 0.0:
        lifted = seal_lift(position, velocity, effects)
        flow += lifted * effects.lift_admittance * (outlet - air.ambient_pressure)
    return flow


@inner
def cylinder_rates(
    state: CylinderState,
    play: float,
    setpoint: float,
    position: float,
    velocity: float,
    cylinder: Cylinder,
    effects: Effects,
    odd: Oddities,
    air: Air,
) -> CylinderState:
    """
    Return the rates of change of a cylinder's state.

    Without exchange of heat the change of state is polytropic: V dp/dt = n (R T dm/dt - p dV/dt). With exchange of heat
    the rates follow from the energy balance. Position [m] and velocity [m/s] are positive towards larger volume.
    The set-point is absolute [Pa]; `play` is the last error after the valve's backlash [Pa].
    """
    restricted = effects.line_resistance > 0.0
    regulator_outlet = state.regulator if restricted else state.outlet
    pressure = effective_pressure(regulator_outlet, cylinder)
    heat = air.gas_constant * air.temperature
    error = valve_error(state, setpoint + odd_error(position, velocity, odd), effects)
    opened = worn_valve_error(valve_characteristic(backlash(play, error, effects.play), effects), odd)
    supply = orifice_flow(
        supply_opening(opened, setpoint, cylinder, air),
        air.supply_pressure - state.starved,
        pressure,
        cylinder.supply_critical_ratio,
        cylinder.supply_subsonic_index,
        air.temperature,
    )
    relief = orifice_flow(
        relief_opening(opened, cylinder),
        pressure,
        air.ambient_pressure,
        cylinder.relief_critical_ratio,
        cylinder.relief_subsonic_index,
        air.temperature,
    )
    mean_pressure = 0.5 * (pressure + effective_pressure(state.sensed, cylinder))
    aspirator_flow = tube_flow(
        cylinder.aspirator_diameter,
        cylinder.aspirator_length,
        regulator_outlet,
        state.sensed,
        mean_pressure,
        cylinder.entrance_loss,
        air,
    )
    gauge = state.outlet - air.ambient_pressure
    leaked = leak_flow(state.outlet, position, velocity, effects, air) + odd_leak(gauge, velocity, odd)

    exponent = cylinder.polytropic_exponent
    gained = supply - relief - aspirator_flow
    regulator_rate = 0.0
    if restricted:
        through = (state.regulator - state.outlet) / effects.line_resistance
        regulator_rate = exponent / effects.outlet_volume * heat * (gained - through)
        gained = through
        pressure = effective_pressure(state.outlet, cylinder)
    gained -= leaked

    volume = cylinder.rest_volume + cylinder.position_dependence * cylinder.area * position
    volume *= compliance_factor(gauge, odd)
    work = pressure * cylinder.area * swept_velocity(position, velocity, odd)
    if effects.heat_transfer > 0.0:
        # mass and temperature of the air depend on the true pressure, also for constant coefficients
        outlet_rate, temperature_rate = heat_exchange_rates(
            state.outlet, state.temperature, gained, volume, work, wall_conductance(velocity, effects), air
        )
    else:
        outlet_rate = exponent / volume * (heat * gained - work)
        temperature_rate = 0.0
    sensed_rate = exponent / cylinder.control_volume * heat * aspirator_flow

    droop_rate = 0.0
    if effects.droop > 0.0:
        droop_rate = (effects.droop * (supply - relief) - state.droop) / effects.droop_lag
    poppet_acceleration = 0.0
    if effects.poppet_frequency > 0.0:
        omega = 2.0 * math.pi * effects.poppet_frequency
        force = omega * (setpoint - state.droop - state.sensed - state.poppet)
        poppet_acceleration = omega * (force - 2.0 * effects.poppet_damping * state.poppet_rate)
    starved_rate = 0.0
    if odd.starving > 0.0:
        starved_rate = (odd.starving * supply - state.starved) / odd.starving_lag
    return CylinderState(
        outlet_rate,
        sensed_rate,
        regulator_rate,
        temperature_rate,
        droop_rate,
        state.poppet_rate,
        poppet_acceleration,
        starved_rate,
    )


@inner
def wall_conductance(velocity: float, effects: Effects) -> float:
    """Return the wall's heat conductance [W/K], which increases with the piston's speed."""
    return effects.heat_transfer * (1.0 + effects.stirring * abs(velocity))


@inner
def heat_exchange_rates(
    pressure: float, temperature: float, gained: float, volume: float, work: float, heat_transfer: float, air: Air
) -> tuple[float, float]:
    """
    Return the rates of change of pressure [Pa/s] and temperature [K/s] of air that exchanges heat with its wall.

    The rates follow from the energy balance of an open chamber, which is adiabatic at first and finally isothermal.
    Inflow has the wall's temperature, outflow the chamber's. `gained` is the net mass flow [kg/s], `work` the power on
    the piston [W] and `heat_transfer` the wall's heat conductance [W/K].
    """
    carried = air.gas_constant * (air.temperature if gained > 0.0 else temperature) * gained
    warming = heat_transfer * (air.temperature - temperature)
    pressure_rate = (ADIABATIC_EXPONENT * (carried - work) + (ADIABATIC_EXPONENT - 1.0) * warming) / volume
    mass = pressure * volume / (air.gas_constant * temperature)
    return pressure_rate, temperature * ((pressure_rate + work / volume) / pressure - gained / mass)


@inner
def seal_stretch(stretch: float, path: float, seal: Seal) -> float:
    """
    Return the seal's stretch, -1 to 1, after a path of the piston in one direction [m].

    The solution is exact, because Dahl's model with exponent 1 is linear in the displacement.
    """
    direction = math.copysign(1.0, path)
    return direction + (stretch - direction) * math.exp(-abs(path) / seal.presliding)


@inner
def friction(stretch: float, velocity: float, gauge_pressures: float, seal: Seal) -> float:
    """Return the friction against +x [N]; `gauge_pressures` is the sum of both cylinders [Pa], velocity in m/s."""
    sticking = seal.breakaway * math.exp(-((velocity / seal.stribeck_speed) ** 2))
    return (seal.coulomb + seal.coulomb_per_pressure * gauge_pressures + sticking) * stretch + seal.viscous * velocity


@inner
def odd_drag(position: float, stretch: float, odd: ForceOddities) -> float:
    """Return the force of a scar in the bore and of tight cables against +x [N]."""
    drag = 0.0
    if odd.scar > 0.0:
        drag += odd.scar * gaussian(position, odd.scar_position, odd.scar_length) * stretch
    if odd.bundle > 0.0:
        drag += odd.bundle * math.copysign(max(abs(position) - odd.bundle_slack, 0.0), position)
    return drag


@inner
def contact_force(
    outlets: tuple[float, float], stretch: float, motion: tuple[float, float, float], parameters: RigParameters
) -> float:
    """
    Return the force on the workpiece along +x [N]: that of the air without inertia, weight and friction.

    `outlets` are the absolute pressures in A and B [Pa], `motion` is the piston's position [m], velocity [m/s] and
    acceleration [m/s^2].
    """
    position, velocity, acceleration = motion
    gauge_a = outlets[0] - parameters.air.ambient_pressure
    gauge_b = outlets[1] - parameters.air.ambient_pressure
    piston = parameters.piston
    thrust = (gauge_a * parameters.cylinder_a.area - gauge_b * parameters.cylinder_b.area) * piston.geometric_factor
    rubbing = friction(stretch, velocity, gauge_a + gauge_b, parameters.seal)
    rubbing += odd_drag(position, stretch, parameters.odd_force)
    return thrust - piston.mass * acceleration - rubbing - piston.mass * GRAVITY * math.sin(piston.inclination)


@inner
def position_between(fraction: float, period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """
    Return the position [m] at a fraction of the time between two knots a period [s] apart (cubic Hermite).

    x0, x1 are the knots' positions [m], v0, v1 their velocities [m/s].
    """
    remaining = 1.0 - fraction
    return remaining * remaining * ((1.0 + 2.0 * fraction) * x0 + fraction * period * v0) + fraction * fraction * (
        (1.0 + 2.0 * remaining) * x1 - remaining * period * v1
    )


@inner
def velocity_between(fraction: float, period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """Return the velocity [m/s] at a fraction of the time between two knots, the derivative of `position_between`."""
    remaining = 1.0 - fraction
    return (
        6.0 * fraction * remaining * (x1 - x0) / period
        + remaining * (1.0 - 3.0 * fraction) * v0
        + fraction * (3.0 * fraction - 2.0) * v1
    )


@inner
def acceleration_at_end(period: float, x0: float, v0: float, x1: float, v1: float) -> float:
    """Return the acceleration at the second of two knots [m/s^2]."""
    return (6.0 * (x0 - x1) / period + 2.0 * v0 + 4.0 * v1) / period


@inner
def extrapolated(state: CylinderState, rates: CylinderState, duration: float) -> CylinderState:
    """Return a state after a duration [s] at constant rates of change."""
    return CylinderState(
        state.outlet + duration * rates.outlet,
        state.sensed + duration * rates.sensed,
        state.regulator + duration * rates.regulator,
        state.temperature + duration * rates.temperature,
        state.droop + duration * rates.droop,
        state.poppet + duration * rates.poppet,
        state.poppet_rate + duration * rates.poppet_rate,
        state.starved + duration * rates.starved,
    )


@inner
def step_cylinder(
    states: Array,
    setpoint: float,
    start: tuple[float, float],
    middle: tuple[float, float],
    end: tuple[float, float],
    duration: float,
    cylinder: Cylinder,
    effects: Effects,
    odd: Oddities,
    air: Air,
) -> None:
    """
    Advance a cylinder's state in place by a step of the classical Runge-Kutta method of a duration [s].

    `start`, `middle` and `end` are position [m] and velocity [m/s] at these times of the step.
    """
    now = CylinderState(states[0], states[1], states[2], states[3], states[4], states[5], states[6], states[7])
    play = states[PLAY]
    half = 0.5 * duration
    k1 = cylinder_rates(now, play, setpoint, start[0], start[1], cylinder, effects, odd, air)
    k2 = cylinder_rates(extrapolated(now, k1, half), play, setpoint, middle[0], middle[1], cylinder, effects, odd, air)
    k3 = cylinder_rates(extrapolated(now, k2, half), play, setpoint, middle[0], middle[1], cylinder, effects, odd, air)
    k4 = cylinder_rates(extrapolated(now, k3, duration), play, setpoint, end[0], end[1], cylinder, effects, odd, air)
    for index in range(PLAY):
        states[index] += duration / 6.0 * (k1[index] + 2.0 * k2[index] + 2.0 * k3[index] + k4[index])
    then = CylinderState(states[0], states[1], states[2], states[3], states[4], states[5], states[6], states[7])
    states[PLAY] = backlash(play, valve_error(then, setpoint, effects), effects.play)


@compiled
def advance(
    states: Array,
    stretch: float,
    positions: Array,
    velocities: Array,
    setpoints: Array,
    period: float,
    steps: int,
    parameters: RigParameters,
    trajectory: Array,
    forces: Array,
    accelerations: Array,
) -> float:
    """
    Advance the rig along a motion and return the final stretch of the seal.

    Parameters
    ----------
    states : (2, STATES)
        States of the cylinders A and B; advanced in place.
    stretch
        Stretch of the seal, -1 to 1.
    positions, velocities : (knots + 1,)
        Knots of the motion [m], [m/s], the present state first; cubic in between.
    setpoints : (knots, 2)
        Absolute set pressure until each knot [Pa].
    period
        Time between knots [s].
    steps
        Integration steps between knots.
    parameters
        Parameters of the rig.
    trajectory : (knots, 2, 2)
        Output: outlet and sensed pressures at each knot [Pa].
    forces, accelerations : (knots,)
        Output: contact force [N] and acceleration [m/s^2] at each knot.

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
                states[0],
                setpoints[knot, 0],
                (x, v),
                (x_middle, v_middle),
                (x_end, v_end),
                duration,
                parameters.cylinder_a,
                parameters.effects_a,
                parameters.odd_a,
                parameters.air,
            )
            step_cylinder(
                states[1],
                setpoints[knot, 1],
                (-x, -v),
                (-x_middle, -v_middle),
                (-x_end, -v_end),
                duration,
                parameters.cylinder_b,
                parameters.effects_b,
                parameters.odd_b,
                parameters.air,
            )
            stretch = seal_stretch(stretch, x_end - x, parameters.seal)
            x, v = x_end, v_end
        for cylinder in range(2):
            trajectory[knot, cylinder, OUTLET] = states[cylinder, OUTLET]
            trajectory[knot, cylinder, SENSED] = states[cylinder, SENSED]
        accelerations[knot] = acceleration_at_end(period, x0, v0, x1, v1)
        outlets = (states[0, OUTLET], states[1, OUTLET])
        forces[knot] = contact_force(outlets, stretch, (x1, v1, accelerations[knot]), parameters)
    return stretch
