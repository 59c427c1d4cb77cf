"""
Output-error maximum likelihood for the paper's parameters, over one or several experiments.

The simulated pressure depends on the measured displacement alone, never on the measured pressure; the parameters are
those that make the difference of the two smallest. Gains are searched in logarithms and within bounds: from starts
wrong by a factor of ten, bounds are what keeps the search from running away.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student_t

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.uncertainty import covariance
from cfd_pneumatic.model import NAMES, SPECS, simulate_with_sensitivities

Array = NDArray[np.float64]

GAINS = len(SPECS)
_LOWER = np.log([spec.lower for spec in SPECS])
_UPPER = np.log([spec.upper for spec in SPECS])
_STARTING_K = (3.0, 30.0, 150.0)  # charging gains that the search starts from [1/s]
_ROUGH = (1e-4, 40)  # tolerance and evaluations of a search that chooses among starts
_FINE = (1e-9, 200)
_LARGEST_RELATIVE_STD = 1.0 / 3.0  # above this zero lies within three standard errors: the recording does not tell it
_LEAST_EVIDENCE = 40.0  # by which following the piston must raise twice the log likelihood; noise alone stays below
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """
    One fitted parameter.

    Attributes
    ----------
    name, unit
        As in `model.SPECS`.
    value, std
        Estimate and standard error [unit]; None where not identifiable.
    interval
        95 % confidence interval [unit]; None where not identifiable.
    reason
        Why it is not identifiable, or None.

    """

    name: str
    unit: str
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    reason: str | None

    @property
    def identifiable(self) -> bool:
        """Whether the recordings tell the value."""
        return self.reason is None


@dataclass(frozen=True)
class Fit:
    """
    The result of one joint fit.

    Attributes
    ----------
    gains
        Best k_x, k_sv, k_v, tau, shape (4,), whether identifiable or not [Pa/m, 1/s, 1/s, s].
    estimates
        The same with their uncertainty and verdict.
    offsets
        For each experiment what is added to its set-point [Pa].
    starts
        For each experiment the pressure at its start above its set-point [Pa]; 0 where it starts at rest.
    offset_stds
        Standard errors of `offsets` [Pa].
    simulated
        For each experiment the simulated pressure at its samples [Pa].
    evaluations
        Simulations that the search took.

    """

    gains: Array
    estimates: tuple[Estimate, ...]
    offsets: tuple[float, ...]
    starts: tuple[float, ...]
    offset_stds: tuple[float, ...]
    simulated: tuple[Array, ...]
    evaluations: int

    def residual(self, index: int, experiment: Experiment) -> Array:
        """Return measured less simulated pressure at the experiment's samples [Pa]."""
        return experiment.pressure - self.simulated[index]


class _Problem:
    """Residuals and Jacobian of a joint fit; unknowns are log gains, then offset and start of each experiment."""

    def __init__(self, experiments: Sequence[Experiment], masks: Sequence[NDArray[np.bool_]], weights: Array) -> None:
        self.experiments = experiments
        self.masks = masks
        self.weights = weights
        self.offset_at = GAINS + np.arange(len(experiments))
        moving = [index for index, experiment in enumerate(experiments) if not experiment.starts_at_rest]
        self.start_at = {index: GAINS + len(experiments) + rank for rank, index in enumerate(moving)}
        self.size = GAINS + len(experiments) + len(moving)
        self.evaluations = 0
        self._unknowns: Array | None = None
        self._simulations: list[tuple[Array, Array]] = []

    def simulate(self, unknowns: Array) -> list[tuple[Array, Array]]:
        """Return simulated pressure and Jacobian by the unknowns at the samples of each experiment."""
        if self._unknowns is None or not np.array_equal(unknowns, self._unknowns):
            self._simulations = [self._simulate(index, unknowns) for index in range(len(self.experiments))]
            self._unknowns = unknowns.copy()
            self.evaluations += 1
        return self._simulations

    def _simulate(self, index: int, unknowns: Array) -> tuple[Array, Array]:
        experiment = self.experiments[index]
        gains = np.exp(unknowns[:GAINS])
        start_at = self.start_at.get(index)
        pressure, sensitivities = simulate_with_sensitivities(
            gains,
            experiment.times,
            experiment.displacement,
            experiment.setpoint + unknowns[self.offset_at[index]],
            0.0 if start_at is None else float(unknowns[start_at]),
        )
        sensitivities = sensitivities[experiment.samples]
        jacobian = np.zeros((experiment.samples.size, self.size))
        jacobian[:, :GAINS] = sensitivities[:, :GAINS] * gains
        jacobian[:, self.offset_at[index]] = sensitivities[:, GAINS]
        if start_at is not None:
            jacobian[:, start_at] = sensitivities[:, GAINS + 1]
        return pressure[experiment.samples], jacobian

    def residuals(self, unknowns: Array) -> Array:
        """Return weighted simulated less measured pressure of all experiments, masked."""
        parts = zip(self.experiments, self.masks, self.weights, self.simulate(unknowns))
        return np.concatenate(
            [weight * (pressure - experiment.pressure)[mask] for experiment, mask, weight, (pressure, _) in parts]
        )

    def jacobian(self, unknowns: Array) -> Array:
        """Return the weighted Jacobian of `residuals`."""
        parts = zip(self.masks, self.weights, self.simulate(unknowns))
        return np.concatenate([weight * jacobian[mask] for mask, weight, (_, jacobian) in parts])

    def search(self, start: Array, tolerance: float, evaluations: int) -> tuple[Array, float]:
        """Return the best unknowns from one start, and their cost, until it falls by less than a share `tolerance`."""
        lower = np.full(self.size, -np.inf)
        upper = np.full(self.size, np.inf)
        lower[:GAINS], upper[:GAINS] = _LOWER, _UPPER
        found = least_squares(
            self.residuals,
            start,
            jac=self.jacobian,
            bounds=(lower, upper),
            x_scale='jac',
            ftol=tolerance,
            max_nfev=evaluations,
        )
        return found.x, float(found.cost)


