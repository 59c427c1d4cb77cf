"""The contact force: piston area times the pressures, with physical effects beside it, fitted to the measured one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cfd_pneumatic.convention import AREAS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.force_experiment import ForceExperiment
from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares
from cfd_pneumatic.identification.fit.output_error import Estimate
from cfd_pneumatic.identification.fit.uncertainty import LARGEST_RELATIVE_STD, covariance
from cfd_pneumatic.model.effects import FORCE_EFFECTS, Data
from cfd_pneumatic.model.extended_force import ExtendedForce

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Effects = Mapping[str, Sequence[float]]
"""Parameters of each effect on the force that is on, by its name."""

LARGEST_AREA_RATIO = 1.5
"""Farther from where it begins the area is not searched [-]."""

_LEVEL_GAP = 0.03  # set-points closer than this share of the pressure tell the area no better than one
_AT_BOUND = 1e-6  # of an unknown's scale
_STEP = 1e-6  # of it, by which residuals are differentiated
_FINE = (1e-8, 60)  # share of the sum of squares by which a step must lower it, and steps at most
_CONFIDENCE = 0.95
_SINGULAR = 1e-4  # share of the largest singular value below which a combination of unknowns is not told
_STRETCHED = '1'  # unit of the seals' first stretches, which no effect's parameter has


@dataclass(frozen=True)
class ForceFit:
    """
    The result of one joint fit of the force.

    Attributes
    ----------
    area
        Piston area, found or given [m^2].
    factor
        Contact force over piston force, from the linkage, as given [-].
    effects
        Parameters of each effect, found or given.
    stretches
        For each experiment how far the seals were stretched at its first sample, -1 to 1 [-].
    estimates
        What was searched with its uncertainty and verdict: `area`, then `EFFECT.PARAMETER`. Empty where they were not
        asked for.
    simulated
        For each experiment the force at its samples [N].
    cost
        Sum of squares over the samples that count [N^2].
    jacobian
        Of the force at the samples that count by the unknowns, each in a scale of its own, shape (n, k).

    """

    area: float
    factor: float
    effects: Effects
    stretches: tuple[float, ...]
    estimates: tuple[Estimate, ...]
    simulated: tuple[Array, ...]
    cost: float
    jacobian: Array = field(repr=False)

    @property
    def unknowns(self) -> int:
        """How many numbers the force depends on."""
        return int(np.count_nonzero(np.any(self.jacobian, axis=0)))

    def model(self, ambient_pressure: float) -> ExtendedForce:
        """Return the model of the force, at an absolute ambient pressure [Pa]."""
        return ExtendedForce(self.area * self.factor, self.effects, ambient_pressure)

    def residuals(self, experiments: Sequence[ForceExperiment]) -> list[Array]:
        """Return measured less simulated force of each experiment [N]."""
        return [experiment.force - force for experiment, force in zip(experiments, self.simulated)]


class _Unknown:
    """One searched number: in its logarithm, or in a scale that makes it about one."""

    def __init__(
        self, name: str, unit: str, start: float, lower: float, upper: float, scale: float, logarithmic: bool = False
    ) -> None:
        self.name = name
        self.unit = unit
        self.logarithmic = logarithmic
        self.scale = scale
        self.lower = self.inward(lower)
        self.upper = self.inward(upper)
        self.start = float(np.clip(self.inward(start), self.lower + _AT_BOUND, self.upper - _AT_BOUND))

    def inward(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value / self.scale

    def outward(self, searched: float) -> float:
        return math.exp(searched) if self.logarithmic else searched * self.scale

    def std(self, searched: float, std: float) -> float:
        """Return the standard error [unit] from that of the searched number."""
        return std * (math.exp(searched) if self.logarithmic else self.scale)

    def estimate(self, searched: float, std: float, quantile: float) -> Estimate:
        """Return the estimate with a standard error [unit], and a quantile of the residual's distribution."""
        value = self.outward(searched)
        return Estimate(self.name, self.unit, value, std, (value - quantile * std, value + quantile * std), None)

    def untold(self, reason: str) -> Estimate:
        """Return the estimate where the recordings don't tell it."""
        return Estimate(self.name, self.unit, None, None, None, reason)

    def unmoved(self, searched: float, column: Array) -> str | None:
        """Return why its value means nothing, from how the residuals depend on it; None where it may mean something."""
        if not np.any(column):
            return 'nothing in the recordings depends on it'
        if self.unit == _STRETCHED:
            return None  # its bounds are nature's
        if searched - self.lower < 10.0 * _AT_BOUND:
            return f'the fit ends at its lower bound {self.outward(self.lower):g} {self.unit}'
        if self.upper - searched < 10.0 * _AT_BOUND:
            return f'the fit ends at its upper bound {self.outward(self.upper):g} {self.unit}'
        return None


