"""Fits of the paper's model with physical effects beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares
from cfd_pneumatic.model import SPECS
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS
from cfd_pneumatic.model.extended import ExtendedCylinder, SideBySide
from cfd_pneumatic.model.kernel import kernel
from cfd_pneumatic.model.places import GAINS, PARAMETERS, PLACES, all_parameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Effects = Mapping[str, tuple[float, ...]]
"""Parameters of each effect that is on, by its name."""

_DIFFERENCE = 1e-5  # step of a forward difference, as a share of an unknown's scale
# of a sample: what is faster can't be told from nothing, and would cost steps
_SHORTEST_TAU = 0.3
_SHORTEST_LAG = 0.15
_FEWEST_PERIODS = 0.5  # in the longest experiment: with fewer, a period can't be told from a drift


@dataclass(frozen=True)
class Extension:
    """
    The paper's model with effects, fitted to experiments.

    Attributes
    ----------
    gains
        k_x, k_sv, k_v, tau [Pa/m, 1/s, 1/s, s].
    effects
        Fitted parameters of each effect.
    offsets, starts
        As in `fit.Fit` [Pa].
    unknowns
        How many numbers were searched.

    """

    gains: Array
    effects: Effects
    offsets: tuple[float, ...]
    starts: tuple[float, ...]
    unknowns: int = 0

    @property
    def delay(self) -> float:
        """By how much the sensor is read late [s]."""
        return sum(own[0] for name, own in self.effects.items() if PRESSURE_EFFECTS[name].delays)

    def settles(self, experiment: Experiment) -> bool:
        """Return whether the cylinder has to settle, at a rest that effects have moved, before an experiment begins."""
        return experiment.starts_at_rest and any(PRESSURE_EFFECTS[name].moves_rest for name in self.effects)

    def simulate(self, experiments: Sequence[Experiment], ambient_pressure: float) -> list[Array]:
        """Return the pressure at the samples of each experiment, or of a part of it [Pa]."""
        return [pressures[:, 0] for pressures in simulate_models(experiments, [self], ambient_pressure)]


def simulate_models(
    experiments: Sequence[Experiment], models: Sequence[Extension], ambient_pressure: float
) -> list[Array]:
    """Return the pressures by models with the same effects at each experiment's samples, shape (m, models) [Pa]."""
    cylinders = [ExtendedCylinder(one.gains, one.effects, ambient_pressure) for one in models]
    parameters = np.array([all_parameters(one.gains, one.effects) for one in models])
    delays = np.array([one.delay for one in models])
    pressures = []
    for index, experiment in enumerate(experiments):
        lanes = _Lanes(
            parameters,
            np.array([one.offsets[index] for one in models]),
            np.array([one.starts[index] for one in models]),
            delays,
            max(one.stiffness_over(experiment.displacement, experiment.setpoint) for one in cylinders),
        )
        blocks = _simulate_blocks(
            experiment, cylinders[0], lanes, models[0].settles(experiment), experiment.pressure.size
        )
        pressures.append(np.concatenate([block for _, block in blocks]))
    return pressures


@dataclass(frozen=True)
class _Lanes:
    """Models that are simulated side by side: as in `extended.SideBySide`, each sensor with a delay of its own [s]."""

    parameters: Array
    offsets: Array
    starts: Array
    delays: Array
    stiffness: float


def _simulate_blocks(
    experiment: Experiment, cylinder: ExtendedCylinder, lanes: _Lanes, settles: bool, count: int
) -> Iterator[tuple[slice, Array]]:
    """Yield the pressures by models side by side in each block with some of the first samples, (m, models) [Pa]."""
    delays = np.unique(lanes.delays).tolist()
    groups = [np.flatnonzero(lanes.delays == delay) for delay in delays]
    walks = [
        _walk(
            read_late(experiment, delay),
            SideBySide(
                cylinder, lanes.parameters[group], lanes.offsets[group], lanes.starts[group], lanes.stiffness, settles
            ),
            count,
        )
        for delay, group in zip(delays, groups)
    ]
    for parts in zip(*walks):
        samples, pressures = parts[0]
        if len(groups) > 1:
            pressures = np.empty((len(pressures), len(lanes.delays)))
            for group, (_, readings) in zip(groups, parts):
                pressures[:, group] = readings
        yield samples, pressures


