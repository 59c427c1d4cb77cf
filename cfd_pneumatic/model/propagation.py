# SPDX-License-Identifier: Apache-2.0
"""
Exact propagation of one regulator and cylinder, with forward sensitivities.

Between two samples the displacement is a straight line and the set-point is constant. Equations (8) and (12) of the
paper are then an affine system with constant coefficients. Its states are the deviations u = p - p_d and w = p_f - p_d
from the set-point p_d::

    u' = a11 u + a12 w + b1        a11 = 0       a12 = -K       b1 = -K_x x'
    w' = a21 u + a22 w + b2        a21 = 1/tau   a22 = -1/tau   b2 = 0

K is K_sv while w < 0 and K_v while w > 0 (the paper prints this switch reversed). A step is cut into pieces where w
changes sign. On a piece the solution is a 2 x 2 matrix exponential in closed form. The vector field is continuous at
the switch, so that sensitivities cross the switch unchanged.

Nearly all steps are one piece, and nearly all recordings have one sample period. The exponential of each branch is
therefore kept from step to step. If a period differs by the rounding of its times, a first-order correction is exact to
rounding.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cfd_pneumatic.model.kernels import fused, inlined, inner, kernel

SENSITIVITIES = ('k_x', 'k_sv', 'k_v', 'tau', 'setpoint', 'start')
"""Quantities by which the pressure is differentiated, in the order of the sensitivities' columns."""

CARRIED = 5
"""Number of carried pairs of derivatives. Derivatives of deviations by the set-point are zero and not carried."""

_CLOSE = 1e-11  # share of a piece; the field is continuous at the switch, so that errors in its time act squared
_NEAR = 1e-5  # share of a piece; after a Newton step of this size the next step would be its square
_FLAT = 1e-6  # slope at an extremum relative to the remaining distance from the switch
_ITERATIONS = 60
_SETTLED = 1e-9  # smaller deviations count as rest [Pa]
_ROUNDED = 1e-7  # share of the time constants: periods that differ by less are equal up to rounding

_SERIES_BELOW = 0.5  # |z| up to which the series in z are exact to rounding
_SERIES_ABOVE = -0.35  # x down to which the series for e^x is exact to rounding
C1, C2, C3, C4, C5, C6 = (1.0 / math.factorial(2 * n) for n in range(1, 7))  # cosh(sqrt z)
S1, S2, S3, S4, S5, S6 = (1.0 / math.factorial(2 * n + 1) for n in range(1, 7))  # sinh(sqrt z) / sqrt z
D0, D1, D2, D3, D4, D5 = ((n + 1.0) / math.factorial(2 * n + 3) for n in range(6))  # d/dz of sinh(sqrt z) / sqrt z
E2, E3, E4, E5, E6, E7, E8, E9, E10, E11, E12 = (1.0 / math.factorial(n) for n in range(2, 13))  # e^x
_LEAST, _FLUSH_PERIOD = 1e-150, 64  # smaller magnitudes count as zero; steps between two flushes
_LONGEST_TURN = 4.0  # (omega h)^2 of a piece: below pi^2, so that w has at most one extremum in it


class Transition(NamedTuple):
    """
    The matrix exponential exp(A h) of a branch over a time, with the factors it is computed from.

    Attributes
    ----------
    h
        The time [s]; 0 before the first step.
    gain, inverse_gain
        K of the branch [1/s], and 1/K.
    z
        -det(B) h^2 with B = A + I/(2 tau); below zero the state oscillates and turns by the angle sqrt(-z).
    decay
        e^(-h/(2 tau)).
    cosine, sine
        exp(A h) = cosine I + sine B.
    e11, e12, e21, e22
        exp(A h).
    slack
        Times that differ by less are equal up to rounding [s].

    """

    h: float
    gain: float
    inverse_gain: float
    z: float
    decay: float
    cosine: float
    sine: float
    e11: float
    e12: float
    e21: float
    e22: float
    slack: float


class Slopes(NamedTuple):
    """Derivatives of exp(A h) by the gain of the branch (g) and by tau (t); h as in `Transition`."""

    h: float
    g11: float
    g12: float
    g21: float
    g22: float
    t11: float
    t12: float
    t21: float
    t22: float


