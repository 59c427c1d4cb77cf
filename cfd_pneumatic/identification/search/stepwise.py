# SPDX-License-Identifier: Apache-2.0
"""
Which effects a model lacks, judged by the residual: one search, whatever the model and the effects are of.

Every effect is fitted beside the model to the train part; the best that is worth its parameters is added, and so on.
What is worth it: the Bayesian information criterion of the whitened residual, the error on the validation part, the
drop of the residual's sum of squares. Then effects that are not needed any more are taken out, and each is tried
against its rivals. The test part is never looked at.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual import autoregression
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.thresholds import (
    LARGEST_ALIKE_ERROR,
    LARGEST_ROUGH_RIVAL,
    LARGEST_SMALL_RESIDUAL,
    LEAST_CRITERION_DROP,
    LEAST_DROPS,
    LEAST_LARGE_DROP,
    LEAST_RIVAL_ADVANTAGE,
    LEAST_UNVALIDATED_CRITERION_DROP,
    MOST_ALTERNATIVES,
    MOST_EFFECTS,
    MOST_RIVALS,
    MOST_UNVALIDATED_EFFECTS,
    RIVAL_ROUNDS,
    TIE,
)
from cfd_pneumatic.runtime import map_in_threads

_WHITE = np.empty(0)  # coefficients of white noise
_OUTDONE = 'worth it, but another lowers the criterion more'
_UNPROMISING = 'not fitted: as far as small changes tell, it takes no more than that'


@dataclass(frozen=True)
class Trial:
    """
    One effect that was tried.

    Attributes
    ----------
    effect
        Its name.
    delta_bic
        By how much it lowers the criterion; None where it was not fitted.
    rss_drop
        Share of the train part's sum of squares that it takes; at most, where it was not fitted.
    validation_rmse
        Error on the validation part with it [Pa or N]; None where there is no such part or it was not fitted.
    accepted
        Whether it was added.
    why
        Why, or why not.
    beside
        Effects that the model had already.

    """

    effect: str
    delta_bic: float | None
    rss_drop: float
    validation_rmse: float | None
    accepted: bool
    why: str
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class SearchResult:
    """
    Effects that were found.

    Attributes
    ----------
    model
        The model with them.
    alternatives
        For each effect those that the data can't tell from it, at most two.
    tried
        Every effect that was tried, in the order of the search.

    """

    model: Candidate
    alternatives: Mapping[str, tuple[str, ...]]
    tried: tuple[Trial, ...]


@dataclass(frozen=True)
class Step:
    """
    Every effect tried beside a model.

    Attributes
    ----------
    candidates
        The model with each.
    ranked
        Their names, the best first.
    leads
        Those that are worth it and the best, by either criterion; empty where none is worth it.
    tried
        What came of each, before one is chosen.

    """

    candidates: Mapping[str, Candidate]
    ranked: Sequence[str]
    leads: tuple[str, ...]
    tried: Mapping[str, Trial]

    def trials(self, chosen: str | None = None) -> tuple[Trial, ...]:
        """Return what came of each, one of them chosen."""
        accepted = replace(self.tried[chosen], accepted=True, why='lowers the criterion most') if chosen else None
        others = sorted(set(self.tried) - set(self.ranked), key=lambda name: -self.tried[name].rss_drop)
        names = [*self.ranked, *others]
        return tuple(accepted if accepted and name == chosen else self.tried[name] for name in names)

    def rivals(self, name: str) -> dict[str, Candidate]:
        """Return the best of the others, as they were fitted here."""
        others = [other for other in self.ranked if other != name][:MOST_RIVALS]
        return {other: self.candidates[other] for other in others}


class Search:
    """
    The search for missing effects.

    Parameters
    ----------
    candidates
        Fits models with effects.
    begin
        The model without any.

    """

    def __init__(self, candidates: Candidates, begin: Candidate) -> None:
        self.candidates = candidates
        self.begin = begin
        self._likelihood = candidates.train
        self._accepted: dict[tuple[str, ...], Candidate] = {}
        self._tried: dict[tuple[str, ...], Candidate] = {}

    def criterion(self, model: Candidate, coefficients: Array) -> float:
        """Return the Bayesian information criterion of a model, whitened by an autoregression."""
        return self._likelihood.criterion(model.residuals, model.unknowns, coefficients)

    def evidence(self, model: Candidate, candidate: Candidate) -> float:
        """Return by how much a candidate lowers the criterion where noise as it leaves at rest counts for less."""
        more = candidate.unknowns - model.unknowns
        return self._likelihood.criterion_drop_for_coloured_noise(
            model.rss, candidate.rss, more, self.candidates.resting_coefficients(candidate)
        )

    def run(self) -> SearchResult:
        """
        Add what is worth it, take out what is not needed any more, and try each effect against its rivals.

        The first effect leads all others. Where it depends on whether the residual is whitened which one is best, each
        is followed to the end.
        """
        model = self.begin
        self._accepted[tuple(model.effects)] = model
        if len(model.effects) >= self._most(model):
            return SearchResult(model, {}, ())
        first = self.step(model)
        found = [self._followed(first, lead) for lead in first.leads]
        if not found:
            return SearchResult(model, {}, first.trials())
        best = found[0]
        for other in found[1:]:
            if other.model.rss < (1.0 - LEAST_LARGE_DROP) * best.model.rss:
                best = other
        return best

    def _followed(self, step: Step, lead: str) -> SearchResult:
        """Return what is found after a first effect."""
        trials: tuple[Trial, ...] = ()
        ranking: dict[str, dict[str, Candidate]] = {}
        while True:
            trials += step.trials(lead)
            ranking[lead] = step.rivals(lead)
            model = self.pruned(step.candidates[lead])
            self._accepted[tuple(model.effects)] = model
            is_small = self.candidates.size(model) <= LARGEST_SMALL_RESIDUAL and self.candidates.leaves_noise(model)
            if len(model.effects) >= self._most(model) or is_small or lead not in model.effects:
                break
            step = self.step(model)
            if not step.leads:
                trials += step.trials()
                break
            lead = step.leads[0]
        model, alternatives = self.challenged(model, ranking)
        return SearchResult(model, alternatives, trials)

    def _most(self, model: Candidate) -> int:
        """Return how many effects a model may have."""
        return MOST_EFFECTS if model.validation_rmse is not None else MOST_UNVALIDATED_EFFECTS

    def step(self, model: Candidate, most: float = math.inf) -> Step:
        """Try every effect beside a model, to the end where the mean square of what is left roughly is up to `most`."""
        chosen, others = self.candidates.promising(model, self.candidates.names(model))
        candidates = self._beside(model, chosen, most)
        candidates |= self._beside(model, self._going_on(candidates, others), most)
        coefficients = autoregression(min((*candidates.values(), model), key=lambda one: one.rss).residuals)
        before, reference = self.criterion(model, coefficients), model.validation_rmse
        criteria = {name: self.criterion(one, coefficients) for name, one in candidates.items()}
        beside = tuple(model.effects)
        trials = {name: Trial(name, None, part, None, False, _UNPROMISING, beside) for name, part in others.items()}
        objections: dict[str, str | None] = {}
        for name, candidate in candidates.items():
            gain = min(before - criteria[name], self.evidence(model, candidate))
            drop = 1.0 - candidate.rss / model.rss
            validation = candidate.validation_rmse
            reason = objection(gain, drop, len(model.effects), validation, reference)
            most = max(drop, _dropped(validation, reference))
            little = model.model.parts and most < LEAST_LARGE_DROP
            if reason is None and little:
                reason = self._too_little(candidate)
            objections[name] = reason
            trials[name] = Trial(name, gain, drop, validation, False, reason or _OUTDONE, beside)
        ranked = sorted(candidates, key=lambda name: self.criterion(candidates[name], _WHITE))
        worthy = [name for name in ranked if objections[name] is None]
        leads = [*sorted(worthy, key=lambda name: criteria[name])[:1], *worthy[:1]]
        leads = list(dict.fromkeys(_foretelling(one, worthy, candidates) for one in leads))
        return Step(candidates, ranked, tuple(leads), trials)

    def _going_on(self, candidates: Mapping[str, Candidate], others: Collection[str]) -> list[str]:
        """Return which other effects may go on where the best one ends at a bound: those of its families."""
        if not others:
            return []
        effects = self.candidates.channel.effects
        best = effects[min(candidates, key=lambda name: candidates[name].rss)]
        at_bound = best.ends_at_bound(candidates[best.name].effects.get(best.name, best.null))  # none where it ran away
        return [name for name in others if at_bound and set(best.families) & set(effects[name].families)]

    def _too_little(self, candidate: Candidate) -> str | None:
        """Return why an effect that takes little beside others or a core is not worth adding, or None."""
        least = f'takes less than {100 * LEAST_LARGE_DROP:.0f} %'
        if candidate.model.core:
            return f'{least}, as the numbers of the core might'
        return None if self.candidates.leaves_noise(candidate) else f'{least}, and more than noise is left'

    def _beside(self, model: Candidate, names: Sequence[str], most: float) -> dict[str, Candidate]:
        """Return a model with one more effect, for each of some names that may tell; none is fitted twice."""
        keys = {name: (*model.effects, name) for name in names}
        fresh = [name for name in names if keys[name] not in self._tried]
        if fresh:
            found = self.candidates.beside(model, fresh, most)
            self._tried.update({keys[name]: candidate for name, candidate in found.items()})
        return {name: self._tried[keys[name]] for name in names if keys[name] in self._tried}

    def _rest(self, model: Candidate, name: str) -> Candidate:
        """
        Return a model with one effect less, as it was before that one was added if it was the last.

        A core's many numbers may have found a better place only beside the effect, which is not to its credit.
        """
        known = self._accepted.get(tuple(other for other in model.effects if other != name))
        if known is not None and not model.model.core:
            return known
        fewer = self.candidates.without(model, name)
        return fewer if known is None or fewer.rss < known.rss else known

    def pruned(self, model: Candidate) -> Candidate:
        """Return a model without the effects that it does not need any more; the last one only beside a core."""
        names = list(model.effects)
        names = names if model.model.core else names[:-1]
        coefficients, rank = autoregression(model.residuals), len(model.effects) - 1
        for fewer in map_in_threads(lambda name: self._rest(model, name), names):
            gain = self.criterion(fewer, coefficients) - self.criterion(model, coefficients)
            if objection(gain, 1.0 - model.rss / fewer.rss, rank, model.validation_rmse, math.inf) is not None:
                return self.pruned(fewer)
        return model

    def _rivals(
        self, model: Candidate, ranking: Mapping[str, Mapping[str, Candidate]], name: str
    ) -> dict[str, Candidate]:
        """Return a model with each of an effect's rivals in its place; what was fitted already is not fitted again."""
        others = {rival: one for rival, one in ranking.get(name, {}).items() if rival not in model.effects}
        rest = self._rest(model, name)
        keys = {rival: (*rest.effects, rival) for rival in others}
        known = {rival: self._tried[key] for rival, key in keys.items() if key in self._tried}
        fresh = {rival: one for rival, one in others.items() if rival not in known}
        most = LARGEST_ROUGH_RIVAL * self.candidates.roughly_left(model)
        return {**known, **self.candidates.instead(rest, fresh, most)} if fresh else known

    def challenged(
        self, model: Candidate, ranking: Mapping[str, Mapping[str, Candidate]]
    ) -> tuple[Candidate, Mapping[str, tuple[str, ...]]]:
        """Try rivals in each effect's place; return the best model, and for each effect those that do as well."""
        for _ in range(RIVAL_ROUNDS):
            coefficients = autoregression(model.residuals)
            own, more_is_left = self.criterion(model, coefficients), not self.candidates.leaves_noise(model)
            alternatives: dict[str, tuple[str, ...]] = {}
            better: tuple[float, Candidate] | None = None
            for name, rivals in zip(
                model.effects, map_in_threads(partial(self._rivals, model, ranking), model.effects)
            ):
                gains = {rival: own - self.criterion(one, coefficients) for rival, one in rivals.items()}
                ties = [rival for rival in gains if gains[rival] > -TIE]
                if more_is_left:
                    ties += [rival for rival, one in rivals.items() if alike(one, model)]
                ties = sorted(set(ties), key=lambda rival: -gains[rival])
                alternatives[name] = tuple(ties[:MOST_ALTERNATIVES])
                if ties and gains[ties[0]] > (better[0] if better else LEAST_RIVAL_ADVANTAGE):
                    better = gains[ties[0]], rivals[ties[0]]
            if better is None:
                return model, alternatives
            (replaced,) = set(model.effects) - set(better[1].effects)
            newcomer = list(better[1].effects)[-1]
            ranking = {**ranking, newcomer: {replaced: model, **ranking.get(replaced, {})}}
            model = better[1]
        return model, alternatives


