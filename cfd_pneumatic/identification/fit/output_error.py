"""
Output-error maximum likelihood for the paper's parameters, over one or several experiments.

The simulated pressure depends on the measured displacement alone, never on the measured pressure; the parameters are
those that make the difference of the two smallest. Gains are searched in logarithms and within bounds: from starts
wrong by a factor of ten, bounds are what keeps the search from running away.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares
from cfd_pneumatic.identification.fit.uncertainty import LARGEST_RELATIVE_STD, Information, information
from cfd_pneumatic.model import NAMES, SPECS, Course
from cfd_pneumatic.model.kernel import fused
from cfd_pneumatic.model.propagation import SENSITIVITIES
from cfd_pneumatic.recording.spool import Growing, dot, extent, parts

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GAINS = len(SPECS)
_SLOPES = len(SENSITIVITIES)
_LOWER = np.log([spec.lower for spec in SPECS])
_UPPER = np.log([spec.upper for spec in SPECS])
_STARTING_K = (3.0, 30.0, 150.0)  # charging gains that the search starts from [1/s]
_EXCERPT = 50_000  # grid steps
_ROUGH = (1e-4, 40)  # tolerance and evaluations of a search that chooses among starts
_FINE = (1e-9, 200)
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

    """

    gains: Array
    estimates: tuple[Estimate, ...]
    offsets: tuple[float, ...]
    starts: tuple[float, ...]
    offset_stds: tuple[float, ...]
    simulated: tuple[Array, ...]

    def residual(self, index: int, experiment: Experiment) -> Array:
        """Return measured less simulated pressure at the experiment's samples [Pa]."""
        return experiment.pressure - self.simulated[index]


