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

Everything here is one step of a loop over samples: a live simulator calls it with two samples, a fit with a recording.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.kernel import kernel

SENSITIVITIES = ('k_x', 'k_sv', 'k_v', 'tau', 'setpoint', 'start')
"""What the pressure is differentiated by, in the order of the sensitivities' columns."""

_CLOSE = 1e-11  # share of a piece; the field is continuous at the switch, so that an error in its time acts squared
_FLAT = 1e-6  # slope at an extremum, against the distance from the switch that remains there
_ITERATIONS = 60
_SETTLED = 1e-9  # an oscillation smaller than this is over [Pa]

_SERIES_BELOW = 0.5  # |z| up to which these series are exact to rounding
C1, C2, C3, C4, C5, C6 = (1.0 / math.factorial(2 * n) for n in range(1, 7))  # cosh(sqrt z)
S1, S2, S3, S4, S5, S6 = (1.0 / math.factorial(2 * n + 1) for n in range(1, 7))  # sinh(sqrt z) / sqrt z
D0, D1, D2, D3, D4, D5 = ((n + 1.0) / math.factorial(2 * n + 3) for n in range(6))  # d/dz of the latter
_LONGEST_TURN = 4.0  # (omega h)^2 of a piece: below pi^2, so that w has at most one extremum in it


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


@kernel
def exponential(a11, a12, a21, a22, h):
    """
    Return exp(A h) of a 2 x 2 matrix as (mu, squared, cosine, sine).

    With mu half the trace, B = A - mu I and squared = -det B: exp(A h) = cosine I + sine B, both factors e^(mu h)
    included. Growing exponentials are never formed, so that a stiff system over a long step does not overflow.
    """
    mu = 0.5 * (a11 + a22)
    half = 0.5 * (a11 - a22)
    squared = half * half + a12 * a21
    z = squared * h * h
    if abs(z) < _SERIES_BELOW:
        scale = math.exp(mu * h)
        c = 1.0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * C6)))))
        s = 1.0 + z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * (S5 + z * S6)))))
        return mu, squared, scale * c, scale * h * s
    if z > 0.0:
        root = math.sqrt(squared)
        slow = math.exp((mu + root) * h)
        fast = math.exp((mu - root) * h)
        return mu, squared, 0.5 * (slow + fast), 0.5 * (slow - fast) / root
    scale = math.exp(mu * h)
    omega = math.sqrt(-squared)
    return mu, squared, scale * math.cos(omega * h), scale * math.sin(omega * h) / omega


@kernel
def branch_gain(u, w, tau, b1, k_sv, k_v):
    """Return K of the branch on which the state is, or which it enters when p_f = p_d: equations (9), (10), (12)."""
    side = w
    if side == 0.0:
        side = (u - w) / tau
    if side == 0.0:
        side = b1
    return k_sv if side < 0.0 else k_v


@kernel
def relax(u, w, gain, tau, b1, h):
    """Return (u, w) after h seconds on one branch."""
    rest = b1 / gain
    mu, _, cosine, sine = exponential(0.0, -gain, 1.0 / tau, -1.0 / tau, h)
    du = u - rest
    dw = w - rest
    return (
        rest + (cosine - sine * mu) * du - sine * gain * dw,
        rest + sine / tau * du + (cosine + sine * mu) * dw,
    )


@kernel
def first_crossing(u, w, gain, tau, b1, h, u_end, w_end):
    """
    Return the time in (0, h] at which w first reaches zero, or h where it doesn't.

    On a piece of at most a third of an oscillation w has at most one extremum. It therefore crosses once if its ends
    lie on opposite sides, twice or never if they lie on one side and w turns back in between, and never otherwise.
    """
    rate = (u - w) / tau
    side = w if w != 0.0 else (rate if rate != 0.0 else b1)
    last = h
    if side * w_end >= 0.0:
        if side * rate >= 0.0 or side * (u_end - w_end) <= 0.0:
            return h
        first = 0.0
        begin = u - w
        end = u_end - w_end
        for _ in range(_ITERATIONS):  # the extremum is where u = w: regula falsi, the retained end halved (Illinois)
            middle = first + (last - first) * begin / (begin - end)
            u_middle, w_middle = relax(u, w, gain, tau, b1, middle)
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
        _, w_last = relax(u, w, gain, tau, b1, last)
        if side * w_last >= 0.0:
            return h
    first = 0.0
    time = 0.5 * last
    for _ in range(_ITERATIONS):  # Newton's method, kept inside its bracket
        u_now, w_now = relax(u, w, gain, tau, b1, time)
        if side * w_now >= 0.0:
            first = time
        else:
            last = time
        rate = (u_now - w_now) / tau
        following = time - w_now / rate if rate != 0.0 else last
        if not first < following < last:
            following = 0.5 * (first + last)
        moved = abs(following - time)
        time = following
        if moved <= _CLOSE * h:
            break
    return time


