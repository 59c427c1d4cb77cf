# SPDX-License-Identifier: Apache-2.0
"""Models with one effect more or less: roughly fitted from every start, to the end where that promises much."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Effects, Model
from cfd_pneumatic.identification.data import PARTS
from cfd_pneumatic.identification.fit import Likelihood, Optimum, find_optimum
from cfd_pneumatic.identification.residual import Test, is_noise, sample_noise
from cfd_pneumatic.identification.search.complement import Complement, Start
from cfd_pneumatic.identification.search.thresholds import (
    FINE_EXCERPT_STEPS,
    FINE_SEARCH,
    LEAST_MISLEADING_RESIDUAL,
    LEAST_RIVAL_DROP,
    LEAST_START_DROP,
    LONGEST_UNSCREENED,
    MOST_FITTED_EFFECTS,
    REFINED_EFFECTS,
    REFINED_STARTS,
    ROUGH_EXCERPT_STEPS,
    ROUGH_SEARCH,
)
from cfd_pneumatic.model import Data
from cfd_pneumatic.runtime import map_in_threads


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    A model with some effects, fitted to the train part.

    Attributes
    ----------
    model
        Its values.
    simulated
        What it makes of train and validation [SI].
    residuals
        What it leaves of train, weighted.
    validation_rmse
        Its error on the validation part [SI]; None where there is no such part.

    """

    model: Model
    simulated: list[Array]
    residuals: list[Array]
    validation_rmse: float | None

    @property
    def effects(self) -> Effects:
        """Its effects, in the order in which they were added."""
        return self.model.effects

    @property
    def rss(self) -> float:
        """The residuals' sum of squares."""
        return float(sum(residual @ residual for residual in self.residuals))

    @property
    def unknowns(self) -> int:
        """How many numbers were fitted."""
        return self.model.unknowns