def _foretelling(lead: str, worthy: Sequence[str], candidates: Mapping[str, Candidate]) -> str:
    """Return the effect that foretells the validation part best, where it does so better than the lead."""
    errors = {name: one.validation_rmse for name, one in candidates.items() if one.validation_rmse is not None}
    best = min(worthy, key=lambda name: errors.get(name, math.inf))
    return best if lead in errors and LARGEST_ALIKE_ERROR * errors[best] < errors[lead] else lead


def alike(rival: Candidate, own: Candidate) -> bool:
    """Return whether a rival is as good on data that it was not fitted to; without such data, nearly so on its own."""
    if rival.validation_rmse is None or own.validation_rmse is None:
        return rival.rss < LARGEST_ALIKE_ERROR**2 * own.rss
    return rival.validation_rmse < LARGEST_ALIKE_ERROR * own.validation_rmse


def _dropped(error: float | None, reference: float | None) -> float:
    """Return the share by which an error's square lies below another's; 0 where either is not known."""
    return 0.0 if error is None or reference is None else 1.0 - (error / reference) ** 2


def objection(gain: float, drop: float, rank: int, validation: float | None, reference: float | None) -> str | None:
    """Return why an effect is not worth adding to `rank` others, or None."""
    if gain <= (LEAST_CRITERION_DROP if validation is not None else LEAST_UNVALIDATED_CRITERION_DROP):
        return 'not worth its parameters'
    if drop < LEAST_DROPS[min(rank, 1)]:
        return f'takes less than {100 * LEAST_DROPS[min(rank, 1)]:.0f} % of the residual'
    if validation is not None and reference is not None and validation >= reference:
        return 'no better on the validation part'
    return None
