"""
The paper's equations and every physical effect, each behind a switch, for Runge-Kutta of fourth order.

Made by `make kernel` from the effects, fingerprint 725ae087bda337b4; changes by hand are lost.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects import (
    displacement_lag,
    droop,
    flow_saturation,
    heat_transfer,
    leakage,
    line_resonance,
    line_restriction,
    lost_motion,
    nonlinear_valve,
    operating_point,
    positional_leakage,
    sensor_lag,
    set_point_drift,
    supply_variation,
    valve_dead_band,
    valve_hysteresis,
    volume_variation,
)
from cfd_pneumatic.model.effects.effect import Moment
from cfd_pneumatic.model.kernel import kernel

STATES = 9
"""Pressures p and p_f, then the effects' own states."""

FOLLOWED = 9
"""Where, behind the states, the displacement stands that the chamber followed last [m]."""

MEASURED = 10
"""Where the displacement stands that was measured last [m]."""


@kernel
def slopes(time, x, rate, setpoint, ambient, y0, y1, y2, y3, y4, y5, y6, y7, y8, a, on):
    """Return the rates of all states."""
    moment = Moment(time, x, rate, y0, setpoint, ambient)
    dy2 = 0.0
    dy3 = 0.0
    dy4 = 0.0
    dy5 = 0.0
    dy6 = 0.0
    dy7 = 0.0
    dy8 = 0.0
    target = setpoint
    if on[2]:
        target = set_point_drift.setpoint(target, moment, a[8])
    if on[4]:
        target = supply_variation.setpoint(target, moment, a[10], a[11], a[12])
    if on[6]:
        target = droop.setpoint(target, moment, y3, a[14], a[15])
    error = target - y1
    if on[5]:
        error = valve_hysteresis.error(error, moment, y2, a[13])
    if on[14]:
        error = valve_dead_band.error(error, moment, a[28])
    if on[16]:
        error = nonlinear_valve.error(error, moment, a[31])
    flow = (a[1] if error > 0.0 else a[2]) * error
    if on[0]:
        flow = volume_variation.flow(flow, moment, a[4])
    if on[1]:
        flow = operating_point.flow(flow, moment, a[5], a[6], a[7])
    if on[11]:
        flow = flow_saturation.flow(flow, moment, a[24], a[25])
    if on[6]:
        (dy3,) = droop.evolve(moment, flow, y3, a[14], a[15])
    k_x = a[0]
    if on[0]:
        k_x = volume_variation.velocity_gain(k_x, moment, a[4])
    if on[1]:
        k_x = operating_point.velocity_gain(k_x, moment, a[5], a[6], a[7])
    chamber = flow - k_x * rate
    if on[7]:
        chamber = leakage.chamber(chamber, moment, a[16])
    if on[9]:
        chamber = positional_leakage.chamber(chamber, moment, a[18], a[19], a[20], a[21], a[22])
    if on[17]:
        (dy8,) = heat_transfer.evolve(moment, chamber, y8, a[32])
        chamber = heat_transfer.chamber(chamber, moment, y8, a[32])
    outlet = y0
    if on[8]:
        outlet = line_restriction.outlet(outlet, moment, flow, a[17])
    tau = a[3]
    if on[1]:
        tau = operating_point.time_constant(tau, moment, a[5], a[6], a[7])
    signal = y0
    if on[13]:
        (dy5,) = sensor_lag.evolve(moment, signal, y5, a[27])
        signal = sensor_lag.signal(signal, moment, y5, a[27])
    if on[15]:
        (
            dy6,
            dy7,
        ) = line_resonance.evolve(moment, signal, y6, y7, a[29], a[30])
        signal = line_resonance.signal(signal, moment, y6, y7, a[29], a[30])
    return chamber, (outlet - y1) / tau, dy2, dy3, dy4, dy5, dy6, dy7, dy8


