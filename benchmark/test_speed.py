# SPDX-License-Identifier: Apache-2.0
"""
Simulation and fit against what a user would write otherwise, in the same run.

Peers: SciPy's `solve_ivp` (LSODA at 1e-8) for simulation; for the four-parameter fit CasADi's Runge-Kutta with an exact
Jacobian under SciPy's `least_squares`. Everything compiled is warmed up first, as in a running program.
What the simulations are off by is told by thirty digits, with the same straight lines between samples.
"""

from __future__ import annotations

from functools import cache

import casadi
import numpy as np
import pytest
from reference import pressure_to_thirty_digits
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from cfd_pneumatic.identification import Model, fit_model
from cfd_pneumatic.model import Course, Cylinder, OperatingPoints
from cfd_pneumatic.units import PSI
from studies.documents.parameter_sets import simulate_parameter_sets
from studies.documents.strokes import AMBIENT, CHANNEL, CYLINDER, GAINS, SETPOINT, experiment, record

START = np.array([2.0, 0.5, 2.0, 0.5])  # times the gains: where all fits begin
BOUNDS = np.log(GAINS / 10.0), np.log(GAINS * 10.0)  # without them the peers run away

LENGTHS = (350, 3_600, 3_600_000)


def fitted_here(samples: int) -> np.ndarray:
    start = Model(GAINS * START, {}, np.zeros((1, 3)))
    return fit_model(CHANNEL, [experiment(samples)], start).model.parameters


def simulated_by_scipy(samples: int, gains: np.ndarray = GAINS) -> np.ndarray:
    times, displacement, _ = record(samples)
    k_x, k_sv, k_v, tau = gains
    rates = np.diff(displacement) / np.diff(times)
    period = times[1] - times[0]

    def field(time, state):
        p, p_f = state
        rate = rates[min(int(time / period), samples - 2)]
        return [(k_sv if p_f < SETPOINT else k_v) * (SETPOINT - p_f) - k_x * rate, (p - p_f) / tau]

    rest = [SETPOINT, SETPOINT]
    return solve_ivp(field, (0.0, times[-1]), rest, 'LSODA', t_eval=times, rtol=1e-8, atol=1e-6, max_step=period).y[0]


@cache
def casadi_residuals(samples: int) -> tuple[casadi.Function, casadi.Function]:
    """Return residuals and their exact Jacobian by log gains and set-point: Runge-Kutta, a step to each sample."""
    times, displacement, _ = record(samples)
    unknowns, state, rate = casadi.SX.sym('q', 5), casadi.SX.sym('y', 2), casadi.SX.sym('v')
    period = float(times[1] - times[0])
    gains = casadi.exp(unknowns[:4])

    def field(now):
        error = unknowns[4] - now[1]
        gain = casadi.if_else(error > 0, gains[1], gains[2])
        return casadi.vertcat(gain * error - gains[0] * rate, (now[0] - now[1]) / gains[3])

    k1 = field(state)
    k2 = field(state + 0.5 * period * k1)
    k3 = field(state + 0.5 * period * k2)
    k4 = field(state + period * k3)
    step = casadi.Function('step', [state, rate, unknowns], [state + period / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)])
    q = casadi.MX.sym('q', 5)
    rates = casadi.DM(np.diff(displacement) / np.diff(times)).T
    start = casadi.vertcat(q[4], q[4])
    states = step.mapaccum(samples - 1)(start, rates, casadi.repmat(q, 1, samples - 1))
    residual = casadi.vertcat(start[0], states[0, :].T) - casadi.DM(experiment(samples).measured)
    return casadi.Function('r', [q], [residual]), casadi.Function('j', [q], [casadi.jacobian(residual, q)])


def fitted_by_casadi(samples: int) -> np.ndarray:
    residuals, jacobian = casadi_residuals(samples)
    found = least_squares(
        lambda q: np.array(residuals(q)).ravel(),
        [*np.log(GAINS * START), SETPOINT],
        jac=lambda q: np.array(jacobian(q)),
        bounds=([*BOUNDS[0], 0.0], [*BOUNDS[1], np.inf]),
        x_scale='jac',
    )
    return np.exp(found.x[:4])


