"""
An integrator of the paper's equations that shares nothing with the package: SciPy, tight tolerances, short steps.

The displacement is a function of time, as a piston has it, not a list of samples.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

AMBIENT = 101_325.0
PSI = 6894.757293168
INCH = 0.0254


def step_like(start, duration, amplitude):
    """Return a displacement [m] that goes from 0 to `amplitude` with a rate that begins and ends at zero."""

    def displacement(time):
        phase = np.clip((np.asarray(time) - start) / duration, 0.0, 1.0)
        return 0.5 * amplitude * (1.0 - np.cos(np.pi * phase))

    return displacement


def pressure(gains, displacement, setpoint, times, longest_step=2e-4):
    """
    Return the outlet pressure [Pa] at `times` [s], from rest, at a constant absolute set-point [Pa].

    `gains` are k_x, k_sv, k_v, tau of equations (8) and (12), K_sv while p_d > p_f.
    """
    k_x, k_sv, k_v, tau = gains

    def field(time, state):
        p, p_f = state
        rate = (displacement(time + 1e-6) - displacement(time - 1e-6)) / 2e-6
        gain = k_sv if setpoint > p_f else k_v
        return [gain * (setpoint - p_f) - k_x * rate, (p - p_f) / tau]

    solution = solve_ivp(
        field, (times[0], times[-1]), [setpoint, setpoint], t_eval=times, rtol=1e-9, atol=1e-4, max_step=longest_step
    )
    return solution.y[0]


def pressure_between_samples(gains, times, displacement, setpoint):
    """Return the outlet pressure [Pa] for a displacement that is straight between samples, set-points held over steps."""
    k_x, k_sv, k_v, tau = gains
    state = np.array([setpoint[0], setpoint[0]])
    out = [state[0]]
    for i in range(1, len(times)):
        step = times[i] - times[i - 1]
        rate = (displacement[i] - displacement[i - 1]) / step

        def field(_, state, target=setpoint[i], rate=rate):
            gain = k_sv if target > state[1] else k_v
            return [gain * (target - state[1]) - k_x * rate, (state[0] - state[1]) / tau]

        state = solve_ivp(field, (0.0, step), state, rtol=1e-11, atol=1e-7, max_step=step / 10).y[:, -1]
        out.append(state[0])
    return np.array(out)
