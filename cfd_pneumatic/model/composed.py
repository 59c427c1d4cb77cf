# SPDX-License-Identifier: Apache-2.0
"""
The paper's equations and every physical effect, each with a switch, integrated by Runge-Kutta of fourth order.

Eight cylinders that differ only in their parameters are simulated in parallel, in the lanes of a processor; a fit gets
its derivatives from them. All numbers that persist between steps are in an array of rows. A row has a number of each
lane.

Written by `make kernel` from the effects, fingerprint 2056ec3723b6b657; do not edit.
"""

from __future__ import annotations

import math

import numpy as np

from cfd_pneumatic.model.effects import (
    curve,
    displacement_delay,
    displacement_lag,
    droop,
    flow_saturation,
    force_curve,
    force_offset,
    heat_transfer,
    leakage,
    line_resonance,
    line_restriction,
    lost_motion,
    moving_mass,
    nonlinear_valve,
    operating_point,
    physical_core,
    positional_leakage,
    seal_friction,
    sensor_lag,
    set_point_drift,
    setpoint_lag,
    stribeck_friction,
    supply_variation,
    valve_dead_band,
    valve_hysteresis,
    volume_variation,
)
from cfd_pneumatic.model.effects.effect import ForceMoment, Moment
from cfd_pneumatic.model.kernels import inlined, kernel
from cfd_pneumatic.model.lanes import COUNT, load, load_floats, load_rows, rows_address, store, where

# states: pressures p and p_f, then those of the effects
Y0, Y1, Y2, Y3, Y4, Y5, Y6, Y7, Y8, Y9, Y10, Y11, Y12 = range(0 * COUNT, 13 * COUNT, COUNT)
# last displacement that the chamber followed, and last measured displacement [m]
FOLLOWED, MEASURED = range(13 * COUNT, 15 * COUNT, COUNT)
# parameters: gains, then the first parameter of each effect
K_X, K_SV, K_V, TAU = range(15 * COUNT, 19 * COUNT, COUNT)
FLOW_SATURATION = 19 * COUNT
PHYSICAL_CORE = 21 * COUNT
SETPOINT_LAG = 33 * COUNT
VOLUME_VARIATION = 34 * COUNT
OPERATING_POINT = 35 * COUNT
SET_POINT_DRIFT = 38 * COUNT
DISPLACEMENT_DELAY = 39 * COUNT
DISPLACEMENT_LAG = 40 * COUNT
SUPPLY_VARIATION = 41 * COUNT
VALVE_HYSTERESIS = 44 * COUNT
DROOP = 45 * COUNT
LEAKAGE = 47 * COUNT
POSITIONAL_LEAKAGE = 49 * COUNT
SETPOINT_DELAY = 55 * COUNT
TRANSPORT_DELAY = 56 * COUNT
LOST_MOTION = 57 * COUNT
SENSOR_LAG = 58 * COUNT
VALVE_DEAD_BAND = 59 * COUNT
LINE_RESONANCE = 60 * COUNT
NONLINEAR_VALVE = 62 * COUNT
LINE_RESTRICTION = 63 * COUNT
CURVE = 65 * COUNT
HEAT_TRANSFER = 89 * COUNT
# results of the effects' `hold` functions, constant between samples
PHYSICAL_CORE_HELD = 90 * COUNT
# difference of each lane's set-point and the common set-point, and of its pressures at the start and its set-point [Pa]
OFFSET, START = range(102 * COUNT, 104 * COUNT, COUNT)
# states and rates of a Runge-Kutta stage, and the weighted sum of the rates
S0, S1, S2, S3, S4, S5, S6, S7, S8, S9, S10, S11, S12 = range(104 * COUNT, 117 * COUNT, COUNT)
K0, K1, K2, K3, K4, K5, K6, K7, K8, K9, K10, K11, K12 = range(117 * COUNT, 130 * COUNT, COUNT)
SUM = 130 * COUNT
# the piston's displacement [m] and speed [m/s], the set-point [Pa], and the reading of the pressure sensor [Pa]
X, RATE, SETPOINT, SIGNAL = range(143 * COUNT, 147 * COUNT, COUNT)

SIZE = 147 * COUNT
"""Length of the array of rows."""

STATE_ROWS = slice(0, 15)
"""Rows of the states: pressures p and p_f, states of the effects, last followed and last measured displacement."""