@kernel
def interpolate_gains(table, setpoint):
    """Interpolate (k_x, k_sv, k_v, tau) at a gauge set-point [Pa] in an operating-point table; constant outside."""
    last = table.shape[0] - 1
    if setpoint <= table[0, 0]:
        return table[0, 1], table[0, 2], table[0, 3], table[0, 4]
    if setpoint >= table[last, 0]:
        return table[last, 1], table[last, 2], table[last, 3], table[last, 4]
    row = 0
    while table[row + 1, 0] < setpoint:
        row += 1
    part = (setpoint - table[row, 0]) / (table[row + 1, 0] - table[row, 0])
    return (
        table[row, 1] + part * (table[row + 1, 1] - table[row, 1]),
        table[row, 2] + part * (table[row + 1, 2] - table[row, 2]),
        table[row, 3] + part * (table[row + 1, 3] - table[row, 3]),
        table[row, 4] + part * (table[row + 1, 4] - table[row, 4]),
    )


@inlined
def transition(gain, inverse_tau, h):
    """
    Return the 2 x 2 matrix exponential that moves the two states (u, w) of a branch over h seconds.

    Series are summed in pairs, because a processor computes pairs in parallel. Growing exponentials are never formed,
    so that a stiff system does not overflow over a long step.
    """
    mu = -0.5 * inverse_tau
    squared = (0.25 * inverse_tau - gain) * inverse_tau
    x = mu * h
    z = squared * h * h
    if abs(z) < _SERIES_BELOW and x > _SERIES_ABOVE:
        x2 = x * x
        x4 = x2 * x2
        low = (1.0 + x) + (E2 + E3 * x) * x2 + ((E4 + E5 * x) + (E6 + E7 * x) * x2) * x4
        decay = low + ((E8 + E9 * x) + (E10 + E11 * x) * x2 + E12 * x4) * (x4 * x4)
    else:
        decay = math.exp(x)
    if abs(z) < _SERIES_BELOW:
        z2 = z * z
        z4 = z2 * z2
        cosine = decay * ((1.0 + C1 * z) + (C2 + C3 * z) * z2 + ((C4 + C5 * z) + C6 * z2) * z4)
        sine = decay * h * ((1.0 + S1 * z) + (S2 + S3 * z) * z2 + ((S4 + S5 * z) + S6 * z2) * z4)
    elif z > 0.0:
        root = math.sqrt(squared)
        slow = math.exp((mu + root) * h)
        fast = math.exp((mu - root) * h)
        cosine = 0.5 * (slow + fast)
        sine = 0.5 * (slow - fast) / root
    else:
        omega = math.sqrt(-squared)
        cosine = decay * math.cos(omega * h)
        sine = decay * math.sin(omega * h) / omega
    return Transition(
        h,
        gain,
        1.0 / gain,
        z,
        decay,
        cosine,
        sine,
        cosine - sine * mu,
        -sine * gain,
        sine * inverse_tau,
        cosine + sine * mu,
        _ROUNDED / (gain + inverse_tau),
    )


@inlined
def transition_slopes(step, inverse_tau):
    """Return the derivatives of a branch's transition."""
    h, gain, cosine, sine, z = step.h, step.gain, step.cosine, step.sine, step.z
    mu = -0.5 * inverse_tau
    if abs(z) < _SERIES_BELOW:  # d sine / d squared, with squared = z / h^2
        z2 = z * z
        sine_slope = step.decay * h * h * h * ((D0 + D1 * z) + (D2 + D3 * z) * z2 + (D4 + D5 * z) * (z2 * z2))
    else:
        sine_slope = 0.5 * (h * cosine - sine) * h * h / z
    cosine_slope = 0.5 * h * sine
    # by the gain: d squared = -1/tau, and dA has -1 in its upper right
    c = -cosine_slope * inverse_tau
    s = -sine_slope * inverse_tau
    g11, g12, g21, g22 = c - s * mu, -s * gain - sine, s * inverse_tau, c + s * mu
    # by tau: mu = -1/(2 tau), squared = 1/(4 tau^2) - gain/tau
    mu_tau = 0.5 * inverse_tau * inverse_tau
    squared_tau = (gain - 0.5 * inverse_tau) * inverse_tau * inverse_tau
    c = h * mu_tau * cosine + cosine_slope * squared_tau
    s = h * mu_tau * sine + sine_slope * squared_tau
    t11, t12 = c - s * mu - sine * mu_tau, -s * gain
    t21, t22 = (s - sine * inverse_tau) * inverse_tau, c + s * mu + sine * mu_tau
    return Slopes(h, g11, g12, g21, g22, t11, t12, t21, t22)


