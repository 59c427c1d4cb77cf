"""
The paper's equations and every physical effect, each behind a switch, for Runge-Kutta of fourth order.

Eight cylinders that differ in their parameters alone are simulated side by side, in lanes that a processor takes at
once: that is how a fit gets its derivatives. What stays from step to step stands in one array of rows, a row being one
number of each lane.

Made by `make kernel` from the effects, fingerprint 2afd8d3351ddeb5c; changes by hand are lost.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects import (
    displacement_lag,
    droop,
    flow_saturation,
    force_offset,
    heat_transfer,
    leakage,
    line_resonance,
    line_restriction,
    lost_motion,
    moving_mass,
    nonlinear_valve,
    operating_point,
    positional_leakage,
    seal_friction,
    sensor_lag,
    set_point_drift,
    stribeck_friction,
    supply_variation,
    valve_dead_band,
    valve_hysteresis,
    volume_variation,
)
from cfd_pneumatic.model.effects.effect import ForceMoment, Moment
from cfd_pneumatic.model.kernel import inner, kernel
from cfd_pneumatic.model.lanes import COUNT, load, store, where

# states: pressures p and p_f, then the effects' own
Y0 = 0 * COUNT
Y1 = 1 * COUNT
Y2 = 2 * COUNT
Y3 = 3 * COUNT
Y4 = 4 * COUNT
Y5 = 5 * COUNT
Y6 = 6 * COUNT
Y7 = 7 * COUNT
Y8 = 8 * COUNT
Y9 = 9 * COUNT
# displacements that the chamber followed last and that was measured last [m]
FOLLOWED = 10 * COUNT
MEASURED = 11 * COUNT
# parameters: gains, then the effects' own
A0 = 12 * COUNT
A1 = 13 * COUNT
A2 = 14 * COUNT
A3 = 15 * COUNT
A4 = 16 * COUNT
A5 = 17 * COUNT
A6 = 18 * COUNT
A7 = 19 * COUNT
A8 = 20 * COUNT
A9 = 21 * COUNT
A10 = 22 * COUNT
A11 = 23 * COUNT
A12 = 24 * COUNT
A13 = 25 * COUNT
A14 = 26 * COUNT
A15 = 27 * COUNT
A16 = 28 * COUNT
A17 = 29 * COUNT
A18 = 30 * COUNT
A19 = 31 * COUNT
A20 = 32 * COUNT
A21 = 33 * COUNT
A22 = 34 * COUNT
A23 = 35 * COUNT
A24 = 36 * COUNT
A25 = 37 * COUNT
A26 = 38 * COUNT
A27 = 39 * COUNT
A28 = 40 * COUNT
A29 = 41 * COUNT
A30 = 42 * COUNT
A31 = 43 * COUNT
A32 = 44 * COUNT
A33 = 45 * COUNT
A34 = 46 * COUNT
A35 = 47 * COUNT
# what each lane's set-point lies above the common one [Pa]
OFFSET = 48 * COUNT
# states and rates of a stage of Runge and Kutta, and the rates' weighted sum
S0 = 49 * COUNT
S1 = 50 * COUNT
S2 = 51 * COUNT
S3 = 52 * COUNT
S4 = 53 * COUNT
S5 = 54 * COUNT
S6 = 55 * COUNT
S7 = 56 * COUNT
S8 = 57 * COUNT
S9 = 58 * COUNT
K0 = 59 * COUNT
K1 = 60 * COUNT
K2 = 61 * COUNT
K3 = 62 * COUNT
K4 = 63 * COUNT
K5 = 64 * COUNT
K6 = 65 * COUNT
K7 = 66 * COUNT
K8 = 67 * COUNT
K9 = 68 * COUNT
SUM0 = 69 * COUNT
SUM1 = 70 * COUNT
SUM2 = 71 * COUNT
SUM3 = 72 * COUNT
SUM4 = 73 * COUNT
SUM5 = 74 * COUNT
SUM6 = 75 * COUNT
SUM7 = 76 * COUNT
SUM8 = 77 * COUNT
SUM9 = 78 * COUNT
# the piston's displacement [m] and speed [m/s], the set-point [Pa], and what the pressure sensor reads [Pa]
X = 79 * COUNT
RATE = 80 * COUNT
SETPOINT = 81 * COUNT
SIGNAL = 82 * COUNT

SIZE = 83 * COUNT
"""Length of the array of rows."""

STATE_ROWS = slice(0, 12)
"""Rows of the states: pressures p and p_f, those of the effects, displacements followed and measured last."""

PARAMETER_ROWS = slice(12, 48)
"""Rows of the parameters: the gains, then those of the effects."""

OFFSET_ROW = 48
"""Row of what each lane's set-point lies above the common one [Pa]."""