PARAMETER_ROWS = slice(15, 90)
"""Rows of the parameters: the gains, then those of the effects."""

OFFSET_ROW = OFFSET // COUNT
"""Row of the differences of each lane's set-point and the common set-point [Pa]."""

START_ROW = START // COUNT
"""Row of the differences of each lane's pressures at the start and its set-point [Pa]."""

SIGNAL_ROW = SIGNAL // COUNT
"""Row of the readings of the pressure sensor [Pa]."""

# Runge-Kutta stages: factor of the sum of rates so far, weight of the stage's rate, share of the sum added to the
# states, share of the step for the next stage's states, and share of the step until the next stage
KEPT = np.array([0.0, 1.0, 1.0, 1.0])
WEIGHT = np.array([1.0, 2.0, 2.0, 1.0])
SHARE = np.array([0.0, 0.0, 0.0, 1.0 / 6.0])
AHEAD = np.array([0.5, 0.5, 1.0, 0.0])
PASSED = np.array([0.5, 0.0, 0.5, 0.0])

FORCE_STATES = 3
"""Number of states of the effects on the force."""

SLID = 3
"""Index, after the states, of the last displacement of the seals [m]."""


@inlined
def make_moment(time, p, p_f, swept, sensing, ambient, w, dense):
    """Return the cylinder's present state as the effects' argument."""
    x, rate, setpoint, k_x = load(w, X), load(w, RATE), load(w, SETPOINT), load(w, K_X)
    return Moment(time, x, rate, p, setpoint, ambient, swept, k_x, p_f, sensing, dense)


@inlined
def initial_moment(time, p, p_f, ambient, w):
    """Return the cylinder's present state before any rate is computed."""
    zero = 0.0 * load(w, RATE)
    return make_moment(time, p, p_f, zero, zero, ambient, w, zero + 1.0)


@inlined
def hold(time, ambient, w, on):
    """Compute the values that are constant while the set-point and the piston's speed are."""
    moment = initial_moment(time, load(w, Y0), load(w, Y1), ambient, w)
    if on & 2:
        store(w, PHYSICAL_CORE_HELD, physical_core.hold(moment, *load_rows(w, PHYSICAL_CORE, 12)))


@inlined
def valve_error(moment, w, on):
    """Return the valve error, from the set-point with effects [Pa]."""
    target = moment.setpoint
    if on & 4:
        target = setpoint_lag.setpoint(target, moment, load(w, S3), *load_rows(w, SETPOINT_LAG, 1))
    if on & 32:
        target = set_point_drift.setpoint(target, moment, *load_rows(w, SET_POINT_DRIFT, 1))
    if on & 256:
        target = supply_variation.setpoint(target, moment, *load_rows(w, SUPPLY_VARIATION, 3))
    if on & 1024:
        target = droop.setpoint(target, moment, load(w, S5), *load_rows(w, DROOP, 2))
    if on & 2097152:
        target = curve.setpoint(target, moment, load(w, S11), *load_rows(w, CURVE, 24))
    return target - moment.p_f