class _Problem:
    """
    A joint fit; unknowns are log gains, then offset and start of each experiment in units of its pressure's range.

    Experiments are simulated block by block, so that no Jacobian is ever held that is as long as a recording.
    """

    def __init__(self, experiments: Sequence[Experiment], masks: Sequence[Mask], weights: Array) -> None:
        self.experiments = experiments
        self.masks = masks
        self.weights = weights
        count = len(experiments)
        moving = [index for index, experiment in enumerate(experiments) if not experiment.starts_at_rest]
        self.size = GAINS + count + len(moving)
        self.offset_at = GAINS + np.arange(count)
        self.start_at = {index: GAINS + count + rank for rank, index in enumerate(moving)}
        self.ends = [mask.size - int(np.argmax(mask[::-1])) for mask in masks]  # of the samples that count
        self.units = np.ones(self.size)
        self.columns = [self._columns(index) for index in range(count)]
        for columns, experiment, mask in zip(self.columns, experiments, masks):
            low, high = extent(experiment.pressure, mask)
            self.units[columns[GAINS:]] = high - low if high >= low else 1.0

    def _columns(self, index: int) -> NDArray[np.intp]:
        """Return which unknowns concern an experiment: gains, offset and, unless it begins at rest, start."""
        start = [self.start_at[index]] if index in self.start_at else []
        return np.array([*range(GAINS), self.offset_at[index], *start])

    def outward(self, unknowns: Array) -> Array:
        """Return the gains themselves, then offsets and starts [Pa]."""
        values: Array = unknowns * self.units
        values[:GAINS] = np.exp(unknowns[:GAINS])
        return values

    def _blocks(self, index: int, values: Array, *, slopes: bool = True) -> Iterator[tuple[slice, Array, Array]]:
        """
        Yield pressure and, by the gains, set-point and start, its derivatives at the samples of each block.

        With derivatives, only up to the last sample that counts.
        """
        experiment = self.experiments[index]
        offset = values[self.offset_at[index]]
        start = values[self.start_at[index]] if index in self.start_at else 0.0
        course = Course(values[:GAINS], experiment.setpoint[0] + offset + start)
        for block in experiment.blocks():
            if slopes and block.samples.start >= self.ends[index]:
                return
            pressure, jacobian = course.follow(
                experiment.times[block.grid],
                experiment.displacement[block.grid],
                experiment.setpoint[block.grid] + offset,
                slopes=slopes,
            )
            yield block.samples, pressure[block.at], jacobian[block.at] if slopes else jacobian

    def evaluate(self, unknowns: Array) -> Quadratic:
        """Return what the sum of squared weighted residuals is like."""
        values = self.outward(unknowns)
        total, gradient, normal = 0.0, np.zeros(self.size), np.zeros((self.size, self.size))
        for index, (experiment, mask, weight) in enumerate(zip(self.experiments, self.masks, self.weights)):
            for samples, pressure, jacobian in self._blocks(index, values):
                total += weight**2 * _summed_up(
                    pressure - experiment.pressure[samples],
                    jacobian,
                    mask[samples],
                    weight**2,
                    self.columns[index],
                    gradient,
                    normal,
                )
        scale = self.units.copy()
        scale[:GAINS] = values[:GAINS]
        return Quadratic(total, gradient * scale, normal * scale * scale[:, None])

    def simulate(self, unknowns: Array) -> list[Array]:
        """Return the pressure at the samples of each experiment [Pa]."""
        values = self.outward(unknowns)
        return [self._simulated(index, values) for index in range(len(self.experiments))]

    def _simulated(self, index: int, values: Array) -> Array:
        simulated = Growing()
        for _, pressure, _ in self._blocks(index, values, slopes=False):
            simulated.append(pressure)
        return simulated.array()

    def residuals(self, simulated: Sequence[Array]) -> list[Array]:
        """Return weighted simulated less measured pressure of each experiment, masked."""
        found = []
        for experiment, mask, weight, pressure in zip(self.experiments, self.masks, self.weights, simulated):
            own = Growing()
            for part in parts(pressure, experiment.pressure):
                own.append(weight * (pressure[part] - experiment.pressure[part])[mask[part]])
            found.append(own.array())
        return found

    def jacobians(self, unknowns: Array) -> Iterator[Array]:
        """Yield the Jacobian of `residuals`, by log gains, offsets and starts [Pa], in blocks of rows."""
        values = self.outward(unknowns)
        for index, (mask, weight) in enumerate(zip(self.masks, self.weights)):
            columns = self.columns[index]
            for samples, _, jacobian in self._blocks(index, values):
                rows = jacobian[mask[samples], : columns.size]
                rows[:, :GAINS] *= values[:GAINS]
                own = np.zeros((len(rows), self.size))
                own[:, columns] = weight * rows
                yield own

    def search(self, start: Array, tolerance: float, evaluations: int) -> tuple[Array, Quadratic]:
        """Return the best unknowns from one start, and their cost, until it falls by less than a share `tolerance`."""
        lower = np.full(self.size, -np.inf)
        upper = np.full(self.size, np.inf)
        lower[:GAINS], upper[:GAINS] = _LOWER, _UPPER
        return least_squares(self.evaluate, start, lower, upper, tolerance, evaluations)

    def excerpt(self) -> _Problem:
        """Return the problem of what moves most in long experiments, to choose a start by."""
        experiments, samples = zip(*(one.liveliest(_EXCERPT, mask) for one, mask in zip(self.experiments, self.masks)))
        masks = [mask[part] for mask, part in zip(self.masks, samples)]
        return _Problem(experiments, masks, self.weights)


@fused
def _summed_up(
    residuals: Array,
    jacobian: Array,
    counts: Mask,
    weight: float,
    columns: NDArray[np.intp],
    gradient: Array,
    normal: Array,
) -> float:
    """Add what residuals that count make of J'r and J'J, by the unknowns of some columns; return their r'r."""
    total, slope, square = 0.0, np.zeros(_SLOPES), np.zeros((_SLOPES, _SLOPES))
    for row in range(residuals.size):
        if counts[row]:
            residual = residuals[row]
            total += residual * residual
            for i in range(_SLOPES):
                slope[i] += jacobian[row, i] * residual
                for j in range(i + 1):
                    square[i, j] += jacobian[row, i] * jacobian[row, j]
    for i, column in enumerate(columns):
        gradient[column] += weight * slope[i]
        for j, other in enumerate(columns):
            normal[column, other] += weight * square[max(i, j), min(i, j)]
    return total