SIGNAL_ROW = SIGNAL // COUNT
"""Row of what the pressure sensor reads [Pa]."""

FORCE_STATES = 2
"""States of the effects on the force."""

SLID = 2
"""Where, behind these, the displacement stands that the seals slid to last [m]."""


@inner
def valve_error(moment, w, on):
    """Return the valves' error, from the set-point that acts [Pa]."""
    target = moment.setpoint
    if on[2]:
        target = set_point_drift.setpoint(target, moment, load(w, A8))
    if on[4]:
        target = supply_variation.setpoint(target, moment, load(w, A10), load(w, A11), load(w, A12))
    if on[6]:
        target = droop.setpoint(target, moment, load(w, S3), load(w, A14), load(w, A15))
    return target - load(w, S1)


@inner
def slopes(time, ambient, w, on):
    """Compute the rates of all states."""
    x, rate, p, setpoint = load(w, X), load(w, RATE), load(w, S0), load(w, SETPOINT)
    moment = Moment(time, x, rate, p, setpoint, ambient, 0.0 * rate)
    gain = load(w, A0)
    if on[0]:
        gain = volume_variation.velocity_gain(gain, moment, load(w, A4))
    if on[1]:
        gain = operating_point.velocity_gain(gain, moment, load(w, A5), load(w, A6), load(w, A7))
    swept = gain * rate
    moment = Moment(time, x, rate, p, setpoint, ambient, swept)
    error = valve_error(moment, w, on)
    if on[5]:
        error = valve_hysteresis.error(error, moment, load(w, S2), load(w, A13))
    if on[13]:
        error = valve_dead_band.error(error, moment, load(w, A29))
    if on[15]:
        error = nonlinear_valve.error(error, moment, load(w, A32))
    flow = where(error > 0.0, load(w, A1), load(w, A2)) * error
    if on[0]:
        flow = volume_variation.flow(flow, moment, load(w, A4))
    if on[1]:
        flow = operating_point.flow(flow, moment, load(w, A5), load(w, A6), load(w, A7))
    if on[10]:
        flow = flow_saturation.flow(flow, moment, load(w, A25), load(w, A26))
    if on[16]:
        (rate8,) = line_restriction.evolve(moment, flow, load(w, S8), load(w, A33), load(w, A34))
        store(w, K8, rate8)
        flow = line_restriction.flow(flow, moment, load(w, S8), load(w, A33), load(w, A34))
    if on[17]:
        flow = heat_transfer.flow(flow, moment, load(w, S9), load(w, A35))
    if on[6]:
        (rate3,) = droop.evolve(moment, flow, load(w, S3), load(w, A14), load(w, A15))
        store(w, K3, rate3)
    chamber = flow - swept
    if on[7]:
        chamber = leakage.chamber(chamber, moment, load(w, A16), load(w, A17))
    if on[8]:
        chamber = positional_leakage.chamber(
            chamber, moment, load(w, A18), load(w, A19), load(w, A20), load(w, A21), load(w, A22), load(w, A23)
        )
    if on[17]:
        (rate9,) = heat_transfer.evolve(moment, chamber, load(w, S9), load(w, A35))
        store(w, K9, rate9)
        chamber = heat_transfer.chamber(chamber, moment, load(w, S9), load(w, A35))
    outlet = p
    if on[16]:
        outlet = line_restriction.outlet(outlet, moment, flow, load(w, S8), load(w, A33), load(w, A34))
    tau = load(w, A3)
    if on[1]:
        tau = operating_point.time_constant(tau, moment, load(w, A5), load(w, A6), load(w, A7))
    signal = p
    if on[12]:
        (rate5,) = sensor_lag.evolve(moment, signal, load(w, S5), load(w, A28))
        store(w, K5, rate5)
        signal = sensor_lag.signal(signal, moment, load(w, S5), load(w, A28))
    if on[14]:
        (
            rate6,
            rate7,
        ) = line_resonance.evolve(moment, signal, load(w, S6), load(w, S7), load(w, A30), load(w, A31))
        store(w, K6, rate6)
        store(w, K7, rate7)
        signal = line_resonance.signal(signal, moment, load(w, S6), load(w, S7), load(w, A30), load(w, A31))
    store(w, K0, chamber)
    store(w, K1, (outlet - load(w, S1)) / tau)