@kernel
def advance(time, x, rate, h, steps, setpoint, ambient, state, a, on):
    """Advance the states by h seconds, cut into equal steps, while the piston moves in a straight line."""
    y0 = state[0]
    y1 = state[1]
    y2 = state[2]
    y3 = state[3]
    y4 = state[4]
    y5 = state[5]
    y6 = state[6]
    y7 = state[7]
    y8 = state[8]
    h /= steps
    for _ in range(steps):
        (
            k1_0,
            k1_1,
            k1_2,
            k1_3,
            k1_4,
            k1_5,
            k1_6,
            k1_7,
            k1_8,
        ) = slopes(
            time,
            x,
            rate,
            setpoint,
            ambient,
            y0,
            y1,
            y2,
            y3,
            y4,
            y5,
            y6,
            y7,
            y8,
            a,
            on,
        )
        (
            k2_0,
            k2_1,
            k2_2,
            k2_3,
            k2_4,
            k2_5,
            k2_6,
            k2_7,
            k2_8,
        ) = slopes(
            time + 0.5 * h,
            x + rate * 0.5 * h,
            rate,
            setpoint,
            ambient,
            y0 + 0.5 * h * k1_0,
            y1 + 0.5 * h * k1_1,
            y2 + 0.5 * h * k1_2,
            y3 + 0.5 * h * k1_3,
            y4 + 0.5 * h * k1_4,
            y5 + 0.5 * h * k1_5,
            y6 + 0.5 * h * k1_6,
            y7 + 0.5 * h * k1_7,
            y8 + 0.5 * h * k1_8,
            a,
            on,
        )
        (
            k3_0,
            k3_1,
            k3_2,
            k3_3,
            k3_4,
            k3_5,
            k3_6,
            k3_7,
            k3_8,
        ) = slopes(
            time + 0.5 * h,
            x + rate * 0.5 * h,
            rate,
            setpoint,
            ambient,
            y0 + 0.5 * h * k2_0,
            y1 + 0.5 * h * k2_1,
            y2 + 0.5 * h * k2_2,
            y3 + 0.5 * h * k2_3,
            y4 + 0.5 * h * k2_4,
            y5 + 0.5 * h * k2_5,
            y6 + 0.5 * h * k2_6,
            y7 + 0.5 * h * k2_7,
            y8 + 0.5 * h * k2_8,
            a,
            on,
        )
        (
            k4_0,
            k4_1,
            k4_2,
            k4_3,
            k4_4,
            k4_5,
            k4_6,
            k4_7,
            k4_8,
        ) = slopes(
            time + h,
            x + rate * h,
            rate,
            setpoint,
            ambient,
            y0 + h * k3_0,
            y1 + h * k3_1,
            y2 + h * k3_2,
            y3 + h * k3_3,
            y4 + h * k3_4,
            y5 + h * k3_5,
            y6 + h * k3_6,
            y7 + h * k3_7,
            y8 + h * k3_8,
            a,
            on,
        )
        y0 += h / 6.0 * (k1_0 + 2.0 * k2_0 + 2.0 * k3_0 + k4_0)
        y1 += h / 6.0 * (k1_1 + 2.0 * k2_1 + 2.0 * k3_1 + k4_1)
        y2 += h / 6.0 * (k1_2 + 2.0 * k2_2 + 2.0 * k3_2 + k4_2)
        y3 += h / 6.0 * (k1_3 + 2.0 * k2_3 + 2.0 * k3_3 + k4_3)
        y4 += h / 6.0 * (k1_4 + 2.0 * k2_4 + 2.0 * k3_4 + k4_4)
        y5 += h / 6.0 * (k1_5 + 2.0 * k2_5 + 2.0 * k3_5 + k4_5)
        y6 += h / 6.0 * (k1_6 + 2.0 * k2_6 + 2.0 * k3_6 + k4_6)
        y7 += h / 6.0 * (k1_7 + 2.0 * k2_7 + 2.0 * k3_7 + k4_7)
        y8 += h / 6.0 * (k1_8 + 2.0 * k2_8 + 2.0 * k3_8 + k4_8)
        time += h
        x += rate * h
        if on[5]:
            y2 = left_behind_valve_hysteresis(
                time, x, rate, setpoint, ambient, y0, y1, y2, y3, y4, y5, y6, y7, y8, a, on
            )
    state[0] = y0
    state[1] = y1
    state[2] = y2
    state[3] = y3
    state[4] = y4
    state[5] = y5
    state[6] = y6
    state[7] = y7
    state[8] = y8


