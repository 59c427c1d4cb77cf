# SPDX-License-Identifier: Apache-2.0
"""
Integrators of the paper's equations that share nothing with the package.

The displacement is a function of time, as a piston has it, not a list of samples.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from math import factorial

import numpy as np

AMBIENT = 101_325.0
PSI = 6894.757293168
INCH = 0.0254


def step_like(start, duration, amplitude):
    """Return a displacement [m] that goes from 0 to `amplitude` with a rate that begins and ends at zero."""

    def displacement(time):
        phase = np.clip((np.asarray(time) - start) / duration, 0.0, 1.0)
        return 0.5 * amplitude * (1.0 - np.cos(np.pi * phase))

    return displacement


def step_like_rate(start, duration, amplitude):
    """Return the rate [m/s] of `step_like`."""

    def rate(time):
        phase = np.clip((time - start) / duration, 0.0, 1.0)
        return 0.5 * amplitude * np.pi / duration * np.sin(np.pi * phase)

    return rate


def pressure(gains, rate, setpoint, times, steps=40):
    """
    Return outlet pressures [Pa] at uniform `times` [s], from rest, at a constant absolute set-point [Pa].

    `gains` are k_x, k_sv, k_v, tau of equations (8) and (12), K_sv while p_d > p_f. `rate` may give an array, one entry
    for each of several pistons, which then makes a column each. Fourth-order Runge-Kutta, `steps` to a sample.
    """
    k_x, k_sv, k_v, tau = gains

    def field(time, p, p_f):
        error = setpoint - p_f
        return np.where(error > 0.0, k_sv, k_v) * error - k_x * rate(time), (p - p_f) / tau

    h = (times[1] - times[0]) / steps
    p = p_f = setpoint + 0.0 * rate(times[0])
    out = [p]
    for begin in times[:-1]:
        for time in begin + h * np.arange(steps):
            dp1, df1 = field(time, p, p_f)
            dp2, df2 = field(time + 0.5 * h, p + 0.5 * h * dp1, p_f + 0.5 * h * df1)
            dp3, df3 = field(time + 0.5 * h, p + 0.5 * h * dp2, p_f + 0.5 * h * df2)
            dp4, df4 = field(time + h, p + h * dp3, p_f + h * df3)
            p = p + h / 6.0 * (dp1 + 2.0 * dp2 + 2.0 * dp3 + dp4)
            p_f = p_f + h / 6.0 * (df1 + 2.0 * df2 + 2.0 * df3 + df4)
        out.append(p)
    return np.array(out)


def pressure_between_samples(gains, times, displacement, setpoint, steps=10):
    """
    Return the outlet pressure [Pa]: displacement straight between samples, entry i of the set-point on step i.

    Fourth-order Runge-Kutta, `steps` to a sample.
    """
    k_x, k_sv, k_v, tau = map(float, gains)
    p = p_f = float(setpoint[0])
    out = [p]
    for step, travel, target in zip(np.diff(times).tolist(), np.diff(displacement).tolist(), setpoint[1:].tolist()):
        forcing, h = k_x * travel / step, step / steps

        def field(p, p_f, forcing=forcing, target=target):
            error = target - p_f
            return (k_sv if error > 0.0 else k_v) * error - forcing, (p - p_f) / tau

        for _ in range(steps):
            dp1, df1 = field(p, p_f)
            dp2, df2 = field(p + 0.5 * h * dp1, p_f + 0.5 * h * df1)
            dp3, df3 = field(p + 0.5 * h * dp2, p_f + 0.5 * h * df2)
            dp4, df4 = field(p + h * dp3, p_f + h * df3)
            p += h / 6.0 * (dp1 + 2.0 * dp2 + 2.0 * dp3 + dp4)
            p_f += h / 6.0 * (df1 + 2.0 * df2 + 2.0 * df3 + df4)
        out.append(p)
    return np.array(out)


def hyperbolic(square, time):
    """
    Return cosh(root time) and sinh(root time) / root of a root whose square is given; a negative one oscillates.

    Series of a part of the time, which the formulas for the double argument then lengthen.
    """
    doublings = 20
    time /= 2**doublings
    x = square * time**2
    cosine = sum(x**n / factorial(2 * n) for n in range(8))
    sine = time * sum(x**n / factorial(2 * n + 1) for n in range(8))
    for _ in range(doublings):
        cosine, sine = 2 * cosine**2 - 1, 2 * sine * cosine
    return cosine, sine


def pressure_to_thirty_digits(gains, times, displacement, setpoint):
    """
    Return the outlet pressure [Pa]: displacement straight between samples, entry i of the set-point on step i.

    The exact solution of each branch in multiple precision; where p_f crosses the set-point is found by bisection.
    """
    with localcontext() as context:
        context.prec = 60  # half of which doubling and cancellation may cost
        k_x, k_sv, k_v, tau, *levels = (Decimal(float(one)) for one in (*gains, *setpoint))
        u = w = Decimal(0)  # deviations from the set-point
        out = [levels[0]]

        def after(gain, forcing, time):
            mu = -1 / (2 * tau)
            decay = (mu * time).exp()
            cosine, sine = (decay * part for part in hyperbolic(mu**2 - gain / tau, time))
            rest = forcing / gain
            return (
                rest + (cosine - mu * sine) * (u - rest) - gain * sine * (w - rest),
                rest + sine / tau * (u - rest) + (cosine + mu * sine) * (w - rest),
            )

        for i in range(1, len(times)):
            u, w = u + levels[i - 1] - levels[i], w + levels[i - 1] - levels[i]
            left = Decimal(float(times[i])) - Decimal(float(times[i - 1]))
            forcing = -k_x * (Decimal(float(displacement[i])) - Decimal(float(displacement[i - 1]))) / left
            while left > 0:
                side = w or u - w or forcing
                gain = k_sv if side < 0 else k_v
                parts = [left * part / 40 for part in range(1, 41)]
                beyond = next((time for time in parts if side * after(gain, forcing, time)[1] < 0), None)
                first, last = (left, left) if beyond is None else (beyond - left / 40, beyond)
                for _ in range(90 if last > first else 0):
                    middle = (first + last) / 2
                    first, last = (first, middle) if side * after(gain, forcing, middle)[1] < 0 else (middle, last)
                u, w = after(gain, forcing, last)
                w = w if beyond is None else Decimal(0)
                left -= last
            out.append(levels[i] + u)
        return np.array([float(one) for one in out])