@inner
def begin_stages(w, on):
    """Begin a step of Runge and Kutta where the states are."""
    store(w, S0, load(w, Y0))
    store(w, SUM0, 0.0)
    store(w, S1, load(w, Y1))
    store(w, SUM1, 0.0)
    if on[6]:
        store(w, S3, load(w, Y3))
        store(w, SUM3, 0.0)
    if on[12]:
        store(w, S5, load(w, Y5))
        store(w, SUM5, 0.0)
    if on[14]:
        store(w, S6, load(w, Y6))
        store(w, SUM6, 0.0)
        store(w, S7, load(w, Y7))
        store(w, SUM7, 0.0)
    if on[16]:
        store(w, S8, load(w, Y8))
        store(w, SUM8, 0.0)
    if on[17]:
        store(w, S9, load(w, Y9))
        store(w, SUM9, 0.0)


@inner
def next_stage(weight, ahead, w, on):
    """Add the rates of a stage to their sum, and go ahead of the states by some seconds at these rates."""
    store(w, SUM0, load(w, SUM0) + weight * load(w, K0))
    store(w, S0, load(w, Y0) + ahead * load(w, K0))
    store(w, SUM1, load(w, SUM1) + weight * load(w, K1))
    store(w, S1, load(w, Y1) + ahead * load(w, K1))
    if on[6]:
        store(w, SUM3, load(w, SUM3) + weight * load(w, K3))
        store(w, S3, load(w, Y3) + ahead * load(w, K3))
    if on[12]:
        store(w, SUM5, load(w, SUM5) + weight * load(w, K5))
        store(w, S5, load(w, Y5) + ahead * load(w, K5))
    if on[14]:
        store(w, SUM6, load(w, SUM6) + weight * load(w, K6))
        store(w, S6, load(w, Y6) + ahead * load(w, K6))
        store(w, SUM7, load(w, SUM7) + weight * load(w, K7))
        store(w, S7, load(w, Y7) + ahead * load(w, K7))
    if on[16]:
        store(w, SUM8, load(w, SUM8) + weight * load(w, K8))
        store(w, S8, load(w, Y8) + ahead * load(w, K8))
    if on[17]:
        store(w, SUM9, load(w, SUM9) + weight * load(w, K9))
        store(w, S9, load(w, Y9) + ahead * load(w, K9))


@inner
def end_stages(sixth, w, on):
    """Advance the states by the sum of the rates times a sixth of the step [s]."""
    store(w, Y0, load(w, Y0) + sixth * (load(w, SUM0) + load(w, K0)))
    store(w, S0, load(w, Y0))
    store(w, Y1, load(w, Y1) + sixth * (load(w, SUM1) + load(w, K1)))
    store(w, S1, load(w, Y1))
    if on[6]:
        store(w, Y3, load(w, Y3) + sixth * (load(w, SUM3) + load(w, K3)))
        store(w, S3, load(w, Y3))
    if on[12]:
        store(w, Y5, load(w, Y5) + sixth * (load(w, SUM5) + load(w, K5)))
        store(w, S5, load(w, Y5))
    if on[14]:
        store(w, Y6, load(w, Y6) + sixth * (load(w, SUM6) + load(w, K6)))
        store(w, S6, load(w, Y6))
        store(w, Y7, load(w, Y7) + sixth * (load(w, SUM7) + load(w, K7)))
        store(w, S7, load(w, Y7))
    if on[16]:
        store(w, Y8, load(w, Y8) + sixth * (load(w, SUM8) + load(w, K8)))
        store(w, S8, load(w, Y8))
    if on[17]:
        store(w, Y9, load(w, Y9) + sixth * (load(w, SUM9) + load(w, K9)))
        store(w, S9, load(w, Y9))