@kernel
def left_behind_valve_hysteresis(time, x, rate, setpoint, ambient, y0, y1, y2, y3, y4, y5, y6, y7, y8, a, on):
    """Return the error at which this play stands."""
    moment = Moment(time, x, rate, y0, setpoint, ambient)
    target = setpoint
    if on[2]:
        target = set_point_drift.setpoint(target, moment, a[8])
    if on[4]:
        target = supply_variation.setpoint(target, moment, a[10], a[11], a[12])
    if on[6]:
        target = droop.setpoint(target, moment, y3, a[14], a[15])
    error = target - y1
    return valve_hysteresis.error(error, moment, y2, a[13])


@kernel
def follow(time, x, h, setpoint, ambient, state, a, on):
    """Return the displacement that the chamber follows to, from the one measured h seconds after the last."""
    y0 = state[0]
    y4 = state[4]
    moment = Moment(time, x, (x - state[MEASURED]) / h, y0, setpoint, ambient)
    if on[3]:
        x = displacement_lag.displacement(x, moment, a[9])
    if on[12]:
        x = lost_motion.displacement(x, moment, y4, a[26])
        state[4] = x
    return x


@kernel
def reading(time, x, rate, setpoint, ambient, state, a, on):
    """Return what the pressure sensor reads [Pa]."""
    y0 = state[0]
    y5 = state[5]
    y6 = state[6]
    y7 = state[7]
    moment = Moment(time, x, rate, y0, setpoint, ambient)
    signal = y0
    if on[13]:
        signal = sensor_lag.signal(signal, moment, y5, a[27])
    if on[15]:
        signal = line_resonance.signal(signal, moment, y6, y7, a[29], a[30])
    return signal


@kernel
def rest(x, setpoint, state):
    """Set the states to rest at a displacement [m] and a pressure [Pa]."""
    state[:] = 0.0
    state[0] = setpoint
    state[1] = setpoint
    state[5] = setpoint
    state[6] = setpoint
    state[4] = x
    state[FOLLOWED] = x
    state[MEASURED] = x


@kernel
def step(time, x, h, setpoint, ambient, stiffness, state, a, on):
    """
    Advance the states to a sample h seconds after the last one; return what the pressure sensor reads [Pa].

    The time and x are those of the new sample. Steps are short against 1/stiffness, the fastest time constant [s].
    """
    followed = follow(time, x, h, setpoint, ambient, state, a, on)
    rate = (followed - state[FOLLOWED]) / h
    steps = max(1, math.ceil(h * stiffness))
    advance(time - h, state[FOLLOWED], rate, h, steps, setpoint, ambient, state, a, on)
    state[FOLLOWED] = followed
    state[MEASURED] = x
    return reading(time, followed, rate, setpoint, ambient, state, a, on)


@kernel
def propagate(times, displacement, setpoint, ambient, stiffness, state, a, on, signal):
    """Advance over a recording, as `propagation.propagate` does; write what the sensor reads at each sample [Pa]."""
    signal[0] = reading(0.0, displacement[0], 0.0, setpoint[0], ambient, state, a, on)
    for i in range(1, times.size):
        h = times[i] - times[i - 1]
        time = times[i] - times[0]
        signal[i] = step(time, displacement[i], h, setpoint[i], ambient, stiffness, state, a, on)
