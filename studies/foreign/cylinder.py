# SPDX-License-Identifier: Apache-2.0
"""
A pneumatic cylinder with regulator, hose and supply, from textbooks.

Mass flows follow ISO 6358 with a laminar part. The supply is a tank behind a restriction. The regulator has a spool of
second order and a sampled PI controller. The hose has two cells. The chamber has an energy balance with its wall. The
equations are independent of `cfd_pneumatic.rig` and `cfd_pneumatic.model`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from cfd_pneumatic.runtime import compiler
from studies.foreign.excitation import RATE, Array

GAS = 287.05
"""Specific gas constant of air [J/(kg K)]."""

ADIABATIC = 1.4
"""Ratio of the specific heats of air [-]."""

AMBIENT = 101_325.0
"""Ambient pressure [Pa]."""

ROOM = 293.15
"""Ambient temperature, and reference temperature of ISO 6358 [K]."""

DENSITY = 1.185
"""Reference density of ISO 6358 [kg/m^3]."""

LAMINAR = 0.99
"""Pressure ratio above which a flow is laminar [-]."""

SUBSTEPS = 20
"""Runge-Kutta steps in a period of the controller [-]; 20 kHz."""

Function = TypeVar('Function', bound=Callable[..., Any])


class Cylinder(NamedTuple):
    """
    Parameters of a cylinder; conductances in m^3/(s Pa), openings and commands as a share of the full opening.

    Attributes
    ----------
    area, length, dead_volume
        Piston area [m^2], length of the chamber at x = 0 [m], and dead volume [m^3].
    bore_change, bore_position, bore_width
        Relative change of the area along the stroke [-], its position [m] and width [m].
    wall
        Heat conductance of the chamber's wall [W/K].
    leak, leak_per_speed
        Conductance of the leak at rest, and its growth with speed [1/(m/s)] times 1e-10.
    valve, critical_ratio
        Conductance of the open valve, and critical pressure ratio of all flows [-].
    supply_lap, exhaust_lap, bleed
        Overlaps of the spool [-], and conductance of the bleed at the outlet.
    spool_frequency, spool_damping
        Angular frequency [rad/s] and damping ratio [-] of the spool.
    gain, integral_gain, integral_zone
        Gains of the controller [1/Pa], [1/(Pa s)]; error below which the integrator holds [Pa].
    control_steps
        Runge-Kutta steps between updates of the controller.
    line, cell_one, cell_two
        Conductance of each half of the hose; volumes of its cells [m^3].
    tank, feed
        Volume of the supply's tank [m^3], and conductance of its feed.

    """

    area: float
    length: float
    dead_volume: float
    bore_change: float
    bore_position: float
    bore_width: float
    wall: float
    leak: float
    leak_per_speed: float
    valve: float
    critical_ratio: float
    supply_lap: float
    exhaust_lap: float
    bleed: float
    spool_frequency: float
    spool_damping: float
    gain: float
    integral_gain: float
    integral_zone: float
    control_steps: float
    line: float
    cell_one: float
    cell_two: float
    tank: float
    feed: float


class Inputs(NamedTuple):
    """
    What acts on a cylinder, at 1 kHz.

    Attributes
    ----------
    position, velocity
        Position [m] and velocity [m/s] of the piston; the chamber grows with the position.
    target
        Set-point that acts [Pa], absolute.
    feed_pressure, feed_temperature
        Pressure [Pa] and temperature [K] before the tank's feed.
    hose_opening
        Conductance of the hose's second half divided by its nominal value [-].
    stiction
        Change of the command below which the spool sticks [-].

    """

    position: Array
    velocity: Array
    target: Array
    feed_pressure: Array
    feed_temperature: Array
    hose_opening: Array
    stiction: Array


def compiled(function: Function) -> Function:
    """Compile a function on its first call."""
    return cast(Function, compiler()(function))


@compiled
def mass_flow(conductance: float, critical: float, p_from: float, t_from: float, p_to: float, t_to: float) -> float:
    """Return the mass flow through a restriction by ISO 6358 [kg/s]; negative if the gas flows back."""
    high, low, temperature = (p_from, p_to, t_from) if p_from > p_to else (p_to, p_from, t_to)
    ratio = low / high
    if ratio <= critical:
        share = 1.0
    elif ratio <= LAMINAR:
        share = math.sqrt(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2)
    else:
        share = math.sqrt(1.0 - ((LAMINAR - critical) / (1.0 - critical)) ** 2) * (1.0 - ratio) / (1.0 - LAMINAR)
    flow = conductance * DENSITY * high * math.sqrt(ROOM / temperature) * share
    return flow if p_from > p_to else -flow


@compiled
def _derivative(  # type: ignore[no-untyped-def]
    state, rate, device, position, velocity, feed_pressure, feed_temperature, hose_opening, command
) -> None:
    """Write the time derivative of (supply, cell one, cell two, chamber, temperature, spool, its speed)."""
    supply, one_pressure, two_pressure, chamber, temperature, spool, spool_speed = state
    b = device.critical_ratio
    bend = (position - device.bore_position) / device.bore_width
    area = device.area * (1.0 + 0.5 * device.bore_change * (1.0 + math.tanh(bend)))
    widened = 0.5 * device.bore_change * (position + device.bore_width * math.log(math.cosh(bend)))
    volume = device.dead_volume + device.area * (device.length + position + widened)
    inlet = device.valve * max(0.0, min(spool, 1.0) - device.supply_lap)
    outlet = device.valve * max(0.0, min(-spool, 1.0) - device.exhaust_lap) + device.bleed
    fed = mass_flow(device.feed, b, feed_pressure, feed_temperature, supply, feed_temperature)
    supplied = mass_flow(inlet, b, supply, feed_temperature, one_pressure, ROOM)
    exhausted = mass_flow(outlet, b, one_pressure, ROOM, AMBIENT, ROOM)
    between = mass_flow(device.line, b, one_pressure, ROOM, two_pressure, ROOM)
    charged = mass_flow(device.line * hose_opening, b, two_pressure, ROOM, chamber, temperature)
    leak = device.leak + 1e-10 * device.leak_per_speed * abs(velocity)
    leaked = mass_flow(leak, b, chamber, temperature, AMBIENT, ROOM)
    enthalpy = charged * (ROOM if charged > 0.0 else temperature) - leaked * temperature
    heat = device.wall * (ROOM - temperature)
    growth = area * velocity
    mass = chamber * volume / (GAS * temperature)
    rate[0] = GAS * feed_temperature / device.tank * (fed - supplied)
    rate[1] = GAS * ROOM / device.cell_one * (supplied - exhausted - between)
    rate[2] = GAS * ROOM / device.cell_two * (between - charged)
    rate[3] = (ADIABATIC * (GAS * enthalpy - chamber * growth) + (ADIABATIC - 1.0) * heat) / volume
    rate[4] = temperature * (rate[3] / chamber + growth / volume - (charged - leaked) / mass)
    rate[5] = spool_speed
    pull = device.spool_frequency * (command - spool) - 2.0 * device.spool_damping * spool_speed
    rate[6] = device.spool_frequency * pull


@compiled
def _simulate(device, inputs):  # type: ignore[no-untyped-def]
    count = inputs.position.size
    step = 1.0 / (RATE * SUBSTEPS)
    state = np.zeros(7)
    state[0] = inputs.feed_pressure[0]
    state[1:4] = inputs.target[0]
    state[4] = ROOM
    trial, slopes = np.empty(7), np.empty((4, 7))
    answer = np.empty((3, count))
    integral = command = stuck_at = 0.0
    for k in range(count):
        answer[0, k], answer[1, k], answer[2, k] = state[3], state[0], state[4]
        after = min(k + 1, count - 1)
        for substep in range(SUBSTEPS):
            if substep % int(device.control_steps) == 0:
                error = inputs.target[k] - state[1]
                wanted = device.gain * error + integral
                if abs(error) > device.integral_zone and (abs(wanted) < 1.0 or wanted * error < 0.0):
                    integral += device.integral_gain * error * step * device.control_steps
                wanted = max(-1.0, min(wanted, 1.0))
                if abs(wanted - stuck_at) >= inputs.stiction[k]:
                    stuck_at = wanted
                command = stuck_at
            for stage in range(4):
                ahead = (0.0, 0.5, 0.5, 1.0)[stage]
                for i in range(7):
                    trial[i] = state[i] + (ahead * step * slopes[stage - 1, i] if stage else 0.0)
                share = (substep + ahead) / SUBSTEPS
                start, end = inputs.position[k], inputs.position[after]
                v_start, v_end = inputs.velocity[k] / RATE, inputs.velocity[after] / RATE
                rise = end - start
                bow = v_start + v_end - 2.0 * rise
                bend = rise - v_start - bow
                position = start + share * (v_start + share * (bend + share * bow))
                velocity = RATE * (v_start + share * (2.0 * bend + share * 3.0 * bow))
                _derivative(
                    trial,
                    slopes[stage],
                    device,
                    position,
                    velocity,
                    inputs.feed_pressure[k],
                    inputs.feed_temperature[k],
                    inputs.hose_opening[k],
                    command,
                )
            for i in range(7):
                change = slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i]
                state[i] += step / 6.0 * change
    return answer


def simulate(device: Cylinder, inputs: Inputs) -> tuple[Array, Array, Array]:
    """Return chamber pressure [Pa], supply pressure [Pa] and chamber temperature [K] at 1 kHz."""
    chamber, supply, temperature = _simulate(device, inputs)
    return chamber, supply, temperature


@compiled
def lugre_friction(velocity: Array, coulomb: float, static: float, viscous: float) -> Array:
    """Return LuGre friction [N] of a velocity at 1 kHz; levels [N], viscous part [N s/m]."""
    stiffness, damping, stribeck = 1e5, 50.0, 5e-3
    force = np.empty_like(velocity)
    bristle = 0.0
    for k in range(velocity.size):
        speed = velocity[k]
        limit = coulomb + (static - coulomb) * math.exp(-((speed / stribeck) ** 2))
        change = 0.0
        for _ in range(SUBSTEPS):
            change = speed - stiffness * abs(speed) / limit * bristle
            bristle += change / (RATE * SUBSTEPS)
        force[k] = stiffness * bristle + damping * change + viscous * speed
    return force