@kernel
def next_piece(u, w, tau, b1, k_sv, k_v, remaining):
    """
    Return (gain, duration, u, w) of the piece of a step that begins at (u, w).

    Pieces end where w crosses zero, and where an oscillation would turn more than once; one that has died away, or a
    state that has left the range of numbers, is not followed any more.
    """
    gain = branch_gain(u, w, tau, b1, k_sv, k_v)
    h = remaining
    rest = b1 / gain
    turn = (gain / tau - 0.25 / (tau * tau)) * h * h
    if turn > _LONGEST_TURN and abs(u - rest) + abs(w - rest) > _SETTLED:
        h = h / math.ceil(math.sqrt(turn / _LONGEST_TURN))
    u_end, w_end = relax(u, w, gain, tau, b1, h)
    if not abs(w_end) < math.inf:
        return gain, remaining, math.nan, math.nan
    time = first_crossing(u, w, gain, tau, b1, h, u_end, w_end)
    if time < h:
        time = max(time, _CLOSE * h)
        u_end, _ = relax(u, w, gain, tau, b1, time)
        return gain, time, u_end, 0.0
    return gain, h, u_end, w_end


@kernel
def advance(p, p_f, h, rate, setpoint, k_x, k_sv, k_v, tau):
    """
    Return outlet and sensed pressure [Pa] after h seconds at constant piston rate [m/s] and set-point [Pa].

    Equations (8) and (12), exact. Pressures and set-point share one zero (absolute or gauge).
    """
    u = p - setpoint
    w = p_f - setpoint
    b1 = -k_x * rate
    remaining = h
    while remaining > 0.0:
        _, time, u, w = next_piece(u, w, tau, b1, k_sv, k_v, remaining)
        remaining -= time
    return setpoint + u, setpoint + w


@kernel
def propagate(times, displacement, setpoint, table, ambient, state, pressure):
    """
    Propagate over a recording; write the outlet pressure at each sample.

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

    """
    p = state[0]
    p_f = state[1]
    pressure[0] = p
    k_x, k_sv, k_v, tau = interpolate_gains(table, setpoint[0] - ambient)
    for i in range(1, times.size):
        if setpoint[i] != setpoint[i - 1]:
            k_x, k_sv, k_v, tau = interpolate_gains(table, setpoint[i] - ambient)
        h = times[i] - times[i - 1]
        rate = (displacement[i] - displacement[i - 1]) / h
        p, p_f = advance(p, p_f, h, rate, setpoint[i], k_x, k_sv, k_v, tau)
        pressure[i] = p
    state[0] = p
    state[1] = p_f