@inner
def move(h, w):
    """Move the piston on by h seconds."""
    store(w, X, load(w, X) + h * load(w, RATE))


@inner
def advance(time, h, steps, ambient, w, on):
    """Advance the states by h seconds from a time on, cut into equal steps; the piston keeps its speed."""
    h /= steps
    half = 0.5 * h
    for _ in range(steps):
        begin_stages(w, on)
        slopes(time, ambient, w, on)
        next_stage(1.0, half, w, on)
        move(half, w)
        slopes(time + half, ambient, w, on)
        next_stage(2.0, half, w, on)
        slopes(time + half, ambient, w, on)
        next_stage(2.0, h, w, on)
        move(half, w)
        slopes(time + h, ambient, w, on)
        end_stages(h / 6.0, w, on)
        time += h
        if on[5]:
            leave_behind_valve_hysteresis(time, ambient, w, on)


@inner
def leave_behind_valve_hysteresis(time, ambient, w, on):
    """Compute the error at which this play stands."""
    rate = load(w, RATE)
    moment = Moment(time, load(w, X), rate, load(w, S0), load(w, SETPOINT), ambient, 0.0 * rate)
    error = valve_error(moment, w, on)
    error = valve_hysteresis.error(error, moment, load(w, S2), load(w, A13))
    store(w, Y2, error)
    store(w, S2, error)


@kernel
def follow(time, x, h, ambient, w, on):
    """Set the piston in motion to where the chamber follows a displacement measured h seconds after the last."""
    last = load(w, FOLLOWED)
    rate = (x - load(w, MEASURED)) / h
    store(w, MEASURED, x)
    store(w, X, x)
    x_followed = load(w, X)
    moment = Moment(time, x_followed, rate, load(w, Y0), load(w, SETPOINT), ambient, 0.0 * rate)
    if on[3]:
        x_followed = displacement_lag.displacement(x_followed, moment, load(w, A9))
    if on[11]:
        x_followed = lost_motion.displacement(x_followed, moment, load(w, Y4), load(w, A27))
        store(w, Y4, x_followed)
    store(w, RATE, (x_followed - last) / h)
    store(w, X, last)
    store(w, FOLLOWED, x_followed)


@kernel
def read(time, ambient, w, on):
    """Compute what the pressure sensor reads [Pa]."""
    rate = load(w, RATE)
    moment = Moment(time, load(w, X), rate, load(w, Y0), load(w, SETPOINT), ambient, 0.0 * rate)
    signal = load(w, Y0)
    if on[12]:
        signal = sensor_lag.signal(signal, moment, load(w, S5), load(w, A28))
    if on[14]:
        signal = line_resonance.signal(signal, moment, load(w, S6), load(w, S7), load(w, A30), load(w, A31))
    store(w, SIGNAL, signal)


@kernel
def rest(x, setpoint, w):
    """Set the states to rest at a displacement [m] and a pressure [Pa], each lane's at its own."""
    pressure = setpoint + load(w, OFFSET)
    store(w, Y0, pressure)
    store(w, S0, pressure)
    store(w, Y1, pressure)
    store(w, S1, pressure)
    store(w, Y2, 0.0)
    store(w, S2, 0.0)
    store(w, Y3, 0.0)
    store(w, S3, 0.0)
    store(w, Y4, x)
    store(w, S4, x)
    store(w, Y5, pressure)
    store(w, S5, pressure)
    store(w, Y6, pressure)
    store(w, S6, pressure)
    store(w, Y7, 0.0)
    store(w, S7, 0.0)
    store(w, Y8, 0.0)
    store(w, S8, 0.0)
    store(w, Y9, 0.0)
    store(w, S9, 0.0)
    store(w, FOLLOWED, x)
    store(w, MEASURED, x)
    store(w, X, x)
    store(w, RATE, 0.0)
    store(w, SETPOINT, pressure)


