"""
Which physical effects a recording shows that the paper's model lacks.

Every effect is fitted beside the model to the train part; the best that is worth its parameters is added, and so on.
What is worth it: the Bayesian information criterion of the whitened residual, the error on the validation part, the
drop of the residual's sum of squares. Then effects that are not needed any more are taken out, and each is tried
against its rivals. The test part is never looked at.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.colour import autoregression, independent_share, whitened
from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.extension import Effects, Extension, extend
from cfd_pneumatic.identification.noise import precision, pressure_noise, sample_noise
from cfd_pneumatic.identification.residuals import explained, residual_tests
from cfd_pneumatic.identification.split import PARTS
from cfd_pneumatic.identification.starts import starting_data
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS, Data, Effect

Array = NDArray[np.float64]

_LEAST_BIC = 10.0  # by which an effect must lower the criterion
_LEAST_BIC_UNSEEN = 20.0  # where there is no validation part to agree
_LEAST_DROP = (0.01, 0.03)  # of the sum of squares, by a first effect and by each further one
_BETTER = 2.0  # by which a rival must lower the criterion to take an effect's place
_TIE = 10.0  # rivals within so much of the criterion can't be told apart
_MOST_EFFECTS = 3
_MOST_ALTERNATIVES = 2
_SMALL_ENOUGH = 1.03  # residual over noise at which no further effect is looked for
_REFINED = 2  # of an effect's starts
_PROMISING = 4  # effects that are fitted to the end at least
_ROUNDS = 2  # of trying rivals
_RIVALS = 4  # that are tried in an effect's place
_STRONG = 5.0  # in sample noises: a residual that may have led the gains astray
_QUICKER = 5.0
_SLOWEST_RELIEF, _USUAL_RELIEF = 0.1, 0.25  # K_v over K_sv; the paper's tables have 0.15 to 0.3
_ROUGH = (1e-2, 5)  # tolerance and evaluations from each start
_FINE = (1e-5, 20)


@dataclass(frozen=True)
class Trial:
    """
    One effect that was tried.

    Attributes
    ----------
    effect
        Its name.
    delta_bic
        By how much it lowers the criterion.
    rss_drop
        Share of the train part's sum of squares that it takes.
    validation_rmse
        Error on the validation part with it [Pa]; None where there is no such part.
    accepted
        Whether it was added.
    why
        Why, or why not.

    """

    effect: str
    delta_bic: float
    rss_drop: float
    validation_rmse: float | None
    accepted: bool
    why: str


@dataclass(frozen=True)
class Attribution:
    """
    Effects that were found.

    Attributes
    ----------
    extension
        The model with them, fitted to the train part; its effects stand in the order in which they were added.
    alternatives
        For each effect those that the data can't tell from it, at most two.
    tried
        Every effect that was tried, in the order of the search.

    """

    extension: Extension
    alternatives: Mapping[str, tuple[str, ...]]
    tried: tuple[Trial, ...]


@dataclass(frozen=True)
class _Model:
    """The model with some effects, fitted to the train part."""

    extension: Extension
    simulated: list[Array]
    residuals: tuple[Array, ...]

    @property
    def effects(self) -> Effects:
        return self.extension.effects

    @property
    def rss(self) -> float:
        return float(sum(residual @ residual for residual in self.residuals))


class Search:
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
        self.train = [one.until('train') for one in experiments]
        self.learn = [one.until('validation') for one in experiments]
        self.masks = [one.part == PARTS.index('train') for one in self.train]
        self.samples = sum(int(mask.sum()) for mask in self.masks)
        simulated = baseline.simulate(self.train, ambient_pressure)
        self.weights = [precision(one, pressure) for one, pressure in zip(self.train, simulated)]
        self.noise = math.sqrt(
            sum(sample_noise(one.sample_times, one.pressure) ** 2 for one in self.train) / len(self.train)
        )
        self.trials: list[Trial] = []
        self.baseline = self._fit(baseline, {}, *_FINE)

    def _fit(self, begin: Extension, effects: Effects, tolerance: float, evaluations: int) -> _Model:
        found = extend(
            self.train, self.masks, self.ambient_pressure, begin, effects, self.weights, tolerance, evaluations
        )
        simulated = found.simulate(self.train, self.ambient_pressure)
        residuals = tuple(
            ((one.pressure - pressure) * weight)[mask]
            for one, pressure, weight, mask in zip(self.train, simulated, self.weights, self.masks)
        )
        return _Model(found, simulated, residuals)

    def extensions(self, model: _Model, names: Sequence[str]) -> dict[str, _Model]:
        """
        Return a model with each of some effects beside its own.

        All are fitted roughly, from every start; the more promising half is fitted to the end.
        """
        data = starting_data(self.train, model.extension, model.simulated, self.ambient_pressure)
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:  # simulations let other threads run
            rough = dict(zip(names, pool.map(lambda name: self._rough(model, name, data), names)))
            promising = sorted(names, key=lambda name: rough[name][0].rss)[: max(_PROMISING, len(names) // 2)]
            fine = dict(zip(promising, pool.map(lambda name: self._fine(rough[name]), promising)))
        return {name: fine.get(name, rough[name][0]) for name in names}

    def _rough(self, model: _Model, name: str, data: Data) -> list[_Model]:
        """Return a model with one more effect as rough fits from each start leave it, the best first."""
        fits = [
            self._fit(begin, {**model.effects, name: start}, *_ROUGH)
            for begin in self._beginnings(model)
            for start in self.library[name].starts(data)
        ]
        return sorted(fits, key=lambda one: one.rss)

    def _fine(self, rough: Sequence[_Model]) -> _Model:
        """Return the best of a few rough fits, fitted to the end."""
        fits = [self._fit(one.extension, one.effects, *_FINE) for one in rough[:_REFINED]]
        return min(fits, key=lambda one: one.rss)

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
        return self._fit(model.extension, fewer, *_FINE)

    def criterion(self, model: _Model, colour: Array) -> float:
        """Return the Bayesian information criterion of a model at a colour of noise."""
        rss = sum(float(np.sum(whitened(residual, colour) ** 2)) for residual in model.residuals)
        return self.samples * math.log(max(rss, 1e-300)) + model.extension.unknowns * math.log(self.samples)

    def evidence(self, model: _Model, candidate: _Model) -> float:
        """
        Return by how much a candidate lowers the criterion where noise of its colour at rest counts for less.

        A slow effect, a sine for one, suits slow noise too, and whitening alone doesn't see that.
        """
        noise = pressure_noise(self.train, candidate.simulated, candidate.extension.gains[0])
        samples = self.samples * independent_share(noise.colour)
        more = candidate.extension.unknowns - model.extension.unknowns
        return samples * math.log(model.rss / max(candidate.rss, 1e-300)) - more * math.log(samples)

    def validation_rmse(self, model: _Model) -> float | None:
        """Return a model's error on the validation part [Pa]; None where there is no such part."""
        pressures = model.extension.simulate(self.learn, self.ambient_pressure)
        errors = np.concatenate(
            [
                (pressure - one.pressure)[one.part == PARTS.index('validation')]
                for one, pressure in zip(self.learn, pressures)
            ]
        )
        return math.sqrt(float(np.mean(errors**2))) if errors.size else None

    def run(self) -> Attribution:
        """Add what is worth it, take out what is not needed any more, and try each effect against its rivals."""
        model = self.baseline
        ranking: dict[str, list[str]] = {}
        while len(model.effects) < _MOST_EFFECTS and not (model.effects and self._explained(model)):
            added, ranked = self.step(model)
            if added is None:
                break
            name = list(added.effects)[-1]
            ranking[name] = [other for other in ranked if other != name][:_RIVALS]
            model = self.pruned(added)
        model, alternatives = self.challenged(model, ranking)
        return Attribution(model.extension, alternatives, tuple(self.trials))

    def _explained(self, model: _Model) -> bool:
        """Return whether what a model leaves of train and validation is noise, in kind and in size."""
        simulated = model.extension.simulate(self.learn, self.ambient_pressure)
        noise = pressure_noise(self.learn, simulated, model.extension.gains[0])
        masks = [np.ones(one.pressure.size, dtype=np.bool_) for one in self.learn]
        tests = residual_tests(self.learn, simulated, masks, noise)
        size = next(test.statistic for test in tests if test.name == 'noise_floor')
        return explained(tests) and size <= _SMALL_ENOUGH

    def step(self, model: _Model) -> tuple[_Model | None, list[str]]:
        """Try every effect beside a model; return the model with the best that is worth it, and all names by rank."""
        candidates = self.extensions(model, [name for name in self.library if name not in model.effects])
        colour = autoregression(min((*candidates.values(), model), key=lambda one: one.rss).residuals)
        before = self.criterion(model, colour)
        after = {name: self.criterion(one, colour) for name, one in candidates.items()}
        ranked = sorted(after, key=lambda name: after[name])
        reference = self.validation_rmse(model)
        chosen = None
        for name in ranked:
            candidate = candidates[name]
            gain = min(before - after[name], self.evidence(model, candidate))
            drop = 1.0 - candidate.rss / model.rss
            validation = self.validation_rmse(candidate)
            objection = _objection(gain, drop, len(model.effects), validation, reference)
            if objection is None and chosen is None:
                chosen = candidate
                self.trials.append(Trial(name, gain, drop, validation, True, 'lowers the criterion most'))
            else:
                why = objection or 'worth it, but another lowers the criterion more'
                self.trials.append(Trial(name, gain, drop, validation, False, why))
        return chosen, ranked

    def pruned(self, model: _Model) -> _Model:
        """Return a model without the effects that it does not need any more, the last one apart."""
        for name in list(model.effects)[:-1]:
            fewer = self.without(model, name)
            colour = autoregression(model.residuals)
            gain = self.criterion(fewer, colour) - self.criterion(model, colour)
            if _objection(gain, 1.0 - model.rss / fewer.rss, 1, self.validation_rmse(model), math.inf) is not None:
                model = fewer
        return model

    def challenged(
        self, model: _Model, ranking: Mapping[str, Sequence[str]]
    ) -> tuple[_Model, Mapping[str, tuple[str, ...]]]:
        """Try rivals in each effect's place; return the best model, and for each effect those that do as well."""
        for _ in range(_ROUNDS):
            colour = autoregression(model.residuals)
            own = self.criterion(model, colour)
            alternatives: dict[str, tuple[str, ...]] = {}
            better: tuple[float, _Model] | None = None
            for name in model.effects:
                rest = self.without(model, name)
                rivals = self.extensions(rest, [rival for rival in ranking.get(name, ()) if rival not in model.effects])
                gains = {rival: own - self.criterion(one, colour) for rival, one in rivals.items()}
                ties = sorted((rival for rival in gains if gains[rival] > -_TIE), key=lambda rival: -gains[rival])
                alternatives[name] = tuple(ties[:_MOST_ALTERNATIVES])
                if ties and gains[ties[0]] > (better[0] if better else _BETTER):
                    better = gains[ties[0]], rivals[ties[0]]
            if better is None:
                return model, alternatives
            replaced = set(model.effects) - set(better[1].effects)
            newcomer = list(better[1].effects)[-1]
            ranking = {**ranking, newcomer: [*replaced, *ranking.get(replaced.pop(), ())]}
            model = better[1]
        return model, alternatives


def _objection(gain: float, drop: float, rank: int, validation: float | None, reference: float | None) -> str | None:
    """Return why an effect is not worth adding to `rank` others, or None."""
    if gain <= (_LEAST_BIC if validation is not None else _LEAST_BIC_UNSEEN):
        return 'not worth its parameters'
    if drop < _LEAST_DROP[min(rank, 1)]:
        return f'takes less than {100 * _LEAST_DROP[min(rank, 1)]:.0f} % of the residual'
    if validation is not None and reference is not None and validation >= reference:
        return 'no better on the validation part'
    return None