@kernel
def propagate_sensitivities(times, displacement, setpoint, gains, state, pressure, jacobian):
    """
    Propagate as `propagate` does, at constant gains, with the pressure's derivatives.

    Parameters
    ----------
    times, displacement, setpoint, pressure
        As in `propagate`.
    gains
        k_x, k_sv, k_v, tau, shape (4,).
    state
        Outlet and sensed pressure at the first sample, shape (2,) [Pa], taken to move with the set-point.
    jacobian
        Takes the derivatives by `SENSITIVITIES` at each sample, shape (n, 6): by the four gains, by a shift of the
        set-point, and by a shift of both pressures at the first sample.

    """
    k_x, k_sv, k_v, tau = gains[0], gains[1], gains[2], gains[3]
    p = state[0]
    p_f = state[1]
    pressure[0] = p
    jacobian[0, :] = 0.0
    jacobian[0, 4] = 1.0
    jacobian[0, 5] = 1.0
    # derivatives of (u, w); those by the set-point stay zero, because the state at the start moves with it
    u_kx = w_kx = u_sv = w_sv = u_v = w_v = u_tau = w_tau = 0.0
    u_start = w_start = 1.0
    for i in range(1, times.size):
        p_d = setpoint[i]
        h = times[i] - times[i - 1]
        rate = (displacement[i] - displacement[i - 1]) / h
        b1 = -k_x * rate
        u = p - p_d
        w = p_f - p_d
        remaining = h
        while remaining > 0.0:
            gain, time, u_end, w_end = next_piece(u, w, tau, b1, k_sv, k_v, remaining)
            mu, squared, cosine, sine = exponential(0.0, -gain, 1.0 / tau, -1.0 / tau, time)
            z = squared * time * time
            if abs(z) < _SERIES_BELOW:  # d sine / d squared, without e^(mu h)
                series = D0 + z * (D1 + z * (D2 + z * (D3 + z * (D4 + z * D5))))
                sine_slope = math.exp(mu * time) * time**3 * series
            else:
                sine_slope = 0.5 * (time * cosine - sine) / squared
            cosine_slope = 0.5 * time * sine
            e11 = cosine - sine * mu
            e12 = -sine * gain
            e21 = sine / tau
            e22 = cosine + sine * mu
            rest = b1 / gain
            du = u - rest
            dw = w - rest
            # by the gain of this branch: d squared = -1/tau, dA has -1 in its upper right
            c = -cosine_slope / tau
            s = -sine_slope / tau
            rest_gain = -rest / gain
            by_gain_u = (c - s * mu) * du - (s * gain + sine) * dw + rest_gain * (1.0 - e11 - e12)
            by_gain_w = s / tau * du + (c + s * mu) * dw + rest_gain * (1.0 - e21 - e22)
            # by tau: mu = -1/(2 tau), squared = 1/(4 tau^2) - gain/tau
            inverse = 1.0 / tau
            mu_tau = 0.5 * inverse * inverse
            squared_tau = -0.5 * inverse**3 + gain * inverse * inverse
            c = time * mu_tau * cosine + cosine_slope * squared_tau
            s = time * mu_tau * sine + sine_slope * squared_tau
            by_tau_u = (c - s * mu - sine * mu_tau) * du - s * gain * dw
            by_tau_w = (s * inverse - sine * inverse * inverse) * du + (c + s * mu + sine * mu_tau) * dw
            # by k_x: the rest point moves by -rate / gain
            rest_kx = -rate / gain
            u_kx, w_kx = (
                e11 * u_kx + e12 * w_kx + rest_kx * (1.0 - e11 - e12),
                e21 * u_kx + e22 * w_kx + rest_kx * (1.0 - e21 - e22),
            )
            u_sv, w_sv = e11 * u_sv + e12 * w_sv, e21 * u_sv + e22 * w_sv
            u_v, w_v = e11 * u_v + e12 * w_v, e21 * u_v + e22 * w_v
            if branch_gain(u, w, tau, b1, 0.0, 1.0) == 0.0:
                u_sv += by_gain_u
                w_sv += by_gain_w
            else:
                u_v += by_gain_u
                w_v += by_gain_w
            u_tau, w_tau = e11 * u_tau + e12 * w_tau + by_tau_u, e21 * u_tau + e22 * w_tau + by_tau_w
            u_start, w_start = e11 * u_start + e12 * w_start, e21 * u_start + e22 * w_start
            u = u_end
            w = w_end
            remaining -= time
        p = p_d + u
        p_f = p_d + w
        pressure[i] = p
        jacobian[i, 0] = u_kx
        jacobian[i, 1] = u_sv
        jacobian[i, 2] = u_v
        jacobian[i, 3] = u_tau
        jacobian[i, 4] = 1.0
        jacobian[i, 5] = u_start
    state[0] = p
    state[1] = p_f
