# SPDX-License-Identifier: Apache-2.0
"""
Stepwise search for the effects that a model lacks, judged by the residual; for any channel and any effects.

1. Fit each effect in addition to the model, to the train part. Add the best effect that is worth its parameters:
   by the Bayesian information criterion of the whitened residual, the error on the validation part, and the drop of the
   residual's sum of squares. Repeat.
2. Remove effects that are no longer needed.
3. Try each effect against its rivals.

The search does not see the test part.
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
    EXPECTED_CORE_EVALUATIONS,
    EXPECTED_EFFECT_EVALUATIONS,
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
_OUTDONE = 'also improves the fit, but less than the selected effect'
_UNPROMISING = 'not fitted: the predicted drop is at most this large'


@dataclass(frozen=True)
class Trial:
    """
    An effect that was tried.

    Attributes
    ----------
    effect
        Name of the effect.
    delta_bic
        Fall of the criterion with the effect; None if the effect was not fitted.
    rss_drop
        Share of the train part's sum of squares that the effect explains; the predicted limit if it was not fitted.
    validation_rmse
        Error on the validation part with the effect [Pa or N]; None if there is no such part or no fit.
    accepted
        Whether the effect was added.
    why
        Reason for adding the effect, or for not adding it.
    present_effects
        Effects that the model had already.

    """

    effect: str
    delta_bic: float | None
    rss_drop: float
    validation_rmse: float | None
    accepted: bool
    why: str
    present_effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class SearchResult:
    """
    Result of a search for effects.

    Attributes
    ----------
    model
        Model with the effects that were found.
    alternatives
        For each effect the effects that the recordings do not distinguish from it, at most two.
    tried
        Every effect that was tried, in the order of the search.

    """

    model: Candidate
    alternatives: Mapping[str, tuple[str, ...]]
    tried: tuple[Trial, ...]


@dataclass(frozen=True)
class Step:
    """
    Trials of every effect in addition to a model.

    Attributes
    ----------
    candidates
        Model with each effect, by its name.
    ranked
        Names of the effects, the best first.
    leads
        Best effects that are worth their parameters, by either criterion; empty if there are none.
    tried
        Trial of each effect, before an effect is chosen.

    """

    candidates: Mapping[str, Candidate]
    ranked: Sequence[str]
    leads: tuple[str, ...]
    tried: Mapping[str, Trial]

    def trials(self, chosen: str | None = None) -> tuple[Trial, ...]:
        """Return all trials; the chosen effect is marked as accepted."""
        accepted = replace(self.tried[chosen], accepted=True, why='lowers the criterion most') if chosen else None
        not_fitted = sorted(set(self.tried) - set(self.ranked), key=lambda name: -self.tried[name].rss_drop)
        names = [*self.ranked, *not_fitted]
        return tuple(accepted if accepted and name == chosen else self.tried[name] for name in names)

    def rivals(self, name: str) -> dict[str, Candidate]:
        """Return the candidates with the best further effects, by the effect's name."""
        rivals = [rival for rival in self.ranked if rival != name][:MOST_RIVALS]
        return {rival: self.candidates[rival] for rival in rivals}


