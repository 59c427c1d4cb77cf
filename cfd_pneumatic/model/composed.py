"""
The paper's equations and every physical effect, each behind a switch, for Runge-Kutta of fourth order.

Eight cylinders that differ in their parameters alone are simulated side by side, in lanes that a processor takes at
once: that is how a fit gets its derivatives. All numbers stand in one array of rows, a row being one number of each
lane.

Made by `make kernel` from the effects, fingerprint 41a76c060bd099a7; changes by hand are lost.
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
from cfd_pneumatic.model.kernel import kernel

LANES = 8
"""Cylinders side by side."""

# states: pressures p and p_f, then the effects' own
Y0 = 0 * LANES
Y1 = 1 * LANES
Y2 = 2 * LANES
Y3 = 3 * LANES
Y4 = 4 * LANES
Y5 = 5 * LANES
Y6 = 6 * LANES
Y7 = 7 * LANES
Y8 = 8 * LANES
Y9 = 9 * LANES
# displacements that the chamber followed last and that was measured last [m]
FOLLOWED = 10 * LANES
MEASURED = 11 * LANES
# parameters: gains, then the effects' own
A0 = 12 * LANES
A1 = 13 * LANES
A2 = 14 * LANES
A3 = 15 * LANES
A4 = 16 * LANES
A5 = 17 * LANES
A6 = 18 * LANES
A7 = 19 * LANES
A8 = 20 * LANES
A9 = 21 * LANES
A10 = 22 * LANES
A11 = 23 * LANES
A12 = 24 * LANES
A13 = 25 * LANES
A14 = 26 * LANES
A15 = 27 * LANES
A16 = 28 * LANES
A17 = 29 * LANES
A18 = 30 * LANES
A19 = 31 * LANES
A20 = 32 * LANES
A21 = 33 * LANES
A22 = 34 * LANES
A23 = 35 * LANES
A24 = 36 * LANES
A25 = 37 * LANES
A26 = 38 * LANES
A27 = 39 * LANES
A28 = 40 * LANES
A29 = 41 * LANES
A30 = 42 * LANES
A31 = 43 * LANES
A32 = 44 * LANES
A33 = 45 * LANES
A34 = 46 * LANES
A35 = 47 * LANES
# what each lane's set-point lies above the common one [Pa]
OFFSET = 48 * LANES
# states and rates of a stage of Runge and Kutta, and the rates' weighted sum
S0 = 49 * LANES
S1 = 50 * LANES
S2 = 51 * LANES
S3 = 52 * LANES
S4 = 53 * LANES
S5 = 54 * LANES
S6 = 55 * LANES
S7 = 56 * LANES
S8 = 57 * LANES
S9 = 58 * LANES
K0 = 59 * LANES
K1 = 60 * LANES
K2 = 61 * LANES
K3 = 62 * LANES
K4 = 63 * LANES
K5 = 64 * LANES
K6 = 65 * LANES
K7 = 66 * LANES
K8 = 67 * LANES
K9 = 68 * LANES
SUM0 = 69 * LANES
SUM1 = 70 * LANES
SUM2 = 71 * LANES
SUM3 = 72 * LANES
SUM4 = 73 * LANES
SUM5 = 74 * LANES
SUM6 = 75 * LANES
SUM7 = 76 * LANES
SUM8 = 77 * LANES
SUM9 = 78 * LANES
# what a stage computes
X = 79 * LANES
RATE = 80 * LANES
SETPOINT = 81 * LANES
TARGET = 82 * LANES
ERROR = 83 * LANES
FLOW = 84 * LANES
GAIN = 85 * LANES
SWEPT = 86 * LANES
CHAMBER = 87 * LANES
OUTLET = 88 * LANES
TAU = 89 * LANES
SIGNAL = 90 * LANES

SIZE = 91 * LANES
"""Length of the array of rows."""

STATE_ROWS = slice(0, 12)
"""Rows of the states: pressures p and p_f, those of the effects, displacements followed and measured last."""

PARAMETER_ROWS = slice(12, 48)
"""Rows of the parameters: the gains, then those of the effects."""

OFFSET_ROW = 48
"""Row of what each lane's set-point lies above the common one [Pa]."""