def _at_one_pressure(effects: Effects) -> Effects:
    """Return effects whose dependences on pressure are null."""
    return {
        name: tuple(
            parameter.null if parameter.of_pressure else value
            for parameter, value in zip(FORCE_EFFECTS[name].parameters, own)
        )
        for name, own in effects.items()
    }


class _Search:
    """A joint search of the area, the effects' parameters and the seals' first stretches."""

    def __init__(
        self,
        experiments: Sequence[ForceExperiment],
        masks: Sequence[Mask],
        ambient_pressure: float,
        area: float,
        several_levels: bool,
        factor: float,
        effects: Effects,
    ) -> None:
        self.experiments = experiments
        self.masks = masks
        self.ambient_pressure = ambient_pressure
        self.area = area
        self.factor = factor
        self.effects = effects if several_levels else _at_one_pressure(effects)
        self.area_unknowns = (
            [_Unknown('area', 'm^2', area, area / LARGEST_AREA_RATIO, area * LARGEST_AREA_RATIO, area)]
            if several_levels
            else []
        )
        self.searched = [
            (name, index)
            for name in effects
            for index, parameter in enumerate(FORCE_EFFECTS[name].parameters)
            if not parameter.choice and (several_levels or not parameter.of_pressure)
        ]
        slides = any(FORCE_EFFECTS[name].states for name in effects)
        self.stretches = [
            _Unknown(f'stretch {index}', _STRETCHED, 0.0, -1.0, 1.0, 1.0)
            for index in range(len(experiments) if slides else 0)
        ]
        self.unknowns = [*self.area_unknowns, *(self._unknown(*one) for one in self.searched), *self.stretches]

    def _unknown(self, name: str, index: int) -> _Unknown:
        parameter = FORCE_EFFECTS[name].parameters[index]
        start = self.effects[name][index]
        scale = 0.1 * min(abs(parameter.lower) + abs(parameter.upper), 1e3)
        return _Unknown(
            f'{name}.{parameter.name}',
            parameter.unit,
            start,
            parameter.lower,
            parameter.upper,
            scale,
            parameter.logarithmic,
        )

    def unpack(self, point: Array) -> tuple[float, dict[str, tuple[float, ...]], tuple[float, ...]]:
        """Return area [m^2], effects and stretches."""
        values = [unknown.outward(value) for unknown, value in zip(self.unknowns, point.tolist())]
        area = values.pop(0) if self.area_unknowns else self.area
        effects = {name: list(own) for name, own in self.effects.items()}
        for (name, index), value in zip(self.searched, values):
            effects[name][index] = value
        stretches = values[len(self.searched) :] or [0.0] * len(self.experiments)
        return area, {name: tuple(own) for name, own in effects.items()}, tuple(stretches)

    def simulate(self, point: Array) -> tuple[Array, ...]:
        """Return the force of each experiment at its samples [N]."""
        area, effects, stretches = self.unpack(point)
        model = ExtendedForce(area * self.factor, effects, self.ambient_pressure)
        return tuple(one.simulate(model, stretch) for one, stretch in zip(self.experiments, stretches))

    def residuals(self, point: Array) -> Array:
        """Return simulated less measured force of all experiments, masked [N]."""
        simulated = self.simulate(point)
        return np.concatenate(
            [(force - one.force)[mask] for force, one, mask in zip(simulated, self.experiments, self.masks)]
        )

    def tangent(self, point: Array) -> tuple[Array, Array]:
        """Return the residuals and their Jacobian, by steps away from the nearer bound."""
        residuals = self.residuals(point)
        jacobian = np.empty((residuals.size, point.size))
        for index, unknown in enumerate(self.unknowns):
            step = _STEP if unknown.upper - point[index] > point[index] - unknown.lower else -_STEP
            moved = point.copy()
            moved[index] += step
            jacobian[:, index] = (self.residuals(moved) - residuals) / step
        return residuals, jacobian

    def run(self, tolerance: float, steps: int) -> Array:
        """Return the best point."""
        start = np.array([unknown.start for unknown in self.unknowns])
        if start.size == 0:
            return start
        lower = np.array([unknown.lower for unknown in self.unknowns])
        upper = np.array([unknown.upper for unknown in self.unknowns])
        point, _ = least_squares(lambda at: Quadratic.of(*self.tangent(at)), start, lower, upper, tolerance, steps)
        return point