def fit(
    experiments: Sequence[Experiment],
    masks: Sequence[NDArray[np.bool_]],
    initial: Sequence[float] | None = None,
) -> Fit:
    """
    Fit k_x, k_sv, k_v and tau jointly, with a set-point (or its offset) for each experiment.

    Experiments whose residuals differ in size are weighted by them, in a second search.

    Parameters
    ----------
    experiments
        What was measured.
    masks
        For each experiment which of its pressure samples count, shape (m,).
    initial
        First guess of the four gains [Pa/m, 1/s, 1/s, s]; by default several are tried.

    Raises
    ------
    InputError
        If no parameter can be told from these recordings.

    """
    problem = _Problem(experiments, masks, np.ones(len(experiments)))
    candidates = _first_guesses(experiments, masks) if initial is None else [initial]
    searches = [problem.search(_unknowns_at(problem, gains), *_ROUGH) for gains in candidates]
    best, _ = problem.search(min(searches, key=lambda search: search[1])[0], *_FINE)
    evaluations = problem.evaluations
    if len(experiments) > 1:
        rmse = [
            math.sqrt(np.mean((pressure - experiment.pressure)[mask] ** 2))
            for experiment, mask, (pressure, _) in zip(experiments, masks, problem.simulate(best))
        ]
        problem = _Problem(experiments, masks, float(np.mean(rmse)) / np.maximum(rmse, 1e-9))
        best, _ = problem.search(best, *_FINE)
        evaluations += problem.evaluations
    return _summary(problem, best, evaluations)


def _first_guesses(experiments: Sequence[Experiment], masks: Sequence[NDArray[np.bool_]]) -> list[tuple[float, ...]]:
    """Return starts about K_x = n p / L with the chamber's length L taken as the stroke's order, and several K."""
    pressures = [experiment.pressure[mask] for experiment, mask in zip(experiments, masks)]
    pressure = float(np.median(np.concatenate(pressures)))
    length = max(max(float(np.ptp(experiment.displacement)) for experiment in experiments), 0.03)
    return [(pressure / length, gain, 0.5 * gain, 0.1 / gain) for gain in _STARTING_K]


def _unknowns_at(problem: _Problem, gains: Sequence[float]) -> Array:
    unknowns = np.zeros(problem.size)
    unknowns[:GAINS] = np.clip(np.log(gains), _LOWER + 1e-6, _UPPER - 1e-6)
    for index, start_at in problem.start_at.items():
        experiment = problem.experiments[index]
        unknowns[start_at] = float(np.median(experiment.pressure[:3])) - experiment.setpoint[0]
    return unknowns