@inlined
def compute_rates(time, ambient, w, on):
    """Compute the rates of all states."""
    moment = initial_moment(time, load(w, S0), load(w, S1), ambient, w)
    p, p_f, zero, dense = moment.p, moment.p_f, moment.swept, moment.dense
    if on & 2:
        dense = physical_core.density(dense, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    moment = make_moment(time, p, p_f, zero, zero, ambient, w, dense)
    gain = load(w, K_X)
    if on & 2:
        gain = physical_core.velocity_gain(gain, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    if on & 8:
        gain = volume_variation.velocity_gain(gain, moment, *load_rows(w, VOLUME_VARIATION, 1))
    if on & 16:
        gain = operating_point.velocity_gain(gain, moment, *load_rows(w, OPERATING_POINT, 3))
    if on & 2097152:
        gain = curve.velocity_gain(gain, moment, load(w, S11), *load_rows(w, CURVE, 24))
    swept = gain * moment.rate
    moment = make_moment(time, p, p_f, swept, zero, ambient, w, dense)
    error = valve_error(moment, w, on)
    if on & 2:
        error = physical_core.error(error, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    if on & 512:
        error = valve_hysteresis.error(error, moment, load(w, S4), *load_rows(w, VALVE_HYSTERESIS, 1))
    if on & 131072:
        error = valve_dead_band.error(error, moment, *load_rows(w, VALVE_DEAD_BAND, 1))
    if on & 524288:
        error = nonlinear_valve.error(error, moment, *load_rows(w, NONLINEAR_VALVE, 1))
    flow = where(error > 0.0, load(w, K_SV), load(w, K_V)) * error
    if on & 1:
        flow = flow_saturation.flow(flow, moment, *load_rows(w, FLOW_SATURATION, 2))
    if on & 2:
        flow = physical_core.flow(flow, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    if on & 8:
        flow = volume_variation.flow(flow, moment, *load_rows(w, VOLUME_VARIATION, 1))
    if on & 16:
        flow = operating_point.flow(flow, moment, *load_rows(w, OPERATING_POINT, 3))
    if on & 1048576:
        store(w, K10, line_restriction.evolve(moment, flow, load(w, S10), *load_rows(w, LINE_RESTRICTION, 2)))
        flow = line_restriction.flow(flow, moment, load(w, S10), *load_rows(w, LINE_RESTRICTION, 2))
    if on & 2097152:
        store(w, K11, curve.evolve(moment, flow, load(w, S11), *load_rows(w, CURVE, 24)))
        flow = curve.flow(flow, moment, load(w, S11), *load_rows(w, CURVE, 24))
    if on & 4194304:
        flow = heat_transfer.flow(flow, moment, load(w, S12), *load_rows(w, HEAT_TRANSFER, 1))
    if on & 1024:
        store(w, K5, droop.evolve(moment, flow, load(w, S5), *load_rows(w, DROOP, 2)))
    outlet = p
    if on & 1048576:
        outlet = line_restriction.outlet(outlet, moment, flow, load(w, S10), *load_rows(w, LINE_RESTRICTION, 2))
    tau = load(w, TAU)
    if on & 2:
        tau = physical_core.time_constant(tau, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    if on & 16:
        tau = operating_point.time_constant(tau, moment, *load_rows(w, OPERATING_POINT, 3))
    sensing = (outlet - p_f) / tau
    moment = make_moment(time, p, p_f, swept, sensing, ambient, w, dense)
    chamber = flow - swept
    if on & 2048:
        chamber = leakage.chamber(chamber, moment, *load_rows(w, LEAKAGE, 2))
    if on & 4096:
        chamber = positional_leakage.chamber(chamber, moment, *load_rows(w, POSITIONAL_LEAKAGE, 6))
    if on & 2097152:
        chamber = curve.chamber(chamber, moment, load(w, S11), *load_rows(w, CURVE, 24))
    if on & 2:
        store(w, K2, physical_core.evolve(moment, chamber, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12)))
        chamber = physical_core.chamber(chamber, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
    if on & 4194304:
        store(w, K12, heat_transfer.evolve(moment, chamber, load(w, S12), *load_rows(w, HEAT_TRANSFER, 1)))
        chamber = heat_transfer.chamber(chamber, moment, load(w, S12), *load_rows(w, HEAT_TRANSFER, 1))
    signal = p
    if on & 65536:
        store(w, K7, sensor_lag.evolve(moment, signal, load(w, S7), *load_rows(w, SENSOR_LAG, 1)))
        signal = sensor_lag.signal(signal, moment, load(w, S7), *load_rows(w, SENSOR_LAG, 1))
    if on & 262144:
        store(w, K8, line_resonance.evolve(moment, signal, load(w, S8), load(w, S9), *load_rows(w, LINE_RESONANCE, 2)))
        signal = line_resonance.signal(signal, moment, load(w, S8), load(w, S9), *load_rows(w, LINE_RESONANCE, 2))
    store(w, K0, chamber)
    store(w, K1, sensing)


@inlined
def advance_state(state, h, stage, w):
    """Advance a state from a stage of a step of h seconds to the next stage, or to the end of the step."""
    rate = load(w, K0 + state)
    total = KEPT[stage] * load(w, SUM + state) + WEIGHT[stage] * rate
    reached = load(w, Y0 + state) + h * SHARE[stage] * total
    store(w, SUM + state, total)
    store(w, Y0 + state, reached)
    store(w, S0 + state, reached + h * AHEAD[stage] * rate)


@inlined
def advance_states(h, stage, w, on):
    """Advance all states from a stage to the next stage, or to the end of the step."""
    advance_state(Y0, h, stage, w)
    advance_state(Y1, h, stage, w)
    if on & 2:
        advance_state(Y2, h, stage, w)
    if on & 1024:
        advance_state(Y5, h, stage, w)
    if on & 65536:
        advance_state(Y7, h, stage, w)
    if on & 262144:
        advance_state(Y8, h, stage, w)
        advance_state(Y9, h, stage, w)
    if on & 1048576:
        advance_state(Y10, h, stage, w)
    if on & 2097152:
        advance_state(Y11, h, stage, w)
    if on & 4194304:
        advance_state(Y12, h, stage, w)


@inlined
def advance(time, h, steps, acceleration, ambient, w, on):
    """Advance the states by h seconds in equal steps, at constant acceleration of the piston."""
    h /= steps
    # a flat loop, because the compiler would unroll four stages and duplicate each for a switch tested here
    for count in range(4 * steps):
        stage = count % 4
        compute_rates(time, ambient, w, on)
        advance_states(h, stage, w, on)
        passed = h * PASSED[stage]
        time += passed
        rate = load(w, RATE)
        store(w, X, load(w, X) + passed * (rate + 0.5 * passed * acceleration))
        store(w, RATE, rate + passed * acceleration)
        if passed > 0.0 and on & 4:
            followed = setpoint_lag.follow(passed, load(w, SETPOINT), load(w, S3), *load_rows(w, SETPOINT_LAG, 1))
            store(w, Y3, followed)
            store(w, S3, followed)
        update_backlash_valve_hysteresis(time, stage, ambient, w, on)


@inlined
def update_backlash_valve_hysteresis(time, stage, ambient, w, on):
    """Set the state of a backlash of the valves after the last stage of a step."""
    if stage == 3 and on & 512:
        moment = initial_moment(time, load(w, S0), load(w, S1), ambient, w)
        error = valve_error(moment, w, on)
        if on & 2:
            error = physical_core.error(error, moment, load(w, S2), *load_rows(w, PHYSICAL_CORE_HELD, 12))
        error = valve_hysteresis.error(error, moment, load(w, S4), *load_rows(w, VALVE_HYSTERESIS, 1))
        store(w, Y4, error)
        store(w, S4, error)


@kernel
def start_motion(time, x, h, ambient, numbers, on):
    """Set the speed at which the chamber follows a displacement measured h seconds after the last sample."""
    w = rows_address(numbers)
    last = load(w, FOLLOWED)
    store(w, RATE, (x - load(w, MEASURED)) / h)
    store(w, MEASURED, x)
    store(w, X, x)
    chamber_x = load(w, X)
    moment = initial_moment(time, load(w, Y0), load(w, Y1), ambient, w)
    if on & 64:
        chamber_x = displacement_delay.displacement(chamber_x, moment, *load_rows(w, DISPLACEMENT_DELAY, 1))
    if on & 128:
        chamber_x = displacement_lag.displacement(chamber_x, moment, *load_rows(w, DISPLACEMENT_LAG, 1))
    if on & 32768:
        chamber_x = lost_motion.displacement(chamber_x, moment, load(w, Y6), *load_rows(w, LOST_MOTION, 1))
        store(w, Y6, chamber_x)
    store(w, RATE, (chamber_x - last) / h)
    store(w, X, last)
    store(w, FOLLOWED, chamber_x)


@kernel
def read_sensor(time, ambient, numbers, on):
    """Compute the reading of the pressure sensor [Pa]."""
    w = rows_address(numbers)
    moment = initial_moment(time, load(w, S0), load(w, S1), ambient, w)
    signal = moment.p
    if on & 65536:
        signal = sensor_lag.signal(signal, moment, load(w, S7), *load_rows(w, SENSOR_LAG, 1))
    if on & 262144:
        signal = line_resonance.signal(signal, moment, load(w, S8), load(w, S9), *load_rows(w, LINE_RESONANCE, 2))
    if on & 2097152:
        signal = curve.signal(signal, moment, load(w, S11), *load_rows(w, CURVE, 24))
    store(w, SIGNAL, signal)


@kernel
def set_to_rest(x, setpoint, numbers):
    """Set the states to rest at a displacement [m] and a set-point [Pa], with the offset and the start of each lane."""
    w = rows_address(numbers)
    target = setpoint + load(w, OFFSET)
    pressure = setpoint + (load(w, OFFSET) + load(w, START))
    states = pressure, pressure, 0.0, target, 0.0, 0.0, x, pressure, pressure, 0.0, 0.0, 0.0, 0.0
    store(w, Y0, states)
    store(w, S0, states)
    store(w, FOLLOWED, (x, x))
    store(w, X, (x, 0.0, target))


@kernel
def settle(setpoint, duration, ambient, stiffness, numbers, on):
    """Advance the states at rest and a set-point for a duration [s], at time zero."""
    w = rows_address(numbers)
    store(w, SETPOINT, setpoint + load(w, OFFSET))
    store(w, RATE, 0.0)
    store(w, X, load(w, FOLLOWED))
    hold(0.0, ambient, w, on)
    steps = max(1, math.ceil(duration * stiffness))
    for _ in range(steps):
        advance(0.0, duration / steps, 1, 0.0, ambient, w, on)


@kernel
def step(time, x, h, acceleration, setpoint, ambient, stiffness, numbers, on):
    """
    Advance the states to a sample h seconds after the last sample, and read the pressure sensor.

    The time and x are those of the new sample. Steps are at most 1/stiffness long [s]. The acceleration is that of the
    piston [m/s^2], or 0 if an effect changes the displacement that the chamber follows.
    """
    start_motion(time, x, h, ambient, numbers, on)
    w = rows_address(numbers)
    store(w, SETPOINT, setpoint + load(w, OFFSET))
    hold(time - h, ambient, w, on)
    store(w, RATE, load(w, RATE) - 0.5 * h * acceleration)
    steps = max(1, math.ceil(h * stiffness))
    advance(time - h, h, steps, acceleration, ambient, w, on)
    read_sensor(time, ambient, numbers, on)


@kernel
def propagate(times, displacement, acceleration, setpoint, begin, ambient, stiffness, numbers, on, signals):
    """
    Advance over a recording as `propagation.propagate` does; write the lanes' readings, shape (n, lanes) [Pa].

    Time zero is `begin`, the first time of the whole recording, of which this may be a piece.
    """
    lanes = signals.shape[1]
    read_sensor(times[0] - begin, ambient, numbers, on)
    for j in range(lanes):
        signals[0, j] = numbers[SIGNAL + j]
    for i in range(1, times.size):
        h = times[i] - times[i - 1]
        step(times[i] - begin, displacement[i], h, acceleration[i], setpoint[i], ambient, stiffness, numbers, on)
        for j in range(lanes):
            signals[i, j] = numbers[SIGNAL + j]


@kernel
def set_force_to_rest(x, state):
    """Set the states of the force to rest at a displacement [m]."""
    state[:] = 0.0
    state[SLID] = x


@kernel
def step_force(time, x, rate, acceleration, p_a, p_opposing, ambient, area_times_factor, state, a, on):
    """
    Advance the states of the force to a displacement; return the contact force along +x [N].

    The opposing pressure is ambient if there is no cylinder B.
    """
    travel = x - state[SLID]
    if on & 2:
        (state[0],) = seal_friction.slide(travel, state[0], *load_floats(a, 2, 4))
    if on & 4:
        (state[1],) = stribeck_friction.slide(travel, state[1], *load_floats(a, 6, 3))
    if on & 8:
        (state[2],) = force_curve.slide(travel, state[2], *load_floats(a, 9, 24))
    state[SLID] = x
    moment = ForceMoment(time, x, rate, acceleration, p_a, p_opposing, ambient)
    force = area_times_factor * (p_a - p_opposing)
    if on & 1:
        force = moving_mass.force(force, moment, *load_floats(a, 0, 2))
    if on & 2:
        force = seal_friction.force(force, moment, state[0], *load_floats(a, 2, 4))
    if on & 4:
        force = stribeck_friction.force(force, moment, state[1], *load_floats(a, 6, 3))
    if on & 8:
        force = force_curve.force(force, moment, state[2], *load_floats(a, 9, 24))
    if on & 16:
        force = force_offset.force(force, moment, *load_floats(a, 33, 1))
    return force


@kernel
def propagate_force(
    times, displacement, rate, acceleration, p_a, p_opposing, begin, ambient, area_times_factor, state, a, on, force_out
):
    """Advance over a piece of a recording that began at time `begin` [s]; write the contact force, shape (n,) [N]."""
    for i in range(times.size):
        inputs = times[i] - begin, displacement[i], rate[i], acceleration[i], p_a[i], p_opposing[i]
        force_out[i] = step_force(*inputs, ambient, area_times_factor, state, a, on)