@kernel
def settle(setpoint, duration, ambient, stiffness, w, on):
    """Let the cylinders stand still at a set-point for some seconds, before time begins."""
    store(w, SETPOINT, setpoint + load(w, OFFSET))
    store(w, RATE, 0.0)
    store(w, X, load(w, FOLLOWED))
    steps = max(1, math.ceil(duration * stiffness))
    for _ in range(steps):
        advance(0.0, duration / steps, 1, ambient, w, on)


@kernel
def step(time, x, h, setpoint, ambient, stiffness, w, on):
    """
    Advance the states to a sample h seconds after the last one, and read the pressure sensor.

    The time and x are those of the new sample. Steps are short against 1/stiffness, the fastest time constant [s].
    """
    follow(time, x, h, ambient, w, on)
    store(w, SETPOINT, setpoint + load(w, OFFSET))
    steps = max(1, math.ceil(h * stiffness))
    advance(time - h, h, steps, ambient, w, on)
    read(time, ambient, w, on)


@kernel
def propagate(times, displacement, setpoint, begin, ambient, stiffness, w, on, signals):
    """
    Advance over a recording, as `propagation.propagate` does; write the lanes' readings, (n, lanes) [Pa].

    Time began at `begin`, with the first of the recording's times or, of a piece of it, earlier.
    """
    lanes = signals.shape[1]
    read(times[0] - begin, ambient, w, on)
    for j in range(lanes):
        signals[0, j] = w[SIGNAL + j]
    for i in range(1, times.size):
        h = times[i] - times[i - 1]
        step(times[i] - begin, displacement[i], h, setpoint[i], ambient, stiffness, w, on)
        for j in range(lanes):
            signals[i, j] = w[SIGNAL + j]


@kernel
def rest_force(x, state):
    """Set the states of the force to rest at a displacement [m]."""
    state[:] = 0.0
    state[SLID] = x


@kernel
def step_force(time, x, rate, acceleration, p_a, p_opposing, ambient, area_times_factor, state, a, on):
    """
    Advance the states of the force to a displacement; return the contact force there, along +x [N].

    Where there is no cylinder B, the opposing pressure is ambient.
    """
    travel = x - state[SLID]
    if on[1]:
        (state[0],) = seal_friction.slide(travel, state[0], a[2], a[3], a[4], a[5])
    if on[2]:
        (state[1],) = stribeck_friction.slide(travel, state[1], a[6], a[7], a[8])
    state[SLID] = x
    moment = ForceMoment(time, x, rate, acceleration, p_a, p_opposing, ambient)
    force = area_times_factor * (p_a - p_opposing)
    if on[0]:
        force = moving_mass.force(force, moment, a[0], a[1])
    if on[1]:
        force = seal_friction.force(force, moment, state[0], a[2], a[3], a[4], a[5])
    if on[2]:
        force = stribeck_friction.force(force, moment, state[1], a[6], a[7], a[8])
    if on[3]:
        force = force_offset.force(force, moment, a[9])
    return force


@kernel
def propagate_force(
    times, displacement, rate, acceleration, p_a, p_opposing, begin, ambient, area_times_factor, state, a, on, force_out
):
    """Advance over a piece of a recording that has begun at a time [s]; write the contact force at each sample [N]."""
    for i in range(times.size):
        force_out[i] = step_force(
            times[i] - begin,
            displacement[i],
            rate[i],
            acceleration[i],
            p_a[i],
            p_opposing[i],
            ambient,
            area_times_factor,
            state,
            a,
            on,
        )