def fit(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
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
    gains = _best_guess(problem, initial)
    best, cost = problem.search(_unknowns_at(problem, gains), *_FINE)
    if len(experiments) > 1:
        rmse = [math.sqrt(dot(run, run) / max(run.size, 1)) for run in problem.residuals(problem.simulate(best))]
        problem = _Problem(experiments, masks, float(np.mean(rmse)) / np.maximum(rmse, 1e-9))
        best, cost = problem.search(best, *_FINE)
    return _summary(problem, best, cost)


def _best_guess(problem: _Problem, initial: Sequence[float] | None) -> Sequence[float]:
    """Return the best gains that rough searches end at, from given ones or from several."""
    if initial is not None and max(one.times.size for one in problem.experiments) <= _EXCERPT:
        return initial
    rough = problem.excerpt()
    guesses = _first_guesses(rough.experiments, rough.masks) if initial is None else [initial]
    searches = (rough.search(_unknowns_at(rough, gains), *_ROUGH) for gains in guesses)
    best, _ = min(searches, key=lambda found: found[1].total)
    return tuple(np.exp(best[:GAINS]))


def _first_guesses(experiments: Sequence[Experiment], masks: Sequence[Mask]) -> list[tuple[float, ...]]:
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
        above = float(np.median(experiment.pressure[:3])) - experiment.setpoint[0]
        unknowns[start_at] = above / problem.units[start_at]
    return unknowns


def _summary(problem: _Problem, unknowns: Array, cost: Quadratic) -> Fit:
    simulated = problem.simulate(unknowns)
    residuals = problem.residuals(simulated)
    normal = cost.normal / np.outer(problem.units, problem.units)
    told = information(problem.jacobians(unknowns), residuals, normal)
    _check_that_pressure_follows(problem, told)
    reasons = {index: reason for index, reason in enumerate(_unmoved(unknowns, told.normal)) if reason is not None}
    degrees = told.size - problem.size
    if degrees < 1:
        raise InputError(f'{told.size} pressure samples are too few for {problem.size} unknowns: record longer')
    while True:
        free = np.array([index for index in range(problem.size) if index not in reasons])
        std = np.sqrt(np.diag(told.covariance(degrees, free)))
        gains_free = free[free < GAINS]
        if gains_free.size == 0:
            raise InputError(_NOTHING_TOLD)
        worst = int(np.argmax(std[: gains_free.size]))
        if std[worst] <= LARGEST_RELATIVE_STD:
            break
        name = NAMES[free[worst]]
        reasons[int(free[worst])] = (
            f'its standard error would be {100.0 * std[worst]:.0f} % of its value: {_HINTS[name]}'
        )
    stds = dict(zip((int(index) for index in free), std))
    quantile = float(stdtrit(degrees, 0.5 + 0.5 * _CONFIDENCE))
    values = problem.outward(unknowns)
    return Fit(
        gains=values[:GAINS],
        estimates=tuple(
            _estimate(index, float(values[index]), stds.get(index), quantile, reasons.get(index))
            for index in range(GAINS)
        ),
        offsets=tuple(values[problem.offset_at].tolist()),
        starts=tuple(
            float(values[problem.start_at[index]]) if index in problem.start_at else 0.0
            for index in range(len(problem.experiments))
        ),
        offset_stds=tuple(float(stds[int(at)]) for at in problem.offset_at),
        simulated=tuple(simulated),
    )


def _check_that_pressure_follows(problem: _Problem, told: Information) -> None:
    """Raise InputError where the pressure is explained as well by one that does not follow the piston at all."""
    if any(len(set(extent(experiment.setpoint))) > 1 for experiment in problem.experiments):
        return
    rested = sum(
        weight**2 * _squares_about_mean(experiment.pressure, mask)
        for experiment, mask, weight in zip(problem.experiments, problem.masks, problem.weights)
    )
    if told.size * math.log(rested / max(told.power, 1e-300)) < _LEAST_EVIDENCE:
        raise InputError(_NOTHING_TOLD)


def _squares_about_mean(values: Array, counts: Mask) -> float:
    size, total, squares = 0, 0.0, 0.0
    for part in parts(values):
        here = values[part][counts[part]] - values[0]
        size, total, squares = size + here.size, total + float(np.sum(here)), squares + float(here @ here)
    return squares - total**2 / max(size, 1)


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


def _unmoved(unknowns: Array, normal: Array) -> list[str | None]:
    """Return for each gain why its value means nothing, before any statistics; None where it may mean something."""
    reasons: list[str | None] = []
    for index, spec in enumerate(SPECS):
        if normal[index, index] == 0.0:
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
