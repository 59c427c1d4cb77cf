# SPDX-License-Identifier: Apache-2.0
"""
Exact propagation of one regulator and cylinder, with forward sensitivities.

Between two samples the displacement is a straight line and the set-point is held, so that equations (8) and (12) of the
paper are an affine system with constant coefficients, here in deviations u = p - p_d and w = p_f - p_d from the
set-point p_d::

    u' = a11 u + a12 w + b1        a11 = 0       a12 = -K       b1 = -K_x x'
    w' = a21 u + a22 w + b2        a21 = 1/tau   a22 = -1/tau   b2 = 0

K is K_sv while w < 0 and K_v while w > 0 (the paper prints this switch reversed). A step is cut into pieces where w
changes sign; on a piece the solution is a 2 x 2 matrix exponential in closed form. The vector field is continuous at
the switch, so that sensitivities carry over it unchanged.

Nearly all steps are one piece, and nearly all recordings have one sample period: the exponential of each branch is kept
from step to step. A period that differs by the rounding of its times is made up for to first order, which is exact to
rounding again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cfd_pneumatic.model.kernels import fused, inlined, inner, kernel

SENSITIVITIES = ('k_x', 'k_sv', 'k_v', 'tau', 'setpoint', 'start')
"""What the pressure is differentiated by, in the order of the sensitivities' columns."""

CARRIED = 5
"""How many pairs of derivatives are carried: those by the set-point are zero in deviations from it."""

_CLOSE = 1e-11  # share of a piece; the field is continuous at the switch, so that an error in its time acts squared
_NEAR = 1e-5  # share of a piece that Newton's method moves by last: the next step would move by its square
_FLAT = 1e-6  # slope at an extremum, against the distance from the switch that remains there
_ITERATIONS = 60
_SETTLED = 1e-9  # what is smaller than this is at rest [Pa]
_ROUNDED = 1e-7  # of the time constants: by so much periods may differ that are one but for rounding

_SERIES_BELOW = 0.5  # |z| up to which the series in z are exact to rounding
_SERIES_ABOVE = -0.35  # x down to which the one for e^x is
C1, C2, C3, C4, C5, C6 = (1.0 / math.factorial(2 * n) for n in range(1, 7))  # cosh(sqrt z)
S1, S2, S3, S4, S5, S6 = (1.0 / math.factorial(2 * n + 1) for n in range(1, 7))  # sinh(sqrt z) / sqrt z
D0, D1, D2, D3, D4, D5 = ((n + 1.0) / math.factorial(2 * n + 3) for n in range(6))  # d/dz of the latter
E2, E3, E4, E5, E6, E7, E8, E9, E10, E11, E12 = (1.0 / math.factorial(n) for n in range(2, 13))  # e^x
_LEAST, _FORGETS = 1e-150, 64  # what is next to nothing, and after how many steps it is forgotten
_LONGEST_TURN = 4.0  # (omega h)^2 of a piece: below pi^2, so that w has at most one extremum in it