@inlined
def corrected_transition(step, h, inverse_tau):
    """Return a transition corrected to a time h that differs from its own time by rounding; exact to rounding."""
    excess = h - step.h
    by_gain = excess * step.gain
    by_sensing = excess * inverse_tau
    return Transition(
        step.h,
        step.gain,
        step.inverse_gain,
        step.z,
        step.decay,
        step.cosine,
        step.sine,
        step.e11 - by_gain * step.e21,
        step.e12 - by_gain * step.e22,
        step.e21 + by_sensing * (step.e11 - step.e21),
        step.e22 + by_sensing * (step.e12 - step.e22),
        step.slack,
    )


@inlined
def state_after(step, u, w, b1):
    """Return (u, w) after a transition."""
    equilibrium = b1 * step.inverse_gain
    return (
        (equilibrium - equilibrium * step.e11 - equilibrium * step.e12) + step.e12 * w + step.e11 * u,
        (equilibrium - equilibrium * step.e21 - equilibrium * step.e22) + step.e21 * u + step.e22 * w,
    )


@inlined
def move_derivatives(carried, step, slopes, charges, u, w, rate, b1):
    """
    Move the derivatives of a state over a transition that begins at (u, w).

    Parameters
    ----------
    carried
        As in `propagate`.
    step, slopes
        The transition and its slopes.
    charges
        Whether K_sv is the gain of the transition's branch.
    u, w
        State before the transition, as deviations from the set-point [Pa].
    rate
        Speed of the piston [m/s].
    b1
        -K_x times the speed [Pa/s].

    """
    equilibrium = b1 * step.inverse_gain
    du = u - equilibrium
    dw = w - equilibrium
    by_equilibrium_u = 1.0 - step.e11 - step.e12  # derivative by the equilibrium
    by_equilibrium_w = 1.0 - step.e21 - step.e22
    by_kx = -rate * step.inverse_gain
    by_gain = -equilibrium * step.inverse_gain
    gain_u = slopes.g11 * du + slopes.g12 * dw + by_gain * by_equilibrium_u
    gain_w = slopes.g21 * du + slopes.g22 * dw + by_gain * by_equilibrium_w
    move_pair(carried, 0, step, by_kx * by_equilibrium_u, by_kx * by_equilibrium_w)
    move_pair(carried, 1, step, gain_u if charges else 0.0, gain_w if charges else 0.0)
    move_pair(carried, 2, step, 0.0 if charges else gain_u, 0.0 if charges else gain_w)
    move_pair(carried, 3, step, slopes.t11 * du + slopes.t12 * dw, slopes.t21 * du + slopes.t22 * dw)
    move_pair(carried, 4, step, 0.0, 0.0)


@inlined
def move_pair(carried, column, step, added_u, added_w):
    """Move one pair of derivatives over a transition and add the transition's derivatives."""
    by_u = carried[0, column]
    by_w = carried[1, column]
    carried[0, column] = step.e11 * by_u + step.e12 * by_w + added_u
    carried[1, column] = step.e21 * by_u + step.e22 * by_w + added_w


@inlined
def switch_side(u, w, b1):
    """Return a number with the sign of w, or of its next change at w = 0; below zero K_sv acts, equation (12)."""
    side = w
    if side == 0.0:
        side = u - w
        if side == 0.0:
            side = b1
    return side


@inner
def state_on_branch(u, w, gain, inverse_tau, b1, h):
    """Return (u, w) after h seconds on one branch."""
    return state_after(transition(gain, inverse_tau, h), u, w, b1)


@inlined
def keeps_sign(side, u, w, u_end, w_end):
    """
    Return whether w keeps its sign, that of `side`, over a piece from (u, w) to (u_end, w_end).

    On a piece of at most a third of an oscillation w has at most one extremum. w crosses zero once if its ends have
    opposite signs. w crosses zero twice or never if its ends have one sign and w turns back between them.
    Values of w close to zero have no sign, because a smoothed displacement never rests exactly.
    """
    if side * w_end >= 0.0 and (side * (u - w) >= 0.0 or side * (u_end - w_end) <= 0.0):
        return True
    return abs(w) + abs(w_end) <= _SETTLED


@inlined
def likely_crossing(begin, end, begin_rate, end_rate, h):
    """Return about when in (0, h) the cubic with the values and rates of a piece's ends crosses zero [s]."""
    share = begin / (begin - end)
    for _ in range(4):  # Newton's method, from the crossing of the straight line
        complement = 1.0 - share
        value = complement * complement * ((1.0 + 2.0 * share) * begin + share * h * begin_rate)
        value += share * share * ((1.0 + 2.0 * complement) * end - complement * h * end_rate)
        slope = 6.0 * share * complement * (end - begin) + complement * (complement - 2.0 * share) * h * begin_rate
        slope += share * (share - 2.0 * complement) * h * end_rate
        if slope != 0.0:
            share = min(max(share - value / slope, 0.0), 1.0)
    return share * h


