"""
Simulation and the four-parameter fit against what a user would write with SciPy, in the same run.

Peers: `solve_ivp` (RK45, relative tolerance 1e-6) with an interpolated displacement, and `least_squares` around it with
its own finite differences. The compiled model is warmed up first, as a running program is.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from cfd_pneumatic.identification.experiment import make_experiment, observed_motion
from cfd_pneumatic.identification.fit import fit
from cfd_pneumatic.identification.split import split_recordings
from cfd_pneumatic.model import Cylinder, OperatingPoints
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

AMBIENT = 101_325.0
SETPOINT = AMBIENT + 34_474.0
GAINS = np.array([4.33e6, 104.0, 19.4, 0.0105])
START = np.array([2.0, 0.5, 2.0, 0.5])  # times the gains: where both fits begin
SAMPLES = 350

TIMES = np.arange(SAMPLES) * 0.002
PHASE = np.clip((TIMES - 0.099) / 0.012, 0.0, 1.0)
DISPLACEMENT = 0.5 * 1.524e-3 * (1.0 - np.cos(np.pi * PHASE))


CYLINDER = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT)
HELD = np.full(SAMPLES, SETPOINT)


def simulate():
    return CYLINDER.simulate(TIMES, DISPLACEMENT, HELD)


def simulate_with_scipy(gains=GAINS):
    k_x, k_sv, k_v, tau = gains
    rates = np.diff(DISPLACEMENT) / 0.002

    def field(time, state):
        p, p_f = state
        rate = rates[min(int(time / 0.002), SAMPLES - 2)]
        return [(k_sv if p_f < SETPOINT else k_v) * (SETPOINT - p_f) - k_x * rate, (p - p_f) / tau]

    return solve_ivp(
        field, (0.0, TIMES[-1]), [SETPOINT, SETPOINT], t_eval=TIMES, rtol=1e-6, atol=1e-2, max_step=0.002
    ).y[0]


MEASURED = simulate() + 52.0 * np.random.default_rng(0).normal(size=SAMPLES)


def make_ready():
    cylinders = {'cylinder_a': CylinderSignals(Signal(TIMES, MEASURED), Signal(TIMES[:1], np.array([SETPOINT])))}
    recording = Recording('step', 0, Signal(TIMES, DISPLACEMENT), cylinders, None, ())
    motion, strokes = observed_motion(recording)
    (split,), _ = split_recordings([strokes])
    return make_experiment(recording, 'cylinder_a', motion, split)


EXPERIMENT = make_ready()


def fit_here():
    return fit([EXPERIMENT], [np.ones(SAMPLES, dtype=bool)], GAINS * START).gains


def fit_with_scipy():
    def residuals(logs):
        return simulate_with_scipy(np.exp(logs)) - MEASURED

    bounds = np.log(GAINS / 10.0), np.log(GAINS * 10.0)  # without them the search runs away
    return np.exp(least_squares(residuals, np.log(GAINS * START), bounds=bounds).x)


@pytest.mark.benchmark(group='simulate 350 samples')
def test_simulation(benchmark):
    benchmark(simulate)


@pytest.mark.benchmark(group='simulate 350 samples')
def test_simulation_with_solve_ivp(benchmark):
    pressure = benchmark.pedantic(simulate_with_scipy, rounds=20)
    np.testing.assert_allclose(pressure, simulate(), atol=40.0)  # Pa; the error is the peer's


@pytest.mark.benchmark(group='fit 4 parameters to 350 samples')
def test_fit(benchmark):
    benchmark(fit_here)


@pytest.mark.benchmark(group='fit 4 parameters to 350 samples')
def test_fit_with_solve_ivp(benchmark):
    gains = benchmark.pedantic(fit_with_scipy, rounds=3)
    np.testing.assert_allclose(gains, fit_here(), rtol=0.03)