class Search:
    """
    Stepwise search for missing effects.

    Parameters
    ----------
    candidates
        Fits models with effects.
    base
        Model at which the search begins.

    """

    def __init__(self, candidates: Candidates, base: Candidate) -> None:
        self.candidates = candidates
        self.base = base
        self._likelihood = candidates.train
        self._accepted: dict[tuple[str, ...], Candidate] = {}
        self._tried: dict[tuple[str, ...], Candidate] = {}

    def criterion(self, model: Candidate, coefficients: Array) -> float:
        """Return the Bayesian information criterion of a model, whitened by an autoregression."""
        return self._likelihood.criterion(model.residuals, model.unknowns, coefficients)

    def criterion_drop_for_coloured_noise(self, model: Candidate, candidate: Candidate) -> float:
        """Return the fall of the criterion with a candidate, if its noise at rest is autocorrelated."""
        added_unknowns = candidate.unknowns - model.unknowns
        return self._likelihood.criterion_drop_for_coloured_noise(
            model.rss, candidate.rss, added_unknowns, self.candidates.noise_autoregression(candidate)
        )

    def run(self, most: int = MOST_EFFECTS) -> SearchResult:
        """
        Add at most some effects, remove effects that are no longer needed, and try each effect against its rivals.

        The first effect decides about all later effects. If the criteria of the plain and the whitened residual
        disagree about it, the search continues from both.
        """
        model = self.base
        self._accepted[tuple(model.effects)] = model
        if len(model.effects) >= min(most, self._most_effects(model)):
            return SearchResult(model, {}, ())
        effort = self.candidates.effort
        if model.model.core and not effort.allows('effects with the physical core', self._trial_effort(model)):
            return SearchResult(model, {}, ())
        first = self.try_effects(model)
        results = [
            self._search_from(first, lead, most)
            for rank, lead in enumerate(first.leads)
            if not rank or effort.allows(f'a search that begins with {lead}')
        ]
        if not results:
            return SearchResult(model, {}, first.trials())
        best = results[0]
        for result in results[1:]:
            if result.model.rss < (1.0 - LEAST_LARGE_DROP) * best.model.rss:
                best = result
        return best

    def _search_from(self, step: Step, lead: str, most: int) -> SearchResult:
        """Return the result of the search that begins with a lead."""
        trials: tuple[Trial, ...] = ()
        ranking: dict[str, dict[str, Candidate]] = {}
        while True:
            trials += step.trials(lead)
            ranking[lead] = step.rivals(lead)
            model = self.prune(step.candidates[lead])
            self._accepted[tuple(model.effects)] = model
            is_small = self.candidates.residual_ratio(model) <= LARGEST_SMALL_RESIDUAL
            is_explained = is_small and self.candidates.has_noise_residual(model)
            if len(model.effects) >= min(most, self._most_effects(model)) or is_explained or lead not in model.effects:
                break
            question = f'effects in addition to {" and ".join(model.model.parts)}'
            if not self.candidates.effort.allows(question, self._trial_effort(model)):
                break
            step = self.try_effects(model)
            if not step.leads:
                trials += step.trials()
                break
            lead = step.leads[0]
        if not self.candidates.effort.allows(f'rivals of {" and ".join(model.effects)}'):
            return SearchResult(model, {}, trials)
        model, alternatives = self.challenge(model, ranking)
        return SearchResult(model, alternatives, trials)

    def _trial_effort(self, model: Candidate) -> float:
        """Return the effort that a trial of every effect is expected to take [simulated steps]."""
        return EXPECTED_EFFECT_EVALUATIONS * self._likelihood.effort_of(model.model)

    def _most_effects(self, model: Candidate) -> int:
        return MOST_EFFECTS if model.validation_rmse is not None else MOST_UNVALIDATED_EFFECTS

    def try_effects(self, model: Candidate, limit: float = math.inf) -> Step:
        """Try every effect in addition to a model; rough fits with a mean square above `limit` are not continued."""
        core = 'physical' if model.model.core else 'linear'
        added = ''.join(f' and {name}' for name in model.effects)
        self.candidates.effort.ask(f'effects with the {core} core{added}', self.candidates.residual_ratio(model))
        chosen, unpromising = self.candidates.screen_effects(model, self.candidates.possible_effects(model))
        candidates = self._add_effects(model, chosen, limit)
        candidates |= self._add_effects(model, self._related_effects(candidates, unpromising), limit)
        coefficients = autoregression(min((*candidates.values(), model), key=lambda fit: fit.rss).residuals)
        before, reference = self.criterion(model, coefficients), model.validation_rmse
        criteria = {name: self.criterion(candidate, coefficients) for name, candidate in candidates.items()}
        present = tuple(model.effects)
        trials = {
            name: Trial(name, None, share, None, False, _UNPROMISING, present) for name, share in unpromising.items()
        }
        objections: dict[str, str | None] = {}
        for name, candidate in candidates.items():
            gain = min(before - criteria[name], self.criterion_drop_for_coloured_noise(model, candidate))
            drop = 1.0 - candidate.rss / model.rss
            validation = candidate.validation_rmse
            reason = objection(gain, drop, len(model.effects), validation, reference)
            largest_drop = max(drop, _squared_error_drop(validation, reference))
            is_small = model.model.parts and largest_drop < LEAST_LARGE_DROP
            if reason is None and is_small:
                reason = self._objection_to_small_drop(candidate)
            objections[name] = reason
            trials[name] = Trial(name, gain, max(drop, 0.0), validation, False, reason or _OUTDONE, present)
        ranked = sorted(candidates, key=lambda name: self.criterion(candidates[name], _WHITE))
        worthy = [name for name in ranked if objections[name] is None]
        leads = [*sorted(worthy, key=lambda name: criteria[name])[:1], *worthy[:1]]
        leads = list(dict.fromkeys(_best_predicting(lead, worthy, candidates) for lead in leads))
        return Step(candidates, ranked, tuple(leads), trials)

    def _related_effects(self, candidates: Mapping[str, Candidate], names: Collection[str]) -> list[str]:
        """Return the effects of the best effect's families, if the best effect ends at a bound."""
        if not names:
            return []
        effects = self.candidates.channel.effects
        best = effects[min(candidates, key=lambda name: candidates[name].rss)]
        is_at_bound = best.ends_at_bound(candidates[best.name].effects.get(best.name, best.null))  # null if it diverged
        return [name for name in names if is_at_bound and set(best.families) & set(effects[name].families)]

    def _objection_to_small_drop(self, candidate: Candidate) -> str | None:
        """Return why an effect of small drop is not worth adding to effects or a core; None if it is."""
        reason = f'explains less than {100 * LEAST_LARGE_DROP:.0f} % of the residual'
        if candidate.model.core:
            return f'{reason}; a change of the core parameters might too'
        return (
            None
            if self.candidates.has_noise_residual(candidate)
            else f'{reason}; the remaining error exceeds the noise'
        )

    def _add_effects(self, model: Candidate, names: Sequence[str], limit: float) -> dict[str, Candidate]:
        """Return a model with each of some effects added, by the effect's name; the fits are cached."""
        keys = {name: (*model.effects, name) for name in names}
        fresh = [name for name in names if keys[name] not in self._tried]
        if fresh:
            fits = self.candidates.add_effects(model, fresh, limit)
            self._tried.update({keys[name]: candidate for name, candidate in fits.items()})
        return {name: self._tried[keys[name]] for name in names if keys[name] in self._tried}

    def _without_effect(self, model: Candidate, name: str) -> Candidate:
        """
        Return a model without an effect: fitted again, or as it was before the effect was added.

        The fit of the core may have improved only together with the effect. That improvement does not count for the
        effect.
        """
        known = self._accepted.get(tuple(effect for effect in model.effects if effect != name))
        if known is not None and not model.model.core:
            return known
        reduced = self.candidates.without_effects(model, name)
        return reduced if known is None or reduced.rss < known.rss else known

    def prune(self, model: Candidate) -> Candidate:
        """Return a model without effects that are no longer needed; the last effect stays with the linear core."""
        names = list(model.effects)
        names = names if model.model.core else names[:-1]
        steps = len(names) * EXPECTED_CORE_EVALUATIONS * self._likelihood.effort_of(model.model)
        if model.model.core and names and not self.candidates.effort.allows('the model without each effect', steps):
            return model
        coefficients, rank = autoregression(model.residuals), len(model.effects) - 1
        for reduced in map_in_threads(lambda name: self._without_effect(model, name), names):
            gain = self.criterion(reduced, coefficients) - self.criterion(model, coefficients)
            if objection(gain, 1.0 - model.rss / reduced.rss, rank, model.validation_rmse, math.inf) is not None:
                return self.prune(reduced)
        return model

    def _fit_rivals(
        self, model: Candidate, ranking: Mapping[str, Mapping[str, Candidate]], name: str
    ) -> dict[str, Candidate]:
        """Return a model with each rival instead of an effect, by the rival's name; the fits are cached."""
        rivals = {rival: candidate for rival, candidate in ranking.get(name, {}).items() if rival not in model.effects}
        base = self._without_effect(model, name)
        keys = {rival: (*base.effects, rival) for rival in rivals}
        known = {rival: self._tried[key] for rival, key in keys.items() if key in self._tried}
        fresh = {rival: candidate for rival, candidate in rivals.items() if rival not in known}
        limit = LARGEST_ROUGH_RIVAL * self.candidates.rough_mean_square(model)
        return {**known, **self.candidates.add_rivals(base, fresh, limit)} if fresh else known

    def challenge(
        self, model: Candidate, ranking: Mapping[str, Mapping[str, Candidate]]
    ) -> tuple[Candidate, Mapping[str, tuple[str, ...]]]:
        """Try rivals instead of each effect; return the best model, and for each effect the rivals that fit as well."""
        for _ in range(RIVAL_ROUNDS):
            coefficients = autoregression(model.residuals)
            criterion, has_more = self.criterion(model, coefficients), not self.candidates.has_noise_residual(model)
            alternatives: dict[str, tuple[str, ...]] = {}
            better: tuple[float, Candidate] | None = None
            for name, rivals in zip(
                model.effects, map_in_threads(partial(self._fit_rivals, model, ranking), model.effects)
            ):
                gains = {
                    rival: criterion - self.criterion(candidate, coefficients) for rival, candidate in rivals.items()
                }
                ties = [rival for rival in gains if gains[rival] > -TIE]
                if has_more:
                    ties += [rival for rival, candidate in rivals.items() if predicts_as_well(candidate, model)]
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