@inner
def first_crossing(u, w, gain, inverse_tau, b1, h, u_end, w_end):
    """Return the time in (0, h] at which w first reaches zero, or h if w does not [s]."""
    side = switch_side(u, w, b1)
    if keeps_sign(side, u, w, u_end, w_end):
        return h
    last = h
    if side * w_end >= 0.0:
        first = 0.0
        begin = u - w
        end = u_end - w_end
        for _ in range(_ITERATIONS):  # the extremum is where u = w: regula falsi, the retained end halved (Illinois)
            middle = first + (last - first) * begin / (begin - end)
            u_middle, w_middle = state_on_branch(u, w, gain, inverse_tau, b1, middle)
            slope = u_middle - w_middle
            if side * w_middle < 0.0 or abs(slope) <= _FLAT * abs(w_middle):
                last = middle
                break
            if slope * begin > 0.0:
                first = middle
                begin = slope
                end *= 0.5
            else:
                last = middle
                end = slope
                begin *= 0.5
        _, w_last = state_on_branch(u, w, gain, inverse_tau, b1, last)
        if side * w_last >= 0.0:
            return h
    first = 0.0
    time = (
        likely_crossing(w, w_end, (u - w) * inverse_tau, (u_end - w_end) * inverse_tau, h) if last == h else 0.5 * last
    )
    for _ in range(_ITERATIONS):  # Newton's method, kept inside its bracket
        u_now, w_now = state_on_branch(u, w, gain, inverse_tau, b1, time)
        if side * w_now >= 0.0:
            first = time
        else:
            last = time
        rate = (u_now - w_now) * inverse_tau
        next_time = time - w_now / rate if rate != 0.0 else last
        if not first < next_time < last:
            next_time = 0.5 * (first + last)
        shift = abs(next_time - time)
        time = next_time
        if shift <= _NEAR * h:
            break
    return time


@inner
def first_piece(u, w, gain, inverse_tau, b1, remaining):
    """
    Return (transition, u, w) of the first piece of a step on a branch.

    Pieces end where w crosses zero, and before an oscillation turns more than once. A decayed oscillation and a state
    beyond the range of numbers are not cut any further.
    """
    step = transition(gain, inverse_tau, remaining)
    equilibrium = b1 * step.inverse_gain
    if step.z < -_LONGEST_TURN and abs(u - equilibrium) + abs(w - equilibrium) > _SETTLED:
        step = transition(gain, inverse_tau, remaining / math.ceil(math.sqrt(step.z / -_LONGEST_TURN)))
    u_end, w_end = state_after(step, u, w, b1)
    if not abs(w_end) < math.inf:
        return transition(gain, inverse_tau, remaining), math.nan, math.nan
    time = first_crossing(u, w, gain, inverse_tau, b1, step.h, u_end, w_end)
    if time < step.h:
        step = transition(gain, inverse_tau, max(time, _CLOSE * step.h))
        u_end, _ = state_after(step, u, w, b1)
        w_end = 0.0
    return step, u_end, w_end


@inner
def step_by_pieces(u, w, h, rate, k_x, k_sv, k_v, inverse_tau, carried=None):
    """Return (u, w) after h seconds with any number of switches; move the derivatives too, if there are any."""
    b1 = -k_x * rate
    remaining = h
    while remaining > 0.0:
        charges = switch_side(u, w, b1) < 0.0
        step, u_end, w_end = first_piece(u, w, k_sv if charges else k_v, inverse_tau, b1, remaining)
        if carried is not None:
            move_derivatives(carried, step, transition_slopes(step, inverse_tau), charges, u, w, rate, b1)
        u = u_end
        w = w_end
        remaining -= step.h
    return u, w


@fused
def advance(p, p_f, h, rate, setpoint, k_x, k_sv, k_v, tau):
    """
    Return outlet and sensed pressure [Pa] after h seconds at constant piston rate [m/s] and set-point [Pa].

    Equations (8) and (12), exact. Pressures and set-point share one zero (absolute or gauge).
    """
    u, w = step_by_pieces(p - setpoint, p_f - setpoint, h, rate, k_x, k_sv, k_v, 1.0 / tau)
    return setpoint + u, setpoint + w


@inlined
def flushed_to_zero(value):
    """Return a value, or zero if its magnitude is negligible."""
    return value if abs(value) > _LEAST else 0.0


