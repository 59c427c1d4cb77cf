"""
Which physical effects a recording shows that the paper's model lacks.

How effects are judged stands in `judgement`; here is how a cylinder's pressure is fitted with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.fit.extension import Effects, Extension, extend_with_cost
from cfd_pneumatic.identification.fit.starts import starting_data
from cfd_pneumatic.identification.residual.noise import precision, pressure_noise, sample_noise
from cfd_pneumatic.identification.residual.tests import Test, residual_tests
from cfd_pneumatic.identification.search.screening import Screening, Start
from cfd_pneumatic.identification.search.stepwise import EffectSearch, Found
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS, Effect
from cfd_pneumatic.parallel import each

Array = NDArray[np.float64]

_REFINED = 2  # of an effect's starts
_PROMISING = 4  # effects that are fitted to the end at least
_LONG = 5000  # grid steps
_EXCERPT = 5000  # grid steps of each recording that rough fits are of
_LONGER_EXCERPT = 40_000  # that fits are brought close on where everything is more than twice as much
_FITTED_OF_LONG = 6  # effects
_RIVALLING = 0.3  # of what the best one takes: what is fitted to the end of long recordings
_ALIKE = 0.7  # of what its best start takes: starts whose rough fits may change places
_STRONG = 5.0  # in sample noises: a residual that may have led the gains astray
_QUICKER = 5.0
_SLOWEST_RELIEF, _USUAL_RELIEF = 0.1, 0.25  # K_v over K_sv; the paper's tables have 0.15 to 0.3
_ROUGH = (1e-2, 10)  # tolerance and evaluations from each start
_FINE = (1e-5, 20)


@dataclass(frozen=True, eq=False)
class _Model:
    """
    The model with some effects, fitted to the train part.

    Attributes
    ----------
    extension
        The model.
    simulated
        Its pressures in train and validation [Pa].
    residuals
        What it leaves of train, weighted [Pa].
    validation_rmse
        Its error on the validation part [Pa]; None where there is no such part.

    """

    extension: Extension
    simulated: list[Array]
    residuals: tuple[Array, ...]
    validation_rmse: float | None

    @property
    def effects(self) -> Effects:
        return self.extension.effects

    @property
    def rss(self) -> float:
        return float(sum(residual @ residual for residual in self.residuals))

    @property
    def unknowns(self) -> int:
        return self.extension.unknowns


@dataclass(frozen=True)
class _Data:
    """What is fitted: experiments, which of their samples count, and how much."""

    experiments: list[Experiment]
    masks: list[NDArray[np.bool_]]
    weights: list[Array]

    @property
    def steps(self) -> int:
        """How many grid steps there are."""
        return sum(one.times.size for one in self.experiments)

    def excerpt(self, steps: int) -> _Data:
        """Return the liveliest part of each experiment, or all of it where it has no more steps."""
        experiments, samples = zip(*(one.liveliest(steps, mask) for one, mask in zip(self.experiments, self.masks)))
        return _Data(
            list(experiments),
            [mask[part] for mask, part in zip(self.masks, samples)],
            [weight[part] for weight, part in zip(self.weights, samples)],
        )

    def beginning(self, model: Extension) -> Extension:
        """Return a model that begins where the pressures are that were measured first."""
        starts = [
            0.0 if one.starts_at_rest else float(np.median(one.pressure[:3])) - float(one.setpoint[0]) - offset
            for one, offset in zip(self.experiments, model.offsets)
        ]
        return replace(model, starts=tuple(starts))


@dataclass(frozen=True)
class _Rough:
    """A rough fit, and the sum of squares that it leaves of the train part."""

    extension: Extension
    cost: float


class Search(EffectSearch[_Model]):
    """The search for missing effects in the recordings of one cylinder."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        baseline: Extension,
        ambient_pressure: float,
        library: Mapping[str, Effect] = PRESSURE_EFFECTS,
    ) -> None:
        self.ambient_pressure = ambient_pressure
        self.library = library
        train = [one.until('train') for one in experiments]
        self.learn = [one.until('validation') for one in experiments]
        masks = [one.part == PARTS.index('train') for one in train]
        super().__init__(list(library), sum(int(mask.sum()) for mask in masks))
        simulated = baseline.simulate(train, ambient_pressure)
        weights = [precision(one, pressure) for one, pressure in zip(train, simulated)]
        self.train = _Data(train, masks, weights)
        self.excerpt = self.train.excerpt(_EXCERPT)
        longer = self.train.excerpt(_LONGER_EXCERPT)
        self.longer_excerpt = longer if 2 * longer.steps < self.train.steps else None
        self.noise = math.sqrt(sum(sample_noise(one.sample_times, one.pressure) ** 2 for one in train) / len(train))
        self._known_shares: dict[_Model, dict[str, float]] = {}
        self._known_tests: dict[_Model, list[Test]] = {}
        self.is_long = self.train.steps > _LONG
        self.baseline = self._finished(self._fit(self.train, baseline, {}, *_FINE), baseline)

    def _fit(self, data: _Data, begin: Extension, effects: Effects, tolerance: float, evaluations: int) -> _Rough:
        found, cost = extend_with_cost(
            data.experiments, data.masks, self.ambient_pressure, begin, effects, data.weights, tolerance, evaluations
        )
        return _Rough(found, cost)

    def _finished(self, fit: _Rough, begin: Extension) -> _Model:
        """Return a fit with what it leaves; one that ran away is as if its effects were not there."""
        found = fit.extension
        simulated = found.simulate(self.learn, self.ambient_pressure)
        if not all(np.all(np.isfinite(pressure)) for pressure in simulated):
            absent = {name: begin.effects.get(name, self.library[name].null) for name in found.effects}
            found = replace(begin, effects=absent, unknowns=found.unknowns)
            simulated = found.simulate(self.learn, self.ambient_pressure)
        residuals = tuple(
            ((one.pressure - pressure[: one.pressure.size]) * weight)[mask]
            for one, pressure, weight, mask in zip(
                self.train.experiments, simulated, self.train.weights, self.train.masks
            )
        )
        errors = np.concatenate(
            [
                (pressure - one.pressure)[one.part == PARTS.index('validation')]
                for one, pressure in zip(self.learn, simulated)
            ]
        )
        return _Model(found, simulated, residuals, math.sqrt(float(np.mean(errors**2))) if errors.size else None)

    def _in_train(self, model: _Model) -> list[Array]:
        """Return a model's pressures at the samples of the train part [Pa]."""
        return [pressure[: one.pressure.size] for one, pressure in zip(self.train.experiments, model.simulated)]

    def promising(self, model: _Model, names: Sequence[str]) -> tuple[Sequence[str], Mapping[str, float]]:
        """Return the effects to fit beside a model, and the share of its residual that each other one may take."""
        if not self.is_long:
            return names, {}
        shares = self._shares(model, names)
        ranked = sorted(names, key=lambda name: -shares[name])
        return ranked[:_FITTED_OF_LONG], {name: shares[name] for name in ranked[_FITTED_OF_LONG:]}

    def extensions(self, model: _Model, names: Sequence[str]) -> dict[str, _Model]:
        """
        Return a model with each of some effects beside its own.

        All are fitted roughly, from every start; the more promising ones are fitted to the end.
        """
        starts = self._starts(model, names)
        rough = dict(zip(names, each(lambda name: self._rough(model, name, starts[name]), names)))
        before = self._cost_of_excerpt(model)
        promising = self._rivals(model, rough, before)
        fine = dict(zip(promising, each(lambda name: self._fine(rough[name], before), promising)))
        models = each(lambda name: self._finished(fine.get(name, rough[name][0]), model.extension), names)
        return dict(zip(names, models))

    def _rivals(self, model: _Model, rough: Mapping[str, Sequence[_Rough]], before: float) -> list[str]:
        """Return the effects to fit to the end: the better half; of long recordings those that may be the best."""
        ranked = sorted(rough, key=lambda name: rough[name][0].cost)
        if not self.is_long:
            return ranked[: max(_PROMISING, len(ranked) // 2)]
        taken = {name: 1.0 - rough[name][0].cost / before for name in rough}
        promised = self._shares(model, ranked)
        least, least_promised = _RIVALLING * max(taken.values()), _RIVALLING * max(promised.values())
        may_be = [name for name in ranked if taken[name] >= least or promised[name] >= least_promised]
        return sorted(may_be, key=lambda name: -max(taken[name], promised[name]))[:_PROMISING]

    def _cost_of_excerpt(self, model: _Model) -> float:
        """Return the sum of squares that a model leaves of the excerpt."""
        data = self.excerpt
        begin = data.beginning(model.extension)
        simulated = begin.simulate(data.experiments, self.ambient_pressure)
        parts = zip(data.experiments, simulated, data.weights, data.masks)
        left = [((one.pressure - pressure) * weight)[mask] for one, pressure, weight, mask in parts]
        return sum(float(residual @ residual) for residual in left)

    def _starts(self, model: _Model, names: Sequence[str]) -> dict[str, Sequence[Start]]:
        data = starting_data(self.train.experiments, model.extension, self._in_train(model), self.ambient_pressure)
        return {name: self.library[name].starts(data) for name in names}

    def _shares(self, model: _Model, names: Sequence[str]) -> dict[str, float]:
        """Return what share of a model's residual each effect may take; nothing is simulated twice."""
        known = self._known_shares.setdefault(model, {})
        fresh = [name for name in names if name not in known]
        if fresh:
            data = self.train
            screening = Screening(data.experiments, data.masks, self.ambient_pressure, model.extension, data.weights)
            starts = self._starts(model, fresh)
            known.update(zip(fresh, each(lambda name: screening.share(name, starts[name]), fresh)))
        return {name: known[name] for name in names}

    def _rough(self, model: _Model, name: str, starts: Sequence[Start]) -> list[_Rough]:
        """Return a model with one more effect as rough fits from each start leave it, the best first."""
        fits = [
            self._fit(self.excerpt, self.excerpt.beginning(begin), {**model.effects, name: start}, *_ROUGH)
            for begin in self._beginnings(model)
            for start in starts
        ]
        if self.is_long:
            fits = [replace(one, extension=replace(one.extension, starts=model.extension.starts)) for one in fits]
        return sorted(fits, key=lambda one: one.cost)

    def _fine(self, rough: Sequence[_Rough], before: float) -> _Rough:
        """Return the best of a few rough fits, fitted to the end."""
        best, *others = rough[:_REFINED]
        if self.is_long:
            others = [one for one in others if before - one.cost > _ALIKE * (before - best.cost)]
        close = [self._closer(one.extension) for one in (best, *others)]
        fits = [self._fit(self.train, one, one.effects, *_FINE) for one in close]
        return min(fits, key=lambda one: one.cost)

    def _closer(self, rough: Extension) -> Extension:
        """Return a model that needs few steps to the end; those of a long way are taken where they are cheap."""
        data = self.longer_excerpt
        if data is None:
            return rough
        fitted = self._fit(data, data.beginning(rough), rough.effects, *_FINE)
        return replace(fitted.extension, starts=rough.starts)

    def _beginnings(self, model: _Model) -> list[Extension]:
        """Return where the gains may start from: an effect that is not in the model may have led them astray."""
        beginnings = [model.extension]
        k_x, k_sv, k_v, tau = model.extension.gains
        if model.rss > self.samples * (_STRONG * self.noise) ** 2:
            quicker = np.array([k_x, _QUICKER * k_sv, _QUICKER * k_v, tau / _QUICKER])
            beginnings.append(replace(model.extension, gains=quicker))
        if not _SLOWEST_RELIEF * k_sv <= k_v <= k_sv:
            balanced = np.array([k_x, k_sv, _USUAL_RELIEF * k_sv, tau])
            beginnings.append(replace(model.extension, gains=balanced))
        return beginnings

    def without(self, model: _Model, name: str) -> _Model:
        """Return a model with one effect less."""
        fewer = {other: own for other, own in model.effects.items() if other != name}
        return self._finished(self._fit(self.train, model.extension, fewer, *_FINE), model.extension)

    def resting_colour(self, model: _Model) -> Array:
        """Return the colour of the noise at rest, as a model leaves it."""
        return pressure_noise(self.train.experiments, self._in_train(model), model.extension.gains[0]).colour

    def validation_rmse(self, model: _Model) -> float | None:
        """Return a model's error on the validation part [Pa]; None where there is no such part."""
        return model.validation_rmse

    def run(self) -> Found[_Model]:
        """Return the effects that were found."""
        return self.search(self.baseline)

    def residual_tests(self, model: _Model) -> list[Test]:
        """Return the tests of what a model leaves of train and validation; no model is tested twice."""
        if model not in self._known_tests:
            noise = pressure_noise(self.learn, model.simulated, model.extension.gains[0])
            masks = [one.fitted for one in self.learn]
            self._known_tests[model] = residual_tests(self.learn, model.simulated, masks, noise)
        return self._known_tests[model]
