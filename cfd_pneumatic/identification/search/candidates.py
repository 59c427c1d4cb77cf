# SPDX-License-Identifier: Apache-2.0
"""Candidate models: fits with an effect more or less, first rough fits from every start, then fits to the end."""

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
from cfd_pneumatic.model import Data, Effect
from cfd_pneumatic.runtime import map_in_threads


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    A model with some effects, fitted to the train part.

    Attributes
    ----------
    model
        Fitted values.
    simulated
        Simulation of the train and validation parts [SI].
    residuals
        Residuals of the train part, weighted.
    validation_rmse
        Error on the validation part [SI]; None if there is no such part.

    """

    model: Model
    simulated: list[Array]
    residuals: list[Array]
    validation_rmse: float | None

    @property
    def effects(self) -> Effects:
        """Return the effects, in the order in which they were added."""
        return self.model.effects

    @property
    def rss(self) -> float:
        """Return the residuals' sum of squares."""
        return float(sum(residual @ residual for residual in self.residuals))

    @property
    def unknowns(self) -> int:
        """Return the count of fitted numbers."""
        return self.model.unknowns


class Candidates:
    """
    Fits candidates for the model of a channel.

    Parameters
    ----------
    likelihood
        Likelihood of all samples before the test part.
    start
        Model without effects, fitted to these samples.

    """

    def __init__(self, likelihood: Likelihood, start: Model) -> None:
        self.channel = likelihood.channel
        self.effort = likelihood.effort
        train, representative = likelihood.until('train'), likelihood.representative()
        self.train_validation = representative.until('validation')
        self.train = representative.until('train')
        self.excerpt = train.excerpt(ROUGH_EXCERPT_STEPS)
        self._is_long = self.train.steps > LONGEST_UNSCREENED
        self._known_data: dict[Candidate, Data] = {}
        self._known_shares: dict[Candidate, dict[str, float]] = {}
        self._known_cores: dict[tuple[Candidate, str], list[Optimum]] = {}
        self._known_ratios: dict[Candidate, float] = {}
        self._known_verdicts: dict[Candidate, bool] = {}
        self.baseline = self.to_candidate(find_optimum(self.train, start, *FINE_SEARCH).model, start)
        variances = [  # of the residual, because the inputs of the force have noise in addition
            sample_noise(experiment.sample_times, experiment.measured - values[: experiment.part.size]) ** 2
            for experiment, values in zip(self.train.experiments, self.baseline.simulated)
        ]
        self.noise = math.sqrt(float(np.mean(variances)))

    def with_core(self, candidate: Candidate, name: str, limit: float = math.inf) -> Candidate:
        """
        Return a candidate with a different core, without the effects that the core covers.

        The fit is rough from each of the core's starts. The best starts are fitted to the end if the mean square of
        the best rough fit is at most `limit`.
        """
        rough = self._rough_fits_with_core(candidate, name)
        is_promising = rough[0].cost <= limit * self.excerpt.samples
        best = self._fit_to_end(rough[:REFINED_STARTS]) if is_promising else rough[0]
        return self.to_candidate(best.model, candidate.model)

    def rough_mean_square_with_core(self, candidate: Candidate, name: str) -> float:
        """Return the mean squared residual on the excerpt after a rough fit with a different core."""
        return self._rough_fits_with_core(candidate, name)[0].cost / self.excerpt.samples

    def _rough_fits_with_core(self, candidate: Candidate, name: str) -> list[Optimum]:
        """Return rough fits from each of a core's starts, the best first; the fits are cached."""
        if (candidate, name) not in self._known_cores:
            core = self.channel.cores[name]
            effects = {effect: values for effect, values in candidate.effects.items() if effect not in core.covers}
            starts = core.starts(self._start_data(candidate))
            models = [replace(candidate.model, core={name: start}, effects=effects) for start in starts]
            rough = map_in_threads(lambda model: find_optimum(self.excerpt, model, *ROUGH_SEARCH), models)
            self._known_cores[candidate, name] = sorted(rough, key=lambda fit: fit.cost)
        return self._known_cores[candidate, name]

    def possible_effects(self, candidate: Candidate) -> list[str]:
        """Return the names of effects that a candidate lacks and that these recordings may determine."""
        return [
            name
            for name in self.channel.candidates(candidate.model)
            if self.channel.may_tell(self.train.experiments, name, candidate.model)
        ]

    def add_effects(self, base: Candidate, names: Sequence[str], limit: float = math.inf) -> dict[str, Candidate]:
        """
        Add each of some effects to a candidate; return a candidate for each effect, by its name.

        All are fitted roughly, from every start. The more promising effects are fitted to the end if the mean square
        of their rough fit is at most `limit`.
        """
        return self._fit_best(base, self._starts_with_effects(base, names), limit)

    def add_rivals(self, base: Candidate, rivals: Mapping[str, Candidate], limit: float) -> dict[str, Candidate]:
        """Add effects as `add_effects` does, with the parameters that they have in the rival candidates as starts."""
        starts = {
            name: [
                replace(model, effects={**base.effects, name: rival.effects[name]})
                for model in (base.model, rival.model)
            ]
            for name, rival in rivals.items()
        }
        return self._fit_best(base, starts, limit)

    def _fit_best(self, base: Candidate, starts: Mapping[str, Sequence[Model]], limit: float) -> dict[str, Candidate]:
        """
        Return the best fit of each added effect, from its starts.

        Core and present effects are frozen in the rough fits, unless they and the added effect are of the command.
        """
        effects = self.channel.effects
        rough = _sort_by_cost(
            _fit_all(
                starts,
                lambda model: find_optimum(
                    self.excerpt, model, *ROUGH_SEARCH, frozen=_present_effects(base, model, effects), passing=False
                ),
            )
        )
        before = self._excerpt_squares(base)
        within_limit = {name: fits for name, fits in rough.items() if fits[0].cost <= limit * self.excerpt.samples}
        refined = self._effects_to_refine(base, within_limit, before) if within_limit else []
        fine = map_in_threads(lambda name: self._fit_to_end(self._fits_to_refine(rough[name], before)), refined)
        best = {name: fits[0] for name, fits in rough.items()} | dict(zip(refined, fine))

        def candidate(name: str) -> Candidate:
            return self._not_worse(base, name, self.to_candidate(best[name].model, base.model), name in refined)

        return dict(zip(starts, map_in_threads(candidate, starts)))

    def _not_worse(self, base: Candidate, effect: str, candidate: Candidate, is_refined: bool) -> Candidate:
        """Return a candidate that fits no worse than its base: otherwise the base, fitted again with the effect."""
        if candidate.rss <= base.rss or effect not in self.channel.library:
            return candidate
        null = replace(base.model, effects={**base.effects, effect: self.channel.effects[effect].null})
        nested = [find_optimum(self.train, null, 1.0, 1)]  # sums without a step
        if is_refined:
            starts = [replace(model, effects=null.effects) for model in self.channel.beginnings(base.model, True)]
            nested.append(self._best_fit(self.train, starts))
        return self.to_candidate(min(nested, key=lambda fit: fit.cost).model, base.model)

    def without_effects(self, candidate: Candidate, *names: str) -> Candidate:
        """Return a candidate, fitted again without some of its effects."""
        if not names:
            return candidate
        kept = {effect: values for effect, values in candidate.effects.items() if effect not in names}
        optimum = self._fit(self.train, replace(candidate.model, effects=kept))
        return self.to_candidate(optimum.model, candidate.model)

    def screen_effects(self, base: Candidate, names: Sequence[str]) -> tuple[Sequence[str], Mapping[str, float]]:
        """Return the effects to fit, and for each further effect the share of the residual that it can explain."""
        if not self._is_long or len(names) <= MOST_FITTED_EFFECTS or self._is_astray(base):
            return names, {}
        shares = self._explained_shares(base, names)
        ranked = sorted(names, key=lambda name: -shares[name])
        return ranked[:MOST_FITTED_EFFECTS], {name: shares[name] for name in ranked[MOST_FITTED_EFFECTS:]}

    def noise_autoregression(self, candidate: Candidate) -> Array:
        """Return the autoregression coefficients of a candidate's residual at rest."""
        simulated = [
            values[: experiment.part.size] for experiment, values in zip(self.train.experiments, candidate.simulated)
        ]
        return self.channel.noise(self.train.experiments, simulated, candidate.model).coefficients

    def residual_ratio(self, candidate: Candidate) -> float:
        """Return the root mean square of the residual of train and validation part [standard deviations of noise]."""
        if candidate not in self._known_ratios:
            self._known_ratios[candidate] = next(self._tests(candidate)).statistic
        return self._known_ratios[candidate]

    def has_noise_residual(self, candidate: Candidate) -> bool:
        """Return whether a candidate's residual on train and validation part is noise; the verdict is cached."""
        if candidate not in self._known_verdicts:
            self._known_verdicts[candidate] = is_noise(self._tests(candidate))
        return self._known_verdicts[candidate]

    def has_input_dependence(self, candidate: Candidate) -> bool:
        """Return whether a candidate's residual depends on the inputs."""
        return any(test.name == 'inputs' and not test.passed for test in self._tests(candidate))

    def _tests(self, candidate: Candidate) -> Iterator[Test]:
        noise = self.channel.noise(self.train_validation.experiments, candidate.simulated, candidate.model)
        return self.train_validation.tested(candidate.simulated, noise, bool(candidate.model.parts))

    def to_candidate(self, model: Model, base: Model) -> Candidate:
        """Return a fitted model as a candidate; a model that diverges gets the effects of `base`."""
        simulated = self.train_validation.simulate(model)
        if not _is_finite(simulated):
            if model.core != base.core:
                return self.baseline
            effects = {name: base.effects.get(name, self.channel.effects[name].null) for name in model.effects}
            model = replace(base, effects=effects, unknowns=model.unknowns)
            simulated = self.train_validation.simulate(model)
            if not _is_finite(simulated):
                return self.baseline
        residuals = self.train.residuals(
            [values[: experiment.part.size] for experiment, values in zip(self.train.experiments, simulated)]
        )
        errors = np.concatenate(
            [
                (values - experiment.measured)[experiment.part == PARTS.index('validation')]
                for experiment, values in zip(self.train_validation.experiments, simulated)
            ]
        )
        rmse = math.sqrt(float(np.mean(errors**2))) if errors.size else None
        return Candidate(model, simulated, residuals, rmse)

    def _effects_to_refine(self, base: Candidate, rough: Mapping[str, Sequence[Optimum]], before: float) -> list[str]:
        """Return the effects to fit to the end: the better half; of long recordings the effects that may be best."""
        ranked = sorted(rough, key=lambda name: rough[name][0].cost)
        if not self._is_long:
            return ranked[: max(REFINED_EFFECTS, len(ranked) // 2)]
        drops = {name: 1.0 - rough[name][0].cost / before for name in rough}
        predicted = self._explained_shares(base, ranked)
        least_drop = LEAST_RIVAL_DROP * max(drops.values())
        least_predicted = LEAST_RIVAL_DROP * max(predicted.values())
        by_drop = [name for name in ranked if drops[name] >= least_drop or predicted[name] >= least_predicted]
        by_prediction = sorted(by_drop, key=lambda name: -predicted[name])  # an excerpt may not distinguish effects
        return list(dict.fromkeys(chain.from_iterable(zip(by_drop, by_prediction))))[:REFINED_EFFECTS]

    def sum_of_squares(self, candidate: Candidate) -> float:
        """Return the sum of squared residuals of a candidate on train and validation part."""
        return sum(float(run @ run) for run in self.train_validation.residuals(candidate.simulated))

    def rough_mean_square(self, candidate: Candidate) -> float:
        """Return the mean squared residual of a candidate on the excerpt of rough fits."""
        return self._excerpt_squares(candidate) / self.excerpt.samples

    def _excerpt_squares(self, candidate: Candidate) -> float:
        residuals = self.excerpt.residuals(self.excerpt.simulate(candidate.model))
        return sum(float(run @ run) for run in residuals)

    def _is_astray(self, base: Candidate) -> bool:
        """Return whether a model without core and effects errs so much that its gains may be wrong."""
        return not base.model.parts and base.rss > self.train.samples * (LEAST_MISLEADING_RESIDUAL * self.noise) ** 2

    def _start_data(self, candidate: Candidate) -> Data:
        """Return the data from which effects compute their starting values."""
        if candidate not in self._known_data:
            train = self.train.experiments
            simulated = [values[: experiment.part.size] for experiment, values in zip(train, candidate.simulated)]
            self._known_data[candidate] = self.channel.data(train, candidate.model, simulated)
        return self._known_data[candidate]

    def _starts(self, candidate: Candidate, names: Sequence[str]) -> dict[str, Sequence[Start]]:
        return {name: self.channel.library[name].starts(self._start_data(candidate)) for name in names}

    def _explained_shares(self, candidate: Candidate, names: Sequence[str]) -> dict[str, float]:
        """Return the share of a candidate's squared residual that each effect can explain; the shares are cached."""
        known = self._known_shares.setdefault(candidate, {})
        fresh = [name for name in names if name not in known]
        if fresh:
            complement = Complement(self.train, candidate.model)
            starts = self._starts(candidate, fresh)
            _ = complement.residual  # computed before the threads start, so that it is computed once
            known.update(zip(fresh, map_in_threads(lambda name: complement.explained_share(name, starts[name]), fresh)))
        return {name: known[name] for name in names}

    def _starts_with_effects(self, base: Candidate, names: Sequence[str]) -> dict[str, list[Model]]:
        """Return the models from which fits with an added effect start, by the effect's name."""
        models = [base.model]
        if not base.model.parts:
            models = self.channel.beginnings(base.model, self._is_astray(base))
        return {
            name: [replace(model, effects={**base.effects, name: start}) for model in models for start in starts]
            for name, starts in self._starts(base, names).items()
        }

    def _fits_to_refine(self, rough: Sequence[Optimum], before: float) -> list[Optimum]:
        """Return the rough fits that are continued to the end."""
        best, *further = rough[:REFINED_STARTS]
        if self._is_long:
            further = [fit for fit in further if before - fit.cost > LEAST_START_DROP * (before - best.cost)]
        return [best, *further]

    def _fit_to_end(self, rough: Sequence[Optimum]) -> Optimum:
        """Return the best fit to the end; a long train part is first fitted on an excerpt, to save time."""
        starts = [fit.model for fit in rough]
        if 2 * self.excerpt.steps < self.train.steps:
            starts = [self._best_fit(self.excerpt, starts).model]
        return self._best_fit(self.train, starts)

    def _best_fit(self, likelihood: Likelihood, starts: Sequence[Model]) -> Optimum:
        return min(map_in_threads(lambda model: self._fit(likelihood, model), starts), key=lambda fit: fit.cost)

    def _fit(self, likelihood: Likelihood, start: Model) -> Optimum:
        return find_optimum(likelihood, start, *FINE_SEARCH, noise=self.noise)


def _present_effects(base: Candidate, model: Model, effects: Mapping[str, Effect]) -> list[str]:
    """
    Return core and effects of a base that keep their parameters while an effect is added to it.

    A dead time and a lag of the command are nearly equal. One of them alone takes the place of both, so that it has to
    become smaller while the second one is added.
    """
    is_of_command = any(effects[name].is_of_command for name in model.effects.keys() - base.effects.keys())
    return [name for name in base.model.parts if not (is_of_command and effects[name].is_of_command)]


def _is_finite(simulated: Sequence[Array]) -> bool:
    return all(np.all(np.isfinite(values)) for values in simulated)


def _fit_all(starts: Mapping[str, Sequence[Model]], fit: Callable[[Model], Optimum]) -> dict[str, list[Optimum]]:
    """Fit all models in parallel; return the fits by the names of the starts."""
    fits = iter(map_in_threads(fit, [model for models in starts.values() for model in models]))
    return {name: [next(fits) for _ in models] for name, models in starts.items()}


def _sort_by_cost(fits: Mapping[str, Sequence[Optimum]]) -> dict[str, list[Optimum]]:
    return {name: sorted(optima, key=lambda fit: fit.cost) for name, optima in fits.items()}