@inlined
def write_sample(i, value, pressure, carried, jacobian):
    """Write `value` into `pressure[i]` and, if requested, its derivatives into `jacobian[i]`."""
    pressure[i] = value
    if jacobian is not None:
        for k in range(4):
            jacobian[i, k] = carried[0, k]
        jacobian[i, 4] = 1.0
        jacobian[i, 5] = carried[0, 4]


@fused
def propagate(times, displacement, setpoint, table, ambient, state, pressure, carried=None, jacobian=None):
    """
    Propagate over a recording; write the outlet pressure at each sample and, if requested, its derivatives.

    Parameters
    ----------
    times
        Sample times, increasing, shape (n,) [s].
    displacement
        Displacement that grows the chamber, shape (n,), linear between samples [m].
    setpoint
        Absolute set-point, shape (n,) [Pa]; entry i acts on the step that ends at sample i.
    table
        Operating points, shape (m, 5): rows of gauge set-point, k_x, k_sv, k_v, tau.
    ambient
        Ambient pressure [Pa].
    state
        Outlet and sensed pressure at the first sample, shape (2,) [Pa]; on return those at the last sample.
    pressure
        Output: the outlet pressure at each sample, shape (n,) [Pa].
    carried
        Derivatives of the state at the first sample, shape (2, CARRIED), by all of `SENSITIVITIES` except the
        set-point; on return those at the last sample.
    jacobian
        Output: the derivatives of the pressure by `SENSITIVITIES` at each sample, shape (n, 6): by the four gains, by a
        shift of the set-point, and by a shift of both pressures at the first sample. Requires a table of one row.

    """
    p_d = setpoint[0]
    u = state[0] - p_d
    w = state[1] - p_d
    k_x, k_sv, k_v, tau = interpolate_gains(table, p_d - ambient)
    inverse_tau = 1.0 / tau
    charging = transition(k_sv, inverse_tau, 0.0)
    venting = transition(k_v, inverse_tau, 0.0)
    if jacobian is not None:
        charging_slopes = transition_slopes(charging, inverse_tau)
        venting_slopes = transition_slopes(venting, inverse_tau)
    write_sample(0, p_d + u, pressure, carried, jacobian)
    for i in range(1, times.size):
        if setpoint[i] != p_d:
            u += p_d - setpoint[i]
            w += p_d - setpoint[i]
            p_d = setpoint[i]
            k_x, k_sv, k_v, tau = interpolate_gains(table, p_d - ambient)
            inverse_tau = 1.0 / tau
            charging = transition(k_sv, inverse_tau, 0.0)
            venting = transition(k_v, inverse_tau, 0.0)
        h = times[i] - times[i - 1]
        rate = (displacement[i] - displacement[i - 1]) / h
        b1 = -k_x * rate
        side = switch_side(u, w, b1)
        charges = side < 0.0
        if charges:
            if not abs(h - charging.h) <= charging.slack:
                charging = transition(k_sv, inverse_tau, h)
            step = corrected_transition(charging, h, inverse_tau)
        else:
            if not abs(h - venting.h) <= venting.slack:
                venting = transition(k_v, inverse_tau, h)
            step = corrected_transition(venting, h, inverse_tau)
        u_end, w_end = state_after(step, u, w, b1)
        if step.z < -_LONGEST_TURN or not keeps_sign(side, u, w, u_end, w_end):
            u_end, w_end = step_by_pieces(u, w, h, rate, k_x, k_sv, k_v, inverse_tau, carried)
        elif jacobian is not None:
            if charges:
                if charging_slopes.h != charging.h:
                    charging_slopes = transition_slopes(charging, inverse_tau)
                move_derivatives(carried, step, charging_slopes, charges, u, w, rate, b1)
            else:
                if venting_slopes.h != venting.h:
                    venting_slopes = transition_slopes(venting, inverse_tau)
                move_derivatives(carried, step, venting_slopes, charges, u, w, rate, b1)
        u = u_end
        w = w_end
        if i % _FLUSH_PERIOD == 0:  # a processor takes ten times as long once they are denormal
            u = flushed_to_zero(u)
            w = flushed_to_zero(w)
            if jacobian is not None:
                for column in range(CARRIED):
                    carried[0, column] = flushed_to_zero(carried[0, column])
                    carried[1, column] = flushed_to_zero(carried[1, column])
        write_sample(i, p_d + u, pressure, carried, jacobian)
    state[0] = p_d + u
    state[1] = p_d + w