SIGNAL_ROW = SIGNAL // LANES
"""Row of what the pressure sensor reads [Pa]."""

FORCE_STATES = 1
"""States of the effects on the force."""

SLID = 1
"""Where, behind these, the displacement stands that the seals slid to last [m]."""


@kernel
def valve_error(time, ambient, w, on):
    """Compute the set-point that acts and the valves' error."""
    for j in range(LANES):
        w[TARGET + j] = w[SETPOINT + j]
    if on[2]:
        for j in range(LANES):
            w[TARGET + j] = set_point_drift.setpoint(
                w[TARGET + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A8 + j],
            )
    if on[4]:
        for j in range(LANES):
            w[TARGET + j] = supply_variation.setpoint(
                w[TARGET + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A10 + j],
                w[A11 + j],
                w[A12 + j],
            )
    if on[6]:
        for j in range(LANES):
            w[TARGET + j] = droop.setpoint(
                w[TARGET + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S3 + j],
                w[A14 + j],
                w[A15 + j],
            )
    for j in range(LANES):
        w[ERROR + j] = w[TARGET + j] - w[S1 + j]


@kernel
def slopes(time, ambient, w, on):
    """Compute the rates of all states."""
    for j in range(LANES):
        w[GAIN + j] = w[A0 + j]
    if on[0]:
        for j in range(LANES):
            w[GAIN + j] = volume_variation.velocity_gain(
                w[GAIN + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A4 + j],
            )
    if on[1]:
        for j in range(LANES):
            w[GAIN + j] = operating_point.velocity_gain(
                w[GAIN + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A5 + j],
                w[A6 + j],
                w[A7 + j],
            )
    for j in range(LANES):
        w[SWEPT + j] = w[GAIN + j] * w[RATE + j]
    valve_error(time, ambient, w, on)
    if on[5]:
        for j in range(LANES):
            w[ERROR + j] = valve_hysteresis.error(
                w[ERROR + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S2 + j],
                w[A13 + j],
            )
    if on[13]:
        for j in range(LANES):
            w[ERROR + j] = valve_dead_band.error(
                w[ERROR + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A29 + j],
            )
    if on[15]:
        for j in range(LANES):
            w[ERROR + j] = nonlinear_valve.error(
                w[ERROR + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A32 + j],
            )
    for j in range(LANES):
        w[FLOW + j] = (w[A1 + j] if w[ERROR + j] > 0.0 else w[A2 + j]) * w[ERROR + j]
    if on[0]:
        for j in range(LANES):
            w[FLOW + j] = volume_variation.flow(
                w[FLOW + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A4 + j],
            )
    if on[1]:
        for j in range(LANES):
            w[FLOW + j] = operating_point.flow(
                w[FLOW + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A5 + j],
                w[A6 + j],
                w[A7 + j],
            )
    if on[10]:
        for j in range(LANES):
            w[FLOW + j] = flow_saturation.flow(
                w[FLOW + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A25 + j],
                w[A26 + j],
            )
    if on[16]:
        for j in range(LANES):
            (w[K8 + j],) = line_restriction.evolve(
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[FLOW + j],
                w[S8 + j],
                w[A33 + j],
                w[A34 + j],
            )
        for j in range(LANES):
            w[FLOW + j] = line_restriction.flow(
                w[FLOW + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S8 + j],
                w[A33 + j],
                w[A34 + j],
            )
    if on[17]:
        for j in range(LANES):
            w[FLOW + j] = heat_transfer.flow(
                w[FLOW + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S9 + j],
                w[A35 + j],
            )
    if on[6]:
        for j in range(LANES):
            (w[K3 + j],) = droop.evolve(
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[FLOW + j],
                w[S3 + j],
                w[A14 + j],
                w[A15 + j],
            )
    for j in range(LANES):
        w[CHAMBER + j] = w[FLOW + j] - w[SWEPT + j]
    if on[7]:
        for j in range(LANES):
            w[CHAMBER + j] = leakage.chamber(
                w[CHAMBER + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A16 + j],
                w[A17 + j],
            )
    if on[8]:
        for j in range(LANES):
            w[CHAMBER + j] = positional_leakage.chamber(
                w[CHAMBER + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A18 + j],
                w[A19 + j],
                w[A20 + j],
                w[A21 + j],
                w[A22 + j],
                w[A23 + j],
            )
    if on[17]:
        for j in range(LANES):
            (w[K9 + j],) = heat_transfer.evolve(
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[CHAMBER + j],
                w[S9 + j],
                w[A35 + j],
            )
        for j in range(LANES):
            w[CHAMBER + j] = heat_transfer.chamber(
                w[CHAMBER + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S9 + j],
                w[A35 + j],
            )
    for j in range(LANES):
        w[OUTLET + j] = w[S0 + j]
    if on[16]:
        for j in range(LANES):
            w[OUTLET + j] = line_restriction.outlet(
                w[OUTLET + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[FLOW + j],
                w[S8 + j],
                w[A33 + j],
                w[A34 + j],
            )
    for j in range(LANES):
        w[TAU + j] = w[A3 + j]
    if on[1]:
        for j in range(LANES):
            w[TAU + j] = operating_point.time_constant(
                w[TAU + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A5 + j],
                w[A6 + j],
                w[A7 + j],
            )
    for j in range(LANES):
        w[SIGNAL + j] = w[S0 + j]
    if on[12]:
        for j in range(LANES):
            (w[K5 + j],) = sensor_lag.evolve(
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[SIGNAL + j],
                w[S5 + j],
                w[A28 + j],
            )
        for j in range(LANES):
            w[SIGNAL + j] = sensor_lag.signal(
                w[SIGNAL + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S5 + j],
                w[A28 + j],
            )
    if on[14]:
        for j in range(LANES):
            (
                w[K6 + j],
                w[K7 + j],
            ) = line_resonance.evolve(
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[SIGNAL + j],
                w[S6 + j],
                w[S7 + j],
                w[A30 + j],
                w[A31 + j],
            )
        for j in range(LANES):
            w[SIGNAL + j] = line_resonance.signal(
                w[SIGNAL + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S6 + j],
                w[S7 + j],
                w[A30 + j],
                w[A31 + j],
            )
    for j in range(LANES):
        w[K0 + j] = w[CHAMBER + j]
        w[K1 + j] = (w[OUTLET + j] - w[S1 + j]) / w[TAU + j]


@kernel
def begin_stages(w, on):
    """Begin a step of Runge and Kutta where the states are."""
    for j in range(LANES):
        w[S0 + j] = w[Y0 + j]
        w[SUM0 + j] = 0.0
    for j in range(LANES):
        w[S1 + j] = w[Y1 + j]
        w[SUM1 + j] = 0.0
    if on[6]:
        for j in range(LANES):
            w[S3 + j] = w[Y3 + j]
            w[SUM3 + j] = 0.0
    if on[12]:
        for j in range(LANES):
            w[S5 + j] = w[Y5 + j]
            w[SUM5 + j] = 0.0
    if on[14]:
        for j in range(LANES):
            w[S6 + j] = w[Y6 + j]
            w[SUM6 + j] = 0.0
        for j in range(LANES):
            w[S7 + j] = w[Y7 + j]
            w[SUM7 + j] = 0.0
    if on[16]:
        for j in range(LANES):
            w[S8 + j] = w[Y8 + j]
            w[SUM8 + j] = 0.0
    if on[17]:
        for j in range(LANES):
            w[S9 + j] = w[Y9 + j]
            w[SUM9 + j] = 0.0


@kernel
def next_stage(weight, ahead, w, on):
    """Add the rates of a stage to their sum, and go ahead of the states by some seconds at these rates."""
    for j in range(LANES):
        w[SUM0 + j] += weight * w[K0 + j]
        w[S0 + j] = w[Y0 + j] + ahead * w[K0 + j]
    for j in range(LANES):
        w[SUM1 + j] += weight * w[K1 + j]
        w[S1 + j] = w[Y1 + j] + ahead * w[K1 + j]
    if on[6]:
        for j in range(LANES):
            w[SUM3 + j] += weight * w[K3 + j]
            w[S3 + j] = w[Y3 + j] + ahead * w[K3 + j]
    if on[12]:
        for j in range(LANES):
            w[SUM5 + j] += weight * w[K5 + j]
            w[S5 + j] = w[Y5 + j] + ahead * w[K5 + j]
    if on[14]:
        for j in range(LANES):
            w[SUM6 + j] += weight * w[K6 + j]
            w[S6 + j] = w[Y6 + j] + ahead * w[K6 + j]
        for j in range(LANES):
            w[SUM7 + j] += weight * w[K7 + j]
            w[S7 + j] = w[Y7 + j] + ahead * w[K7 + j]
    if on[16]:
        for j in range(LANES):
            w[SUM8 + j] += weight * w[K8 + j]
            w[S8 + j] = w[Y8 + j] + ahead * w[K8 + j]
    if on[17]:
        for j in range(LANES):
            w[SUM9 + j] += weight * w[K9 + j]
            w[S9 + j] = w[Y9 + j] + ahead * w[K9 + j]


@kernel
def end_stages(sixth, w, on):
    """Advance the states by the sum of the rates times a sixth of the step [s]."""
    for j in range(LANES):
        w[Y0 + j] += sixth * (w[SUM0 + j] + w[K0 + j])
        w[S0 + j] = w[Y0 + j]
    for j in range(LANES):
        w[Y1 + j] += sixth * (w[SUM1 + j] + w[K1 + j])
        w[S1 + j] = w[Y1 + j]
    if on[6]:
        for j in range(LANES):
            w[Y3 + j] += sixth * (w[SUM3 + j] + w[K3 + j])
            w[S3 + j] = w[Y3 + j]
    if on[12]:
        for j in range(LANES):
            w[Y5 + j] += sixth * (w[SUM5 + j] + w[K5 + j])
            w[S5 + j] = w[Y5 + j]
    if on[14]:
        for j in range(LANES):
            w[Y6 + j] += sixth * (w[SUM6 + j] + w[K6 + j])
            w[S6 + j] = w[Y6 + j]
        for j in range(LANES):
            w[Y7 + j] += sixth * (w[SUM7 + j] + w[K7 + j])
            w[S7 + j] = w[Y7 + j]
    if on[16]:
        for j in range(LANES):
            w[Y8 + j] += sixth * (w[SUM8 + j] + w[K8 + j])
            w[S8 + j] = w[Y8 + j]
    if on[17]:
        for j in range(LANES):
            w[Y9 + j] += sixth * (w[SUM9 + j] + w[K9 + j])
            w[S9 + j] = w[Y9 + j]


@kernel
def move(h, w):
    """Move the piston on by h seconds."""
    for j in range(LANES):
        w[X + j] += h * w[RATE + j]


@kernel
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


@kernel
def leave_behind_valve_hysteresis(time, ambient, w, on):
    """Compute the error at which this play stands."""
    valve_error(time, ambient, w, on)
    for j in range(LANES):
        w[Y2 + j] = valve_hysteresis.error(
            w[ERROR + j],
            Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
            w[S2 + j],
            w[A13 + j],
        )
        w[S2 + j] = w[Y2 + j]


@kernel
def follow(time, x, h, ambient, w, on):
    """Set the piston in motion to where the chamber follows a displacement measured h seconds after the last."""
    for j in range(LANES):
        w[S0 + j] = w[Y0 + j]
        w[RATE + j] = (x - w[MEASURED + j]) / h
        w[MEASURED + j] = x
        w[X + j] = x
    if on[3]:
        for j in range(LANES):
            w[X + j] = displacement_lag.displacement(
                w[X + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[A9 + j],
            )
    if on[11]:
        for j in range(LANES):
            w[X + j] = lost_motion.displacement(
                w[X + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[Y4 + j],
                w[A27 + j],
            )
            w[Y4 + j] = w[X + j]
    for j in range(LANES):
        followed = w[X + j]
        w[RATE + j] = (followed - w[FOLLOWED + j]) / h
        w[X + j] = w[FOLLOWED + j]
        w[FOLLOWED + j] = followed


@kernel
def read(time, ambient, w, on):
    """Compute what the pressure sensor reads [Pa]."""
    for j in range(LANES):
        w[SIGNAL + j] = w[Y0 + j]
    if on[12]:
        for j in range(LANES):
            w[SIGNAL + j] = sensor_lag.signal(
                w[SIGNAL + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S5 + j],
                w[A28 + j],
            )
    if on[14]:
        for j in range(LANES):
            w[SIGNAL + j] = line_resonance.signal(
                w[SIGNAL + j],
                Moment(time, w[X + j], w[RATE + j], w[S0 + j], w[SETPOINT + j], ambient, w[SWEPT + j]),
                w[S6 + j],
                w[S7 + j],
                w[A30 + j],
                w[A31 + j],
            )


@kernel
def rest(x, setpoint, w):
    """Set the states to rest at a displacement [m] and a pressure [Pa], each lane's at its own."""
    for j in range(LANES):
        pressure = setpoint + w[OFFSET + j]
        w[Y0 + j] = pressure
        w[Y1 + j] = pressure
        w[Y2 + j] = 0.0
        w[Y3 + j] = 0.0
        w[Y4 + j] = x
        w[Y5 + j] = pressure
        w[Y6 + j] = pressure
        w[Y7 + j] = 0.0
        w[Y8 + j] = 0.0
        w[Y9 + j] = 0.0
        w[FOLLOWED + j] = x
        w[MEASURED + j] = x
        w[X + j] = x
        w[RATE + j] = 0.0
        w[SWEPT + j] = 0.0
        w[SETPOINT + j] = pressure
        w[S0 + j] = w[Y0 + j]
        w[S1 + j] = w[Y1 + j]
        w[S2 + j] = w[Y2 + j]
        w[S3 + j] = w[Y3 + j]
        w[S4 + j] = w[Y4 + j]
        w[S5 + j] = w[Y5 + j]
        w[S6 + j] = w[Y6 + j]
        w[S7 + j] = w[Y7 + j]
        w[S8 + j] = w[Y8 + j]
        w[S9 + j] = w[Y9 + j]


@kernel
def settle(setpoint, duration, ambient, stiffness, w, on):
    """Let the cylinders stand still at a set-point for some seconds, before time begins."""
    for j in range(LANES):
        w[SETPOINT + j] = setpoint + w[OFFSET + j]
        w[RATE + j] = 0.0
        w[X + j] = w[FOLLOWED + j]
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
    for j in range(LANES):
        w[SETPOINT + j] = setpoint + w[OFFSET + j]
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
    state[SLID] = x
    moment = ForceMoment(time, x, rate, acceleration, p_a, p_opposing, ambient)
    force = area_times_factor * (p_a - p_opposing)
    if on[0]:
        force = moving_mass.force(force, moment, a[0], a[1])
    if on[1]:
        force = seal_friction.force(force, moment, state[0], a[2], a[3], a[4], a[5])
    if on[2]:
        force = stribeck_friction.force(force, moment, a[6], a[7])
    if on[3]:
        force = force_offset.force(force, moment, a[8])
    return force


@kernel
def propagate_force(
    times, displacement, rate, acceleration, p_a, p_opposing, ambient, area_times_factor, state, a, on, force_out
):
    """Advance over a recording; write the contact force at each sample [N]."""
    for i in range(times.size):
        force_out[i] = step_force(
            times[i] - times[0],
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