def fit_force(
    experiments: Sequence[ForceExperiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    area: float | None,
    factor: float,
    effects: Effects,
    tolerance: float = _FINE[0],
    steps: int = _FINE[1],
    *,
    estimated: bool = True,
) -> ForceFit:
    """
    Fit piston area and effects jointly to the measured force of several recordings.

    The area is searched where the recordings hold more than one set-point, and held as given where they don't: at one
    pressure an offset of the force is as good as any area. Likewise with what depends on pressure in the effects.

    Parameters
    ----------
    experiments
        What was measured.
    masks
        For each experiment which of its force samples count, shape (m,).
    ambient_pressure
        Absolute [Pa].
    area
        About how large the piston is [m^2]; None if nobody knows.
    factor
        Contact force over piston force, from the linkage [-].
    effects
        Effects with starting values; parameters that are choices stay as they are.
    tolerance, steps
        Share of the sum of squares by which a step of the search must lower it, and most steps.
    estimated
        Whether uncertainties are worked out, which takes longer than a rough search.

    Raises
    ------
    InputError
        If the force falls with the pressure, nothing tells the area, or it is none that a piston has.

    """
    several_levels = hold_several_levels(experiments, masks)
    if several_levels:
        slope = _slope(experiments, masks, factor)
        area = slope if area is None else area
    elif area is None:
        raise InputError('at one set-point the force does not tell the piston area: give it, or record a second one')
    search = _Search(experiments, masks, ambient_pressure, area, several_levels, factor, effects)
    point = search.run(tolerance, steps)
    found, own, stretches = search.unpack(point)
    if not AREAS[0] <= found <= AREAS[1]:
        raise InputError(
            f'the force makes the piston area {found:.3g} m^2, outside {AREAS[0]:g} to {AREAS[1]:g} m^2: check the '
            'units of force and pressure'
        )
    residuals, jacobian = search.tangent(point)
    estimates = _estimates(search, point, jacobian, residuals) if estimated else []
    if estimated and not several_levels:
        level = float(np.median(np.concatenate([one.level for one in experiments])))
        reason = (
            f'all recordings have one set-point, {level:.0f} Pa: record a second one '
            f'(it is held at {found * 1e6:.1f} mm^2)'
        )
        estimates.insert(0, Estimate('area', 'm^2', None, None, None, reason))
    return ForceFit(
        area=found,
        factor=factor,
        effects=own,
        stretches=stretches,
        estimates=tuple(estimates),
        simulated=search.simulate(point),
        cost=float(residuals @ residuals),
        jacobian=jacobian,
    )


def fit_area(
    experiments: Sequence[ForceExperiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    area: float | None,
    factor: float,
) -> ForceFit:
    """
    Return the fit without effects: as `fit_force`, but an area that nobody gave is held at the likely one.

    Experiments that are `thin` will do.
    """
    likely = likely_area(experiments, masks, factor) if area is None else area
    return fit_force(experiments, masks, ambient_pressure, likely, factor, {})


def hold_several_levels(experiments: Sequence[ForceExperiment], masks: Sequence[Mask]) -> bool:
    """Return whether the samples that count hold more than one set-point, as they must to tell the area."""
    levels = np.concatenate([one.level[mask] for one, mask in zip(experiments, masks)])
    return bool(np.ptp(levels) > _LEVEL_GAP * np.max(np.abs(levels)))


def likely_area(experiments: Sequence[ForceExperiment], masks: Sequence[Mask], factor: float) -> float:
    """
    Return the area that makes the force at one set-point, the sensor's zero taken to be right [m^2].

    By a line through zero: friction, which follows the pressure as both follow the motion, hardly tilts it.

    Raises
    ------
    InputError
        If the force is against the pressure.

    """
    differences = np.concatenate([one.difference[mask] for one, mask in zip(experiments, masks)])
    forces = np.concatenate([one.force[mask] for one, mask in zip(experiments, masks)])
    area = float(forces @ differences) / float(differences @ differences) / factor
    if not area > 0.0:
        raise InputError('the force is against the pressure difference: check the sign of the force')
    return area


def _slope(experiments: Sequence[ForceExperiment], masks: Sequence[Mask], factor: float) -> float:
    """Return by how much the piston's force grows with the pressures' difference [m^2]."""
    differences = np.concatenate([one.difference[mask] for one, mask in zip(experiments, masks)])
    forces = np.concatenate([one.force[mask] for one, mask in zip(experiments, masks)])
    slope = float(np.polyfit(differences, forces, 1)[0]) / factor
    if slope <= 0.0:
        raise InputError('the force falls while the pressure difference grows: check the sign of the force')
    return slope


def _estimates(search: _Search, point: Array, jacobian: Array, residuals: Array) -> list[Estimate]:
    """Return area and parameters with their uncertainty; what is not told is held, and the others' errors are so."""
    degrees = residuals.size - len(search.unknowns)
    if degrees < 1:
        raise InputError(f'{residuals.size} force samples are too few for {len(search.unknowns)} unknowns')
    reasons = {}
    for index, unknown in enumerate(search.unknowns):
        reason = unknown.unmoved(point[index], jacobian[:, index])
        if reason is None and unknown.unit == 'kg' and not any(one.resolves_acceleration for one in search.experiments):
            reason = 'the acceleration changes from sample to sample: sample faster'
        if reason is not None:
            reasons[index] = reason
    for index in _entangled(jacobian, [index for index in range(len(search.unknowns)) if index not in reasons]):
        reasons[index] = 'it can not be told from other unknowns: let the piston reverse, or change the set-point'
    lengths = [int(np.count_nonzero(mask)) for mask in search.masks]
    reported = range(len(search.unknowns) - len(search.stretches))
    while True:
        free = [index for index in range(len(search.unknowns)) if index not in reasons]
        if not free:
            break
        variances = np.diag(covariance(jacobian[:, free], residuals, degrees, lengths))
        stds = {
            index: search.unknowns[index].std(point[index], std)
            for index, std in zip(free, np.sqrt(variances).tolist())
        }
        shares = {  # of the others zero is an answer
            index: stds[index] / search.unknowns[index].outward(point[index])
            for index in free
            if search.unknowns[index].logarithmic
        }
        worst = max(shares, key=lambda index: shares[index], default=None)
        if worst is None or shares[worst] <= LARGEST_RELATIVE_STD:
            break
        reasons[worst] = f'its standard error would be {100.0 * shares[worst]:.0f} % of its value'
    quantile = float(stdtrit(degrees, 0.5 + 0.5 * _CONFIDENCE))
    return [
        search.unknowns[index].estimate(point[index], stds[index], quantile)
        if index not in reasons
        else search.unknowns[index].untold(reasons[index])
        for index in reported
    ]


def _entangled(jacobian: Array, free: list[int]) -> list[int]:
    """Return those of the free unknowns of which the recordings tell only a combination."""
    if not free:
        return []
    columns = jacobian[:, free] / np.linalg.norm(jacobian[:, free], axis=0)
    _, sizes, directions = np.linalg.svd(columns, full_matrices=False)
    blind = directions[sizes < _SINGULAR * sizes[0]]
    return [index for rank, index in enumerate(free) if np.any(np.abs(blind[:, rank]) > LARGEST_RELATIVE_STD)]


def starting_force_data(experiments: Sequence[ForceExperiment], fitted: ForceFit, ambient_pressure: float) -> Data:
    """
    Return what effects on the force draw their starting values from.

    =======================================  =======================================================
    `force_residual`, `force_mean` [N]       spread and mean of what a fit leaves of the force
    `gauge` [Pa]                             median gauge pressure, both cylinders added
    `largest_speed` [m/s]                    of the piston, but for the fastest hundredth
    `largest_acceleration` [m/s^2]           likewise
    =======================================  =======================================================
    """
    residual = np.concatenate(fitted.residuals(experiments))
    gauge = np.concatenate([one.pressure + one.opposing - 2.0 * ambient_pressure for one in experiments])
    rate = np.concatenate([one.rate for one in experiments])
    acceleration = np.concatenate([one.acceleration for one in experiments])
    return {
        'force_residual': max(float(np.std(residual)), 1e-3),
        'force_mean': float(np.mean(residual)),
        'gauge': max(float(np.median(gauge)), 1e3),
        'largest_speed': max(float(np.percentile(np.abs(rate), 99.0)), 1e-5),
        'largest_acceleration': max(float(np.percentile(np.abs(acceleration), 99.0)), 1e-3),
    }