def _best_predicting(lead: str, worthy: Sequence[str], candidates: Mapping[str, Candidate]) -> str:
    """Return the effect that predicts the validation part clearly better than a lead; the lead if there is none."""
    errors = {
        name: candidate.validation_rmse
        for name, candidate in candidates.items()
        if candidate.validation_rmse is not None
    }
    best = min(worthy, key=lambda name: errors.get(name, math.inf))
    return best if lead in errors and LARGEST_ALIKE_ERROR * errors[best] < errors[lead] else lead


def predicts_as_well(rival: Candidate, model: Candidate) -> bool:
    """Return whether a rival predicts the validation part as well as a model; without this part, the train part."""
    if rival.validation_rmse is None or model.validation_rmse is None:
        return rival.rss < LARGEST_ALIKE_ERROR**2 * model.rss
    return rival.validation_rmse < LARGEST_ALIKE_ERROR * model.validation_rmse


def _squared_error_drop(error: float | None, reference: float | None) -> float:
    """Return the relative fall of a squared error; 0 if an error is not known."""
    return 0.0 if error is None or reference is None else 1.0 - (error / reference) ** 2


def objection(gain: float, drop: float, rank: int, validation: float | None, reference: float | None) -> str | None:
    """Return why an effect is not worth adding to `rank` effects; None if it is."""
    if gain <= (LEAST_CRITERION_DROP if validation is not None else LEAST_UNVALIDATED_CRITERION_DROP):
        return 'not worth its parameters'
    if drop < LEAST_DROPS[min(rank, 1)]:
        return f'explains less than {100 * LEAST_DROPS[min(rank, 1)]:.0f} % of the residual'
    if validation is not None and reference is not None and validation >= reference:
        return 'no better on the validation part'
    return None