def _summary(problem: _Problem, unknowns: Array, evaluations: int) -> Fit:
    _check_that_pressure_follows(problem, unknowns)
    residuals = problem.residuals(unknowns)
    jacobian = problem.jacobian(unknowns)
    reasons = {index: reason for index, reason in enumerate(_unmoved(unknowns, jacobian)) if reason is not None}
    degrees = residuals.size - problem.size
    if degrees < 1:
        raise InputError(f'{residuals.size} pressure samples are too few for {problem.size} unknowns: record longer')
    while True:
        free = np.array([index for index in range(problem.size) if index not in reasons])
        std = np.sqrt(np.diag(covariance(jacobian[:, free], residuals, degrees, _lengths(problem))))
        gains_free = free[free < GAINS]
        if gains_free.size == 0:
            raise InputError(_NOTHING_TOLD)
        worst = int(np.argmax(std[: gains_free.size]))
        if std[worst] <= _LARGEST_RELATIVE_STD:
            break
        name = NAMES[free[worst]]
        reasons[int(free[worst])] = (
            f'its standard error would be {100.0 * std[worst]:.0f} % of its value: {_HINTS[name]}'
        )
    stds = dict(zip((int(index) for index in free), std))
    quantile = float(student_t.ppf(0.5 + 0.5 * _CONFIDENCE, degrees))
    return Fit(
        gains=np.exp(unknowns[:GAINS]),
        estimates=tuple(
            _estimate(index, math.exp(unknowns[index]), stds.get(index), quantile, reasons.get(index))
            for index in range(GAINS)
        ),
        offsets=tuple(float(unknowns[at]) for at in problem.offset_at),
        starts=tuple(
            float(unknowns[problem.start_at[index]]) if index in problem.start_at else 0.0
            for index in range(len(problem.experiments))
        ),
        offset_stds=tuple(float(stds[int(at)]) for at in problem.offset_at),
        simulated=tuple(pressure for pressure, _ in problem.simulate(unknowns)),
        evaluations=evaluations,
    )


def _check_that_pressure_follows(problem: _Problem, unknowns: Array) -> None:
    """Raise InputError where the pressure is explained as well by one that does not follow the piston at all."""
    if any(np.ptp(experiment.setpoint) > 0.0 for experiment in problem.experiments):
        return
    rested = np.concatenate(
        [
            weight * (experiment.pressure[mask] - np.mean(experiment.pressure[mask]))
            for experiment, mask, weight in zip(problem.experiments, problem.masks, problem.weights)
            if np.any(mask)
        ]
    )
    residuals = problem.residuals(unknowns)
    evidence = residuals.size * math.log(float(rested @ rested) / max(float(residuals @ residuals), 1e-300))
    if evidence < _LEAST_EVIDENCE:
        raise InputError(_NOTHING_TOLD)


_NOTHING_TOLD = (
    'no parameter can be told from these recordings, the pressure does not follow the piston: '
    'let it move faster or farther, both ways'
)

_HINTS = {
    'k_x': 'let the piston move farther',
    'k_sv': 'let the chamber grow, so that the regulator charges it',
    'k_v': 'let the chamber shrink, so that the regulator vents it',
    'tau': 'sample faster, or let the piston move in steps',
}
"""What to record so that a parameter shows."""


def _unmoved(unknowns: Array, jacobian: Array) -> list[str | None]:
    """Return for each gain why its value means nothing, before any statistics; None where it may mean something."""
    size = np.sqrt(np.mean(jacobian[:, :GAINS] ** 2, axis=0))
    reasons: list[str | None] = []
    for index, spec in enumerate(SPECS):
        if size[index] == 0.0:
            reasons.append(f'nothing in the recording depends on it: {_HINTS[spec.name]}')
        elif unknowns[index] - _LOWER[index] < 1e-3:
            reasons.append(f'the fit ends at its lower bound {spec.lower:g} {spec.unit}: {_HINTS[spec.name]}')
        elif _UPPER[index] - unknowns[index] < 1e-3:
            reasons.append(f'the fit ends at its upper bound {spec.upper:g} {spec.unit}: {_HINTS[spec.name]}')
        else:
            reasons.append(None)
    return reasons


def _estimate(index: int, value: float, std: float | None, quantile: float, reason: str | None) -> Estimate:
    spec = SPECS[index]
    if reason is not None or std is None:
        return Estimate(spec.name, spec.unit, None, None, None, reason)
    margin = quantile * value * std
    return Estimate(spec.name, spec.unit, value, value * std, (value - margin, value + margin), None)


def _lengths(problem: _Problem) -> list[int]:
    return [int(np.count_nonzero(mask)) for mask in problem.masks]