class Candidates:
    """
    Candidates for the model of a channel.

    Parameters
    ----------
    likelihood
        Of everything before the test part.
    begin
        The model without effects, fitted to that.

    """

    def __init__(self, likelihood: Likelihood, begin: Model) -> None:
        self.channel = likelihood.channel
        whole, telling = likelihood.until('train'), likelihood.representative()
        self.learn = telling.until('validation')
        self.train = telling.until('train')
        self.excerpt = whole.excerpt(ROUGH_EXCERPT_STEPS)
        longer = whole.excerpt(FINE_EXCERPT_STEPS)
        self._longer_excerpt = longer if 2 * longer.steps < self.train.steps else None
        self._is_long = self.train.steps > LONGEST_UNSCREENED
        self._known_data: dict[Candidate, Data] = {}
        self._known_shares: dict[Candidate, dict[str, float]] = {}
        self._known_cores: dict[tuple[Candidate, str], list[Optimum]] = {}
        self._known_sizes: dict[Candidate, float] = {}
        self._known_explained: dict[Candidate, bool] = {}
        self.baseline = self.finished(find_optimum(self.train, begin, *FINE_SEARCH).model, begin)
        noises = [  # of the residual: what drives the force has noise, too
            sample_noise(one.sample_times, one.measured - values[: one.part.size]) ** 2
            for one, values in zip(self.train.experiments, self.baseline.simulated)
        ]
        self.noise = math.sqrt(float(np.mean(noises)))

    def with_core(self, candidate: Candidate, name: str, most: float = math.inf) -> Candidate:
        """
        Return a candidate with another core, without effects that are in it.

        It is fitted roughly from each of the core's starts, and from the two best to the end; not where the mean square
        of what it leaves roughly is above `most`.
        """
        rough = self._roughly_with_core(candidate, name)
        promises = rough[0].cost <= most * self.excerpt.samples
        best = self._fine([one.model for one in rough[:REFINED_STARTS]]) if promises else rough[0]
        return self.finished(best.model, candidate.model)

    def roughly_left_with_core(self, candidate: Candidate, name: str) -> float:
        """Return the mean square that another core leaves of the excerpt in a candidate, fitted roughly."""
        return self._roughly_with_core(candidate, name)[0].cost / self.excerpt.samples

    def _roughly_with_core(self, candidate: Candidate, name: str) -> list[Optimum]:
        """Return rough fits from each of a core's starts, the best first; none is fitted twice."""
        if (candidate, name) not in self._known_cores:
            core = self.channel.cores[name]
            effects = {other: own for other, own in candidate.effects.items() if other not in core.covers}
            starts = core.starts(self._data(candidate))
            begins = [replace(candidate.model, core={name: start}, effects=effects) for start in starts]
            rough = map_in_threads(lambda one: find_optimum(self.excerpt, one, *ROUGH_SEARCH), begins)
            self._known_cores[candidate, name] = sorted(rough, key=lambda one: one.cost)
        return self._known_cores[candidate, name]

    def names(self, candidate: Candidate) -> list[str]:
        """Return the effects that these recordings may tell beside a candidate's."""
        return [
            name
            for name in self.channel.candidates(candidate.model)
            if self.channel.may_tell(self.train.experiments, name, candidate.model)
        ]

    def beside(self, candidate: Candidate, names: Sequence[str], most: float = math.inf) -> dict[str, Candidate]:
        """
        Return candidates with each of some effects beside those of one.

        All are fitted roughly, from every start; the more promising ones are fitted to the end, if the mean square of
        what they leave roughly is not above `most`.
        """
        return self._best(candidate, self._begins(candidate, names), most)

    def instead(self, candidate: Candidate, rivals: Mapping[str, Candidate], most: float) -> dict[str, Candidate]:
        """Do as `beside` does, from where the effects ended in other company."""
        begins = {
            name: [
                replace(model, effects={**candidate.effects, name: rival.effects[name]})
                for model in (candidate.model, rival.model)
            ]
            for name, rival in rivals.items()
        }
        return self._best(candidate, begins, most)

    def _best(self, candidate: Candidate, begins: Mapping[str, Sequence[Model]], most: float) -> dict[str, Candidate]:
        """
        Return the best fit of each of some effects beside those of a candidate, from where it may begin.

        The core and the other effects stay as they are until a fit promises much.
        """
        known = candidate.model.parts
        rough = _best_first(
            _fitted(begins, lambda one: find_optimum(self.excerpt, one, *ROUGH_SEARCH, frozen=known, passing=False))
        )
        before = self._cost_of_excerpt(candidate)
        hopeful = {name: some for name, some in rough.items() if some[0].cost <= most * self.excerpt.samples}
        promising = self._rivals(candidate, hopeful, before) if hopeful else []
        fine = map_in_threads(lambda name: self._fine(self._refined(rough[name], before)), promising)
        best = {name: some[0] for name, some in rough.items()} | dict(zip(promising, fine))
        found = [best[name].model for name in begins]
        return dict(zip(begins, map_in_threads(lambda one: self.finished(one, candidate.model), found)))

    def without(self, candidate: Candidate, *names: str) -> Candidate:
        """Return a candidate without some of its effects."""
        if not names:
            return candidate
        fewer = {other: own for other, own in candidate.effects.items() if other not in names}
        found = find_optimum(self.train, replace(candidate.model, effects=fewer), *FINE_SEARCH)
        return self.finished(found.model, candidate.model)

    def promising(self, candidate: Candidate, names: Sequence[str]) -> tuple[Sequence[str], Mapping[str, float]]:
        """Return the effects to fit beside a candidate's, and the share of its residual that each other may take."""
        if not self._is_long or len(names) <= MOST_FITTED_EFFECTS:
            return names, {}
        shares = self._shares(candidate, names)
        ranked = sorted(names, key=lambda name: -shares[name])
        return ranked[:MOST_FITTED_EFFECTS], {name: shares[name] for name in ranked[MOST_FITTED_EFFECTS:]}

    def resting_coefficients(self, candidate: Candidate) -> Array:
        """Return the autoregression of the noise at rest, as a candidate leaves it."""
        simulated = [values[: one.part.size] for one, values in zip(self.train.experiments, candidate.simulated)]
        return self.channel.noise(self.train.experiments, simulated, candidate.model).coefficients

    def size(self, candidate: Candidate) -> float:
        """Return the root mean square of what a candidate leaves of train and validation, over the noise."""
        if candidate not in self._known_sizes:
            self._known_sizes[candidate] = next(self._tests(candidate)).statistic
        return self._known_sizes[candidate]

    def leaves_noise(self, candidate: Candidate) -> bool:
        """Return whether what a candidate leaves of train and validation is as noise would be; none is tested twice."""
        if candidate not in self._known_explained:
            self._known_explained[candidate] = is_noise(self._tests(candidate))
        return self._known_explained[candidate]

    def follows_inputs(self, candidate: Candidate) -> bool:
        """Return whether what a candidate leaves depends on the inputs."""
        return any(one.name == 'inputs' and not one.passed for one in self._tests(candidate))

    def _tests(self, candidate: Candidate) -> Iterator[Test]:
        noise = self.channel.noise(self.learn.experiments, candidate.simulated, candidate.model)
        return self.learn.tested(candidate.simulated, noise, bool(candidate.model.parts))

    def finished(self, model: Model, begin: Model) -> Candidate:
        """Return a fit with what it leaves; one that ran away is as if its effects were not there."""
        simulated = self.learn.simulate(model)
        if not _is_finite(simulated):
            if model.core != begin.core:
                return self.baseline
            absent = {name: begin.effects.get(name, self.channel.effects[name].null) for name in model.effects}
            model = replace(begin, effects=absent, unknowns=model.unknowns)
            simulated = self.learn.simulate(model)
            if not _is_finite(simulated):
                return self.baseline
        residuals = self.train.residuals([own[: one.part.size] for one, own in zip(self.train.experiments, simulated)])
        errors = np.concatenate(
            [
                (values - one.measured)[one.part == PARTS.index('validation')]
                for one, values in zip(self.learn.experiments, simulated)
            ]
        )
        rmse = math.sqrt(float(np.mean(errors**2))) if errors.size else None
        return Candidate(model, simulated, residuals, rmse)

    def _rivals(self, candidate: Candidate, rough: Mapping[str, Sequence[Optimum]], before: float) -> list[str]:
        """Return the effects to fit to the end: the better half; of long recordings those that may be the best."""
        ranked = sorted(rough, key=lambda name: rough[name][0].cost)
        if not self._is_long:
            return ranked[: max(REFINED_EFFECTS, len(ranked) // 2)]
        taken = {name: 1.0 - rough[name][0].cost / before for name in rough}
        promised = self._shares(candidate, ranked)
        least = LEAST_RIVAL_DROP * max(taken.values())
        least_promised = LEAST_RIVAL_DROP * max(promised.values())
        may_be = [name for name in ranked if taken[name] >= least or promised[name] >= least_promised]
        by_promise = sorted(may_be, key=lambda name: -promised[name])  # much may do alike in an excerpt
        return list(dict.fromkeys(chain.from_iterable(zip(may_be, by_promise))))[:REFINED_EFFECTS]

    def squares(self, candidate: Candidate) -> float:
        """Return the sum of squares that a candidate leaves of train and validation."""
        return sum(float(run @ run) for run in self.learn.residuals(candidate.simulated))

    def roughly_left(self, candidate: Candidate) -> float:
        """Return the mean square that a candidate leaves of the excerpt that rough fits are of."""
        return self._cost_of_excerpt(candidate) / self.excerpt.samples

    def _cost_of_excerpt(self, candidate: Candidate) -> float:
        """Return the sum of squares that a candidate leaves of the excerpt."""
        left = self.excerpt.residuals(self.excerpt.simulate(candidate.model))
        return sum(float(run @ run) for run in left)

    def _data(self, candidate: Candidate) -> Data:
        """Return what effects draw their starting values from."""
        if candidate not in self._known_data:
            train = self.train.experiments
            simulated = [values[: one.part.size] for one, values in zip(train, candidate.simulated)]
            self._known_data[candidate] = self.channel.data(train, candidate.model, simulated)
        return self._known_data[candidate]

    def _starts(self, candidate: Candidate, names: Sequence[str]) -> dict[str, Sequence[Start]]:
        return {name: self.channel.library[name].starts(self._data(candidate)) for name in names}

    def _shares(self, candidate: Candidate, names: Sequence[str]) -> dict[str, float]:
        """Return what share of a candidate's residual each effect may take; nothing is simulated twice."""
        known = self._known_shares.setdefault(candidate, {})
        fresh = [name for name in names if name not in known]
        if fresh:
            complement = Complement(self.train, candidate.model)
            starts = self._starts(candidate, fresh)
            _ = complement.residual  # made once, before threads ask for it
            known.update(zip(fresh, map_in_threads(lambda name: complement.share(name, starts[name]), fresh)))
        return {name: known[name] for name in names}

    def _begins(self, candidate: Candidate, names: Sequence[str]) -> dict[str, list[Model]]:
        """Return where fits with one more effect begin, by its name; those of a first one at other gains, too."""
        astray = candidate.rss > self.train.samples * (LEAST_MISLEADING_RESIDUAL * self.noise) ** 2
        begins = [candidate.model] if candidate.model.parts else self.channel.beginnings(candidate.model, astray)
        return {
            name: [replace(begin, effects={**candidate.effects, name: start}) for begin in begins for start in own]
            for name, own in self._starts(candidate, names).items()
        }

    def _refined(self, rough: Sequence[Optimum], before: float) -> list[Model]:
        """Return which of rough fits to fit to the end."""
        best, *others = rough[:REFINED_STARTS]
        if self._is_long:
            others = [one for one in others if before - one.cost > LEAST_START_DROP * (before - best.cost)]
        return [one.model for one in (best, *others)]

    def _fine(self, begins: Sequence[Model]) -> Optimum:
        """Return the best fit to the end; of long recordings the steps of a long way are taken where they are cheap."""
        if self._longer_excerpt is not None:
            begins = [self._best_of(self._longer_excerpt, begins).model]
        return self._best_of(self.train, begins)

    def _best_of(self, likelihood: Likelihood, begins: Sequence[Model]) -> Optimum:
        """Return the best of fits from models."""
        return min(
            map_in_threads(lambda one: find_optimum(likelihood, one, *FINE_SEARCH), begins), key=lambda one: one.cost
        )


def _is_finite(simulated: Sequence[Array]) -> bool:
    return all(np.all(np.isfinite(values)) for values in simulated)


def _fitted(begins: Mapping[str, Sequence[Model]], fit: Callable[[Model], Optimum]) -> dict[str, list[Optimum]]:
    """Return the fits from models, by the same names; they are shared among the cores."""
    found = iter(map_in_threads(fit, [one for own in begins.values() for one in own]))
    return {name: [next(found) for _ in own] for name, own in begins.items()}


def _best_first(fits: Mapping[str, Sequence[Optimum]]) -> dict[str, list[Optimum]]:
    return {name: sorted(own, key=lambda one: one.cost) for name, own in fits.items()}