def _walk(experiment: Experiment, side_by_side: SideBySide, count: int) -> Iterator[tuple[slice, Array]]:
    for block in takewhile(lambda block: block.samples.start < count, experiment.blocks()):
        grid = block.grid
        readings = side_by_side.follow(experiment.times[grid], experiment.displacement[grid], experiment.setpoint[grid])
        yield block.samples, readings[block.at]


def read_late(experiment: Experiment, delay: float) -> Experiment:
    """Return an experiment whose pressure samples were taken `delay` seconds before they are stamped."""
    if delay == 0.0:
        return experiment
    taken = np.clip(experiment.sample_times - delay, experiment.times[0], experiment.times[-1])
    times = np.union1d(experiment.times, taken)
    step = np.searchsorted(experiment.times, times)  # that ends there or later
    return replace(
        experiment,
        times=times,
        displacement=np.interp(times, experiment.times, experiment.displacement),
        setpoint=experiment.setpoint[step],
        samples=np.searchsorted(times, taken),
    )


class _Unknowns:
    """
    What is searched, and how.

    All numbers of a model stand in one row of slots: the kernel's parameters, then each experiment's offset, then each
    experiment's start. An unknown is one of them, searched in its logarithm or in a unit that makes it about one.
    """

    def __init__(self, experiments: Sequence[Experiment], begin: Extension, effects: Effects) -> None:
        count = len(experiments)
        self.effects = effects
        self.row = np.concatenate([all_parameters(begin.gains, effects), begin.offsets, begin.starts])
        self.offset_slots = PARAMETERS + np.arange(count)
        self.start_slots = PARAMETERS + count + np.arange(count)
        span = float(np.mean([one.span for one in experiments]))
        period = min(float(np.median(np.diff(one.sample_times))) for one in experiments)
        duration = max(float(np.ptp(one.sample_times)) for one in experiments)
        slots: list[int] = []
        logarithmic: list[bool] = []
        units: list[float] = []
        bounds: list[tuple[float, float]] = []

        def search(slot: int, logarithm: bool, unit: float, lower: float, upper: float) -> None:
            slots.append(slot)
            logarithmic.append(logarithm)
            units.append(1.0 if logarithm else unit)
            bounds.append((lower, upper))

        for slot, spec in enumerate(SPECS):
            shortest = _SHORTEST_TAU * period if spec.name == 'tau' else 0.0
            search(slot, True, 1.0, max(spec.lower, shortest), spec.upper)
        for slot in self.offset_slots.tolist():
            search(slot, False, span, -np.inf, np.inf)
        anywhere = any(PRESSURE_EFFECTS[name].rests_anywhere for name in effects)
        for slot, one in zip(self.start_slots.tolist(), experiments):
            if anywhere or not one.starts_at_rest:
                search(slot, False, span, -np.inf, np.inf)
        for name, own in effects.items():
            for slot, parameter, value in zip(_slots_of(name), PRESSURE_EFFECTS[name].parameters, own):
                if not parameter.choice:
                    unit = abs(value) or 1e-3 * min(abs(parameter.lower) + abs(parameter.upper), 1.0)
                    least = {'s': _SHORTEST_LAG * period, 'Hz': _FEWEST_PERIODS / duration}.get(parameter.unit, 0.0)
                    lower = max(parameter.lower, least) if parameter.logarithmic else parameter.lower
                    search(slot, parameter.logarithmic, unit, min(lower, parameter.upper), parameter.upper)
        self.slots = np.array(slots)
        self.logarithmic = np.array(logarithmic)
        self.units = np.array(units)
        self.lower, self.upper = (self.inward(np.array(side)) for side in zip(*bounds))
        self.start = np.clip(self.inward(self.row[self.slots]), self.lower, self.upper)

    def inward(self, values: Array) -> Array:
        """Return values as they are searched."""
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.where(self.logarithmic, np.log(np.maximum(values, 0.0)), values / self.units)

    def rows(self, points: Array) -> Array:
        """Return all numbers of the models at some points, shape (points, slots)."""
        rows = np.tile(self.row, (len(points), 1))
        searched = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, points, 0.0)), points * self.units)
        rows[:, self.slots] = searched
        return rows

    def beside(self, point: Array) -> tuple[Array, Array]:
        """Return points a difference away from one, each in one unknown, shape (k, k), and the differences, (k,)."""
        differences = np.where(point + _DIFFERENCE <= self.upper, _DIFFERENCE, -_DIFFERENCE)
        return point + np.diag(differences), differences

    @property
    def count(self) -> int:
        """How many are searched."""
        return int(self.slots.size)

    def model(self, row: Array) -> Extension:
        """Return the model that a row of numbers stands for."""
        effects = {name: tuple(row[list(_slots_of(name))].tolist()) for name in self.effects}
        return Extension(
            row[:GAINS].copy(),
            effects,
            tuple(row[self.offset_slots].tolist()),
            tuple(row[self.start_slots].tolist()),
            self.count,
        )