class Transition(NamedTuple):
    """
    What a branch makes of a state in a time: exp(A h) and what it is made of.

    Attributes
    ----------
    h
        The time [s]; 0 where there is none yet.
    gain, inverse_gain
        K of the branch [1/s], and 1/K.
    z
        -det(B) h^2 with B = A + I/(2 tau): below zero an oscillation turns by sqrt(-z).
    decay
        e^(-h/(2 tau)).
    cosine, sine
        exp(A h) = cosine I + sine B.
    e11, e12, e21, e22
        exp(A h).
    slack
        By how much another time may differ that is the same but for rounding [s].

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
    """Derivatives of exp(A h) by the gain of its branch, g, and by tau, t; h as in `Transition`."""

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
    """Return (k_x, k_sv, k_v, tau) at a gauge set-point [Pa] from rows of an operating-point table, held outside."""
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
    Return the transition of a branch over h seconds.

    Series are summed in pairs, which a processor does side by side. Growing exponentials are never formed, so that a
    stiff system over a long step does not overflow.
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
def over(step, h, inverse_tau):
    """Return a transition over nearly its time, h: exact to rounding where the two differ by rounding."""
    more = h - step.h
    less = more * step.gain
    fall = more * inverse_tau
    return Transition(
        step.h,
        step.gain,
        step.inverse_gain,
        step.z,
        step.decay,
        step.cosine,
        step.sine,
        step.e11 - less * step.e21,
        step.e12 - less * step.e22,
        step.e21 + fall * (step.e11 - step.e21),
        step.e22 + fall * (step.e12 - step.e22),
        step.slack,
    )


@inlined
def moved(step, u, w, b1):
    """Return (u, w) after a transition."""
    rest = b1 * step.inverse_gain
    return (
        (rest - rest * step.e11 - rest * step.e12) + step.e12 * w + step.e11 * u,
        (rest - rest * step.e21 - rest * step.e22) + step.e21 * u + step.e22 * w,
    )


@inlined
def carry(carried, step, by, charges, u, w, rate, b1):
    """
    Move the derivatives of a state over a transition that begins at (u, w).

    Parameters
    ----------
    carried
        As in `propagate`.
    step, by
        The transition and its slopes.
    charges
        Whether its branch is that of K_sv.
    u, w
        State before it, as deviations from the set-point [Pa].
    rate
        Of the piston [m/s].
    b1
        -K_x times it.

    """
    rest = b1 * step.inverse_gain
    du = u - rest
    dw = w - rest
    left_u = 1.0 - step.e11 - step.e12  # of what the rest point moves by
    left_w = 1.0 - step.e21 - step.e22
    by_kx = -rate * step.inverse_gain
    by_gain = -rest * step.inverse_gain
    gain_u = by.g11 * du + by.g12 * dw + by_gain * left_u
    gain_w = by.g21 * du + by.g22 * dw + by_gain * left_w
    relay(carried, 0, step, by_kx * left_u, by_kx * left_w)
    relay(carried, 1, step, gain_u if charges else 0.0, gain_w if charges else 0.0)
    relay(carried, 2, step, 0.0 if charges else gain_u, 0.0 if charges else gain_w)
    relay(carried, 3, step, by.t11 * du + by.t12 * dw, by.t21 * du + by.t22 * dw)
    relay(carried, 4, step, 0.0, 0.0)


@inlined
def relay(carried, column, step, more_u, more_w):
    """Move one pair of derivatives over a transition, and add to it."""
    by_u = carried[0, column]
    by_w = carried[1, column]
    carried[0, column] = step.e11 * by_u + step.e12 * by_w + more_u
    carried[1, column] = step.e21 * by_u + step.e22 * by_w + more_w


@inlined
def lead_of(u, w, b1):
    """Return which way w goes or lies: below zero the branch of K_sv is in force, equations (9), (10), (12)."""
    side = w
    if side == 0.0:
        side = u - w
        if side == 0.0:
            side = b1
    return side


@inner
def relax(u, w, gain, inverse_tau, b1, h):
    """Return (u, w) after h seconds on one branch."""
    return moved(transition(gain, inverse_tau, h), u, w, b1)


@inlined
def stays(side, u, w, u_end, w_end):
    """
    Return whether w keeps its side over a piece.

    On a piece of at most a third of an oscillation w has at most one extremum. It therefore crosses once if its ends
    lie on opposite sides, twice or never if they lie on one side and w turns back in between, and never otherwise.
    Where it is all but zero it has no side: a smoothed displacement never quite stands still.
    """
    if side * w_end >= 0.0 and (side * (u - w) >= 0.0 or side * (u_end - w_end) <= 0.0):
        return True
    return abs(w) + abs(w_end) <= _SETTLED


@inlined
def likely_crossing(begin, end, begin_rate, end_rate, h):
    """Return where in (0, h) the cubic through a piece's ends, with their rates, crosses zero, very nearly."""
    share = begin / (begin - end)
    for _ in range(4):  # of Newton's steps, from where the straight line crosses
        rest = 1.0 - share
        value = rest * rest * ((1.0 + 2.0 * share) * begin + share * h * begin_rate)
        value += share * share * ((1.0 + 2.0 * rest) * end - rest * h * end_rate)
        slope = 6.0 * share * rest * (end - begin) + rest * (rest - 2.0 * share) * h * begin_rate
        slope += share * (share - 2.0 * rest) * h * end_rate
        if slope != 0.0:
            share = min(max(share - value / slope, 0.0), 1.0)
    return share * h


@inner
def first_crossing(u, w, gain, inverse_tau, b1, h, u_end, w_end):
    """Return the time in (0, h] at which w first reaches zero, or h where it doesn't."""
    side = lead_of(u, w, b1)
    if stays(side, u, w, u_end, w_end):
        return h
    last = h
    if side * w_end >= 0.0:
        first = 0.0
        begin = u - w
        end = u_end - w_end
        for _ in range(_ITERATIONS):  # the extremum is where u = w: regula falsi, the retained end halved (Illinois)
            middle = first + (last - first) * begin / (begin - end)
            u_middle, w_middle = relax(u, w, gain, inverse_tau, b1, middle)
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
        _, w_last = relax(u, w, gain, inverse_tau, b1, last)
        if side * w_last >= 0.0:
            return h
    first = 0.0
    time = (
        likely_crossing(w, w_end, (u - w) * inverse_tau, (u_end - w_end) * inverse_tau, h) if last == h else 0.5 * last
    )
    for _ in range(_ITERATIONS):  # Newton's method, kept inside its bracket
        u_now, w_now = relax(u, w, gain, inverse_tau, b1, time)
        if side * w_now >= 0.0:
            first = time
        else:
            last = time
        rate = (u_now - w_now) * inverse_tau
        following = time - w_now / rate if rate != 0.0 else last
        if not first < following < last:
            following = 0.5 * (first + last)
        moved = abs(following - time)
        time = following
        if moved <= _NEAR * h:
            break
    return time


