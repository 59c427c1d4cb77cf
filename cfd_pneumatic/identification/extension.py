"""Fits of the paper's model with physical effects beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.model import DIRECTIONS, SPECS
from cfd_pneumatic.model.effects import EFFECTS, EffectParameter
from cfd_pneumatic.model.extended import ExtendedCylinder

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Effects = Mapping[str, tuple[float, ...]]
"""Parameters of each effect that is on, by its name."""

GAINS = len(SPECS)
_DIFFERENCE = 1e-5  # step of a forward difference, as a share of an unknown's scale
_SHORTEST_TAU = 0.1  # of a sample: a faster sensing can't be told from none, and would cost steps


@dataclass(frozen=True)
class Extension:
    """
    The paper's model with effects, fitted.

    Attributes
    ----------
    gains
        k_x, k_sv, k_v, tau [Pa/m, 1/s, 1/s, s].
    effects
        Fitted parameters of each effect.
    offsets, starts
        As in `fit.Fit` [Pa].
    simulated
        For each experiment the pressure at its samples [Pa].

    """

    gains: Array
    effects: Effects
    offsets: tuple[float, ...]
    starts: tuple[float, ...]
    simulated: tuple[Array, ...]

    def residuals(self, experiments: Sequence[Experiment]) -> list[Array]:
        """Return measured less simulated pressure of each experiment [Pa]."""
        return [experiment.pressure - pressure for experiment, pressure in zip(experiments, self.simulated)]


class _Unknown:
    """How one number of the model is searched: in its logarithm or in a scale that makes it about one."""

    def __init__(self, value: float, lower: float, upper: float, logarithmic: bool, scale: float) -> None:
        self.logarithmic = logarithmic
        self.scale = 1.0 if logarithmic else scale
        self.lower = self.inward(lower)
        self.upper = self.inward(upper)
        self.start = min(max(self.inward(value), self.lower), self.upper)

    def inward(self, value: float) -> float:
        if not self.logarithmic:
            return value / self.scale
        return math.log(value) if value < math.inf else math.inf

    def outward(self, searched: float) -> float:
        return math.exp(searched) if self.logarithmic else searched * self.scale


class _Search:
    """A joint search of gains, effects, set-point offsets and first pressures."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        masks: Sequence[Mask],
        ambient_pressure: float,
        begin: Extension,
        effects: Effects,
    ) -> None:
        self.experiments = experiments
        self.masks = masks
        self.ambient_pressure = ambient_pressure
        self.names = list(effects)
        period = min(float(np.median(np.diff(one.sample_times))) for one in experiments)
        self.unknowns = [
            _Unknown(
                float(value),
                max(spec.lower, _SHORTEST_TAU * period) if spec.name == 'tau' else spec.lower,
                spec.upper,
                True,
                1.0,
            )
            for spec, value in zip(SPECS, begin.gains)
        ]
        scale = float(np.mean([one.span for one in experiments]))
        self.unknowns += [_Unknown(offset, -math.inf, math.inf, False, scale) for offset in begin.offsets]
        anywhere = any(EFFECTS[name].rests_anywhere for name in self.names)
        self.free_starts = [index for index, one in enumerate(experiments) if anywhere or not one.starts_at_rest]
        self.unknowns += [
            _Unknown(begin.starts[index], -math.inf, math.inf, False, scale) for index in self.free_starts
        ]
        self.chosen = {name: list(effects[name]) for name in self.names}
        self.searched: list[tuple[str, int, EffectParameter]] = []
        for name in self.names:
            for index, parameter in enumerate(EFFECTS[name].parameters):
                if not parameter.choice:
                    value = effects[name][index]
                    size = abs(value) or 1e-3 * min(abs(parameter.lower) + abs(parameter.upper), 1.0)
                    self.unknowns.append(_Unknown(value, parameter.lower, parameter.upper, parameter.logarithmic, size))
                    self.searched.append((name, index, parameter))

    def unpack(self, point: Array) -> tuple[Array, Effects, list[float], list[float]]:
        values = [unknown.outward(value) for unknown, value in zip(self.unknowns, point)]
        count = len(self.experiments)
        gains = np.array(values[:GAINS])
        offsets = values[GAINS : GAINS + count]
        starts = [0.0] * count
        for rank, index in enumerate(self.free_starts):
            starts[index] = values[GAINS + count + rank]
        effects = {name: list(own) for name, own in self.chosen.items()}
        for (name, index, _), value in zip(self.searched, values[GAINS + count + len(self.free_starts) :]):
            effects[name][index] = value
        return gains, {name: tuple(own) for name, own in effects.items()}, offsets, starts

    def simulate(self, point: Array) -> list[Array]:
        gains, effects, offsets, starts = self.unpack(point)
        cylinder = ExtendedCylinder(gains, effects, self.ambient_pressure)
        delay = sum(effects[name][0] for name in self.names if EFFECTS[name].delays)
        return [
            cylinder.simulate(
                one.times,
                one.displacement if delay == 0.0 else _delayed(one, delay),
                one.setpoint + offset,
                start,
            )[one.samples]
            for one, offset, start in zip(self.experiments, offsets, starts)
        ]

    def residuals(self, point: Array) -> Array:
        return np.concatenate(
            [
                (pressure - one.pressure)[mask]
                for pressure, one, mask in zip(self.simulate(point), self.experiments, self.masks)
            ]
        )

    def jacobian(self, point: Array) -> Array:
        base = self.residuals(point)
        columns = []
        for index, unknown in enumerate(self.unknowns):
            step = _DIFFERENCE if point[index] + _DIFFERENCE <= unknown.upper else -_DIFFERENCE
            moved = point.copy()
            moved[index] += step
            columns.append((self.residuals(moved) - base) / step)
        return np.column_stack(columns)

    def run(self, tolerance: float, evaluations: int) -> tuple[Extension, float]:
        """Return the fit and its sum of squares over the masked samples [Pa^2]."""
        start = np.array([unknown.start for unknown in self.unknowns])
        lower = np.array([unknown.lower for unknown in self.unknowns])
        upper = np.array([unknown.upper for unknown in self.unknowns])
        inside = np.clip(start, lower + 1e-9, upper - 1e-9)
        found = least_squares(
            self.residuals,
            inside,
            jac=self.jacobian,
            bounds=(lower, upper),
            x_scale='jac',
            ftol=tolerance,
            max_nfev=evaluations,
        )
        gains, effects, offsets, starts = self.unpack(found.x)
        simulated = tuple(self.simulate(found.x))
        return Extension(gains, effects, tuple(offsets), tuple(starts), simulated), 2.0 * float(found.cost)


def _delayed(experiment: Experiment, delay: float) -> Array:
    """Return the displacement that acted `delay` seconds before each grid time [m]."""
    times = np.clip(experiment.times - delay, experiment.motion.times[0], experiment.motion.times[-1])
    return DIRECTIONS[experiment.cylinder] * experiment.motion.at(times)


def extend(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    begin: Extension,
    effects: Effects,
    tolerance: float = 1e-8,
    evaluations: int = 60,
) -> tuple[Extension, float]:
    """
    Fit the paper's model with effects, from given starting values; return it and its sum of squares [Pa^2].

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
    tolerance, evaluations
        The search ends when the sum of squares falls by less than this share, or after so many steps.

    """
    return _Search(experiments, masks, ambient_pressure, begin, effects).run(tolerance, evaluations)