def _slots_of(name: str) -> range:
    place = PLACES[name].parameters
    return range(place.start, place.stop)


@dataclass(frozen=True)
class Tangent:
    """
    Residuals of a fit and how they depend on what was searched.

    Attributes
    ----------
    residuals
        Simulated less measured pressure at the samples that count, weighted, shape (n,) [Pa].
    jacobian
        By the unknowns, shape (n, k); by the logarithm of those searched so, by the value itself of others.
    names
        Of the unknowns: gains by their names, effects' parameters as `EFFECT.PARAMETER`, otherwise empty.

    """

    residuals: Array
    jacobian: Array
    names: tuple[str, ...]
    logarithmic: Mask


@kernel
def _weighted(simulated: Array, measured: Array, weight: Array, counts: Mask, differences: Array) -> Array:
    """Return the weighted residuals of the samples that count, and below them their derivatives, shape (1 + k, n)."""
    rows = np.empty((1 + differences.size, np.count_nonzero(counts)))
    kept = 0
    for sample in range(measured.size):
        if counts[sample]:
            base, scale = simulated[sample, 0], weight[sample]
            rows[0, kept] = (base - measured[sample]) * scale
            for rank in range(differences.size):
                rows[1 + rank, kept] = (simulated[sample, 1 + rank] - base) * (scale / differences[rank])
            kept += 1
    return rows