@inner
def first_piece(u, w, gain, inverse_tau, b1, remaining):
    """
    Return (transition, u, w) of the piece that a step begins with on a branch.

    Pieces end where w crosses zero, and where an oscillation would turn more than once; one that has died away, or a
    state that has left the range of numbers, is not followed any more.
    """
    step = transition(gain, inverse_tau, remaining)
    rest = b1 * step.inverse_gain
    if step.z < -_LONGEST_TURN and abs(u - rest) + abs(w - rest) > _SETTLED:
        step = transition(gain, inverse_tau, remaining / math.ceil(math.sqrt(step.z / -_LONGEST_TURN)))
    u_end, w_end = moved(step, u, w, b1)
    if not abs(w_end) < math.inf:
        return transition(gain, inverse_tau, remaining), math.nan, math.nan
    time = first_crossing(u, w, gain, inverse_tau, b1, step.h, u_end, w_end)
    if time < step.h:
        step = transition(gain, inverse_tau, max(time, _CLOSE * step.h))
        u_end, _ = moved(step, u, w, b1)
        w_end = 0.0
    return step, u_end, w_end


@inner
def step_by_pieces(u, w, h, rate, k_x, k_sv, k_v, inverse_tau, carried=None):
    """Return (u, w) after h seconds, however often the branch changes; move the derivatives along if there are any."""
    b1 = -k_x * rate
    remaining = h
    while remaining > 0.0:
        charges = lead_of(u, w, b1) < 0.0
        step, u_end, w_end = first_piece(u, w, k_sv if charges else k_v, inverse_tau, b1, remaining)
        if carried is not None:
            carry(carried, step, transition_slopes(step, inverse_tau), charges, u, w, rate, b1)
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
def perceptible(value):
    """Return a value, zero where it is next to nothing."""
    return value if abs(value) > _LEAST else 0.0


@inlined
def write_sample(i, value, pressure, carried, jacobian):
    """Write the pressure of a sample and, where they are asked for, its derivatives by `SENSITIVITIES`."""
    pressure[i] = value
    if jacobian is not None:
        for k in range(4):
            jacobian[i, k] = carried[0, k]
        jacobian[i, 4] = 1.0
        jacobian[i, 5] = carried[0, 4]


@fused
def propagate(times, displacement, setpoint, table, ambient, state, pressure, carried=None, jacobian=None):
    """
    Propagate over a recording; write the outlet pressure at each sample, and its derivatives where they are asked for.

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
        Outlet and sensed pressure at the first sample, shape (2,) [Pa]; holds those at the last one on return.
    pressure
        Takes the outlet pressure at each sample, shape (n,) [Pa].
    carried
        Derivatives of the state at the first sample, shape (2, CARRIED), by all of `SENSITIVITIES` but the set-point,
        which it moves with; holds those at the last one on return.
    jacobian
        Takes the derivatives of the pressure by `SENSITIVITIES` at each sample, shape (n, 6): by the four gains, by a
        shift of the set-point, and by a shift of both pressures at the first sample. The table has one row then.

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
        side = lead_of(u, w, b1)
        charges = side < 0.0
        if charges:
            if not abs(h - charging.h) <= charging.slack:
                charging = transition(k_sv, inverse_tau, h)
            step = over(charging, h, inverse_tau)
        else:
            if not abs(h - venting.h) <= venting.slack:
                venting = transition(k_v, inverse_tau, h)
            step = over(venting, h, inverse_tau)
        u_end, w_end = moved(step, u, w, b1)
        if step.z < -_LONGEST_TURN or not stays(side, u, w, u_end, w_end):
            u_end, w_end = step_by_pieces(u, w, h, rate, k_x, k_sv, k_v, inverse_tau, carried)
        elif jacobian is not None:
            if charges:
                if charging_slopes.h != charging.h:
                    charging_slopes = transition_slopes(charging, inverse_tau)
                carry(carried, step, charging_slopes, charges, u, w, rate, b1)
            else:
                if venting_slopes.h != venting.h:
                    venting_slopes = transition_slopes(venting, inverse_tau)
                carry(carried, step, venting_slopes, charges, u, w, rate, b1)
        u = u_end
        w = w_end
        if i % _FORGETS == 0:  # a processor takes ten times as long over what has decayed to next to nothing
            u = perceptible(u)
            w = perceptible(w)
            if jacobian is not None:
                for column in range(CARRIED):
                    carried[0, column] = perceptible(carried[0, column])
                    carried[1, column] = perceptible(carried[1, column])
        write_sample(i, p_d + u, pressure, carried, jacobian)
    state[0] = p_d + u
    state[1] = p_d + w