def groups(benchmark, work: str, samples: int) -> None:
    benchmark.group = f'{work}, {samples:,} samples'


def agree(benchmark, gains: np.ndarray, samples: int, tolerance: float) -> None:
    """Tell how far a peer's gains are from ours, and see to it that it is no more than a tolerance."""
    apart = float(np.max(np.abs(gains / fitted_here(samples) - 1.0)))
    benchmark.extra_info['apart'] = apart
    assert apart < tolerance


@pytest.mark.parametrize('samples', LENGTHS)
def test_simulation(benchmark, samples):
    groups(benchmark, 'simulate', samples)
    benchmark(CYLINDER.simulate, *record(samples))


@pytest.mark.parametrize('samples', LENGTHS)
def test_simulation_of_irregular_times(benchmark, samples):
    groups(benchmark, 'simulate', samples)
    benchmark(CYLINDER.simulate, *record(samples, 1.0))


@pytest.mark.parametrize('samples', LENGTHS)
def test_simulation_with_sensitivities(benchmark, samples):
    groups(benchmark, 'simulate', samples)
    benchmark(lambda: Course(GAINS, SETPOINT).simulate_piece(*record(samples)))


@pytest.mark.parametrize('samples', LENGTHS[:2])
def test_simulation_by_solve_ivp(benchmark, samples):
    groups(benchmark, 'simulate', samples)
    benchmark.pedantic(simulated_by_scipy, (samples,), rounds=3)


@pytest.mark.parametrize('samples', LENGTHS[:2])
def test_simulation_to_thirty_digits(benchmark, samples):
    groups(benchmark, 'simulate', samples)
    true = benchmark.pedantic(pressure_to_thirty_digits, (GAINS, *record(samples)), rounds=1)
    irregular = pressure_to_thirty_digits(GAINS, *record(samples, 1.0))
    errors = {
        'exact': CYLINDER.simulate(*record(samples)) - true,
        'irregular': CYLINDER.simulate(*record(samples, 1.0)) - irregular,
        'solve_ivp': simulated_by_scipy(samples) - true,
    }
    worst = {name: float(np.max(np.abs(error))) / PSI for name, error in errors.items()}
    benchmark.extra_info['errors_psi'] = worst
    assert max(worst['exact'], worst['irregular']) < 1e-9
    assert worst['solve_ivp'] < 1e-4


def test_ten_thousand_parameter_sets(benchmark):
    groups(benchmark, 'simulate 10,000 parameter sets', LENGTHS[0])
    sets = GAINS * np.random.default_rng(0).uniform(0.5, 2.0, (10_000, 4))
    pressures = benchmark(simulate_parameter_sets, sets, *record(LENGTHS[0]))
    one = Cylinder(OperatingPoints.constant(*sets[77]), AMBIENT).simulate(*record(LENGTHS[0]))
    np.testing.assert_allclose(pressures[77], one, rtol=1e-12)


@pytest.mark.parametrize('samples', LENGTHS)
def test_fit(benchmark, samples):
    groups(benchmark, 'fit 4 parameters', samples)
    experiment(samples)
    gains = benchmark.pedantic(fitted_here, (samples,), warmup_rounds=1, rounds=3 if samples > 1e6 else 30)
    np.testing.assert_allclose(gains, GAINS, rtol=0.1)


@pytest.mark.parametrize('samples', LENGTHS[:2])
def test_fit_by_casadi(benchmark, samples):
    groups(benchmark, 'fit 4 parameters', samples)
    casadi_residuals(samples)
    gains = benchmark.pedantic(fitted_by_casadi, (samples,), warmup_rounds=1, rounds=3)
    agree(benchmark, gains, samples, 2e-3)  # the same optimum, but for a step's error