class _Search:
    """Residuals and their Jacobian, from simulations side by side."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        masks: Sequence[Mask],
        ambient_pressure: float,
        unknowns: _Unknowns,
        weights: Sequence[Array],
    ) -> None:
        self.experiments = experiments
        self.masks = masks
        self.ambient_pressure = ambient_pressure
        self.unknowns = unknowns
        self.weights = weights
        self.delay_slots = [
            slot for name in unknowns.effects if PRESSURE_EFFECTS[name].delays for slot in _slots_of(name)
        ]

    def evaluate(self, point: Array) -> Quadratic:
        """Return what the sum of squares is like."""
        total = 0.0
        gradient, normal = np.zeros(point.size), np.zeros((point.size, point.size))
        for rows, own in self._blocks(point):
            here = Quadratic.of_rows(rows)
            total += here.total
            gradient[own] += here.gradient
            normal[np.ix_(own, own)] += here.normal
        return Quadratic(total, gradient, normal)

    def tangent(self, point: Array) -> tuple[Array, Array]:
        """Return weighted simulated less measured pressure of all experiments, and its Jacobian."""
        parts = list(self._blocks(point))
        residuals = np.concatenate([rows[0] for rows, _ in parts])
        jacobian = np.zeros((residuals.size, point.size))
        first = 0
        for rows, own in parts:
            jacobian[first : first + rows.shape[1], own] = rows[1:].T
            first += rows.shape[1]
        return residuals, jacobian

    def _blocks(self, point: Array) -> Iterator[tuple[Array, NDArray[np.intp]]]:
        """Yield the weighted residuals of each block with their derivatives, and which unknowns these are by."""
        beside, differences = self.unknowns.beside(point)
        rows = self.unknowns.rows(np.vstack([point[None], beside]))
        base = self.unknowns.model(rows[0])
        cylinder = ExtendedCylinder(base.gains, base.effects, self.ambient_pressure)
        for index, experiment in enumerate(self.experiments):
            own = np.flatnonzero(np.any(rows[1:] != rows[0], axis=1) & self._concerns(index))
            beside_it = rows[np.concatenate([[0], own + 1])]
            lanes = _Lanes(
                beside_it[:, :PARAMETERS],
                beside_it[:, self.unknowns.offset_slots[index]],
                beside_it[:, self.unknowns.start_slots[index]],
                beside_it[:, self.delay_slots].sum(axis=1),
                cylinder.stiffness_over(experiment.displacement, experiment.setpoint),
            )
            mask, weight = self.masks[index], self.weights[index]
            counted = int(np.max(np.flatnonzero(mask), initial=-1)) + 1
            for samples, simulated in _simulate_blocks(experiment, cylinder, lanes, base.settles(experiment), counted):
                measured = experiment.pressure[samples]
                yield _weighted(simulated, measured, weight[samples], mask[samples], differences[own]), own

    def _concerns(self, index: int) -> Mask:
        """Return which unknowns concern an experiment, shape (k,)."""
        slots = self.unknowns.slots
        mine = (slots == self.unknowns.offset_slots[index]) | (slots == self.unknowns.start_slots[index])
        return np.asarray((slots < PARAMETERS) | mine)


def extend(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    begin: Extension,
    effects: Effects,
    weights: Sequence[Array] | None = None,
    tolerance: float = 1e-8,
    evaluations: int = 60,
) -> Extension:
    """
    Return the paper's model with effects, fitted from given starting values.

    Parameters
    ----------
    experiments, masks
        As in `fit.fit`.
    ambient_pressure
        Absolute [Pa].
    begin
        A fit to begin from; its effects are not taken over.
    effects
        Effects with starting values; parameters that are choices stay as they are.
    weights
        Of each experiment's samples, shape (m,); by default all count alike.
    tolerance, evaluations
        The search ends when the sum of squares falls by less than this share, or after so many steps.

    """
    found, _ = extend_with_cost(experiments, masks, ambient_pressure, begin, effects, weights, tolerance, evaluations)
    return found


def extend_with_cost(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    begin: Extension,
    effects: Effects,
    weights: Sequence[Array] | None,
    tolerance: float,
    evaluations: int,
    enough: float = 0.0,
) -> tuple[Extension, float]:
    """
    Do as `extend` does; return the sum of squares too, which is infinite where the model runs away.

    The search ends too when the sum is `enough`.
    """
    unknowns = _Unknowns(experiments, begin, effects)
    all_alike = [np.ones_like(one.pressure) for one in experiments]
    search = _Search(experiments, masks, ambient_pressure, unknowns, weights or all_alike)
    bounds = unknowns.lower, unknowns.upper
    point, cost = least_squares(search.evaluate, unknowns.start, *bounds, tolerance, evaluations, enough)
    return unknowns.model(unknowns.rows(point[None])[0]), cost.total


def tangent(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    fitted: Extension,
    weights: Sequence[Array],
) -> Tangent:
    """Return the residuals of a fit and their Jacobian; parameters as in `extend`."""
    unknowns = _Unknowns(experiments, fitted, fitted.effects)
    residuals, jacobian = _Search(experiments, masks, ambient_pressure, unknowns, weights).tangent(unknowns.start)
    named = {slot: spec.name for slot, spec in enumerate(SPECS)}
    for name in fitted.effects:
        for slot, parameter in zip(_slots_of(name), PRESSURE_EFFECTS[name].parameters):
            named[slot] = f'{name}.{parameter.name}'
    names = tuple(named.get(slot, '') for slot in unknowns.slots.tolist())
    return Tangent(residuals, jacobian / unknowns.units, names, unknowns.logarithmic)
