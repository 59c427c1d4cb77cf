# SPDX-License-Identifier: Apache-2.0
"""
Order of the questions that find what a model lacks.

This module decides; `cores`, `curve_search` and `stepwise` propose models and score them.

1. Does the residual of the linear core look like noise? Then the search only decides about the core. Autocorrelated
   noise may come from the sensor, or from physics that no test of the inputs detects.
2. Does a curve with a core alone reduce the residual to noise, and no single effect comes near? This question comes
   before effects are combined, because combining takes longest if no combination is the answer.
3. Which core, and which effects? The core comes first, because full physics is not a missing effect. It is tried with a
   single effect before the linear core gets several, because several effects can imitate the physical core. The linear
   core keeps what it explains as well as the physical core.
4. Does a curve explain more? It may if the residual is not noise. It also may if several effects were found, because
   several effects can imitate a single curve.
5. If not, the effects are the answer. If they leave much more than noise, the best curve may be shown as a hypothesis.

The search does not see the test part. Only `confirm`, which the caller gives, does if a curve is to be the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.residual import is_noise
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.cores import Cores
from cfd_pneumatic.identification.search.curve_search import VALVE_CURVE, CurveSearch, FittedCurve
from cfd_pneumatic.identification.search.final_fit import finish, withdraw_trials
from cfd_pneumatic.identification.search.stepwise import SearchResult, Trial
from cfd_pneumatic.identification.search.thresholds import CURVE_SHARE, EFFECT_SHARE, EFFORT_NEAR_NOISE, LARGE_RESIDUAL

_CURVE_INSTEAD = 'replaced by an estimated curve'

Confirm = Callable[[FittedCurve, Model | None], Fit | None]
"""
Returns the fit of a curve to train and validation; None if the test part contradicts it or prefers the model.

Without a model the curve is only a hypothesis, and None means that the fit diverged.
"""


class Answer(NamedTuple):
    """
    What a model lacks.

    Attributes
    ----------
    fit
        Fit of the complete model to train and validation.
    alternatives
        For each effect the effects that the recordings do not distinguish from it.
    tried
        Every effect that was tried.
    curve
        The curve that is part of the answer, or None.

    """

    fit: Fit
    alternatives: Mapping[str, tuple[str, ...]]
    tried: tuple[Trial, ...]
    curve: FittedCurve | None


class Strategy:
    """
    Asks the questions in order; an earlier answer can make a later question unnecessary.

    Parameters
    ----------
    before
        Fit of a channel's linear model without effects to train and validation.
    core
        One of `Options.core`.
    confirm
        See `Confirm`.

    """

    def __init__(self, before: Fit, core: str, confirm: Confirm) -> None:
        self.before = before
        self._effort = before.likelihood.effort
        self.candidates = Candidates(before.likelihood, before.model)
        self.cores = Cores(self.candidates, core)
        self.curves = CurveSearch(self.candidates)
        self._confirm_curve = confirm
        self._equivalent: list[Candidate] = []  # models with an effect that fit as well as a curve

    def find_answer(self, *, is_noise: bool) -> Answer:
        """Return what the model lacks; `is_noise`: whether the residual of the linear core looks like noise."""
        if is_noise:
            result = self._core_for_autocorrelated_noise()
        else:
            if self._is_near_noise():
                self._effort.extend(EFFORT_NEAR_NOISE)
            with self._effort.share(CURVE_SHARE):
                curve = self._curve_instead_of_effects()
            fit = None if curve is None else self._confirm(curve, self.before.model)
            if fit is not None:
                return Answer(fit, {}, self.cores.tried, curve)
            with self._effort.share(EFFECT_SHARE):
                result = self._core_and_effects()
        finish_result = cache(partial(self._finish, result))
        with_curve = self._curve_after_effects(result, lambda: finish_result()[0])
        if with_curve is None and not is_noise and not _is_explained(finish_result()[0]):
            with_curve = self._hypothesis(result)
        return Answer(*finish_result(), None) if with_curve is None else with_curve

    def _finish(self, result: SearchResult) -> tuple[Fit, Mapping[str, tuple[str, ...]], tuple[Trial, ...]]:
        with self._effort.lifted():
            return finish(self.before, result)

    def _confirm(self, curve: FittedCurve, rival: Model | None) -> Fit | None:
        with self._effort.lifted():
            return self._confirm_curve(curve, rival)

    def _hypothesis(self, result: SearchResult) -> Answer | None:
        """Return the best curve as a hypothesis if it explains much more than a result that leaves more than noise."""
        curve = self.curves.find_hypothesis(result.model)
        fit = None if curve is None else self._confirm(curve, None)
        return None if fit is None else self._with_curve(result, fit, curve)

    def _with_curve(self, result: SearchResult, fit: Fit, curve: FittedCurve | None) -> Answer:
        """Return a fit with a curve as the answer; the curve replaces effects of a result."""
        kept = {name: rivals for name, rivals in result.alternatives.items() if name in fit.model.effects}
        replaced = {trial.effect for trial in result.tried} - fit.model.effects.keys()
        return Answer(fit, kept, withdraw_trials(result.tried, replaced, _CURVE_INSTEAD), curve)

    def _core_for_autocorrelated_noise(self) -> SearchResult:
        """Return the physical core if it removes the autocorrelation; otherwise the linear core."""
        baseline, physical = self.candidates.baseline, self.cores.fit_physical_to_end()
        if (
            physical is not None
            and self.candidates.has_noise_residual(physical)
            and self.cores.is_preferred(physical, baseline)
        ):
            return SearchResult(physical, {}, ())
        return SearchResult(baseline, {}, ())

    def _curve_instead_of_effects(self) -> FittedCurve | None:
        """Return a curve that reaches the noise with a core alone; None if a single effect comes near the curve."""
        if self.cores.is_chosen_here and self.cores.is_full_physics():
            return None
        singles = self.cores.single_effects
        if any(self.curves.is_noise(single) for single in singles[:1]):
            return None
        cores = self.cores.models_without_effects
        if not any(self.curves.is_promising(core) for core in cores):
            return None
        curve = self.curves.fit_best_curve(cores, singles) or self.cores.fit_curve_with_core(self.curves, singles)
        if curve is None or curve.name == VALVE_CURVE:
            return None
        rivals = self.cores.fit_rivals(curve)
        near = [rival for rival in rivals if self.curves.is_near(curve, rival)]
        self._equivalent = sorted((rival for rival in near if rival.model.core), key=self.candidates.sum_of_squares)[:1]
        is_answer = self.candidates.has_noise_residual(curve.candidate)
        is_answer = is_answer or self.curves.is_far_better(curve, [*singles, *rivals])
        return curve if is_answer and not near else None

    def _is_near_noise(self) -> bool:
        """Return whether a core, alone or with a single effect, leaves a small residual."""
        models = [*self.cores.models_without_effects, *self.cores.single_effects[:1]]
        return min(map(self.candidates.residual_ratio, models)) < LARGE_RESIDUAL

    def _core_and_effects(self) -> SearchResult:
        """Search the core that the recordings need, and effects with this core."""
        cores = self.cores
        if not cores.is_chosen_here:
            return cores.search_only_core()
        if cores.is_full_physics():
            return SearchResult(cores.physical, {}, ())
        # first a single effect: the physical core makes effects unnecessary that imitate the core
        single = self._with_physical_core(cores.search_linear(most=1), LARGE_RESIDUAL)
        linear = cores.search_linear()
        if single.model.model.core and self.candidates.has_noise_residual(single.model):
            is_preferred = cores.is_preferred(single.model, linear.model, linear.alternatives)
            return single if is_preferred else linear
        several = self._with_physical_core(linear)
        return min((several, single), key=lambda result: self.candidates.residual_ratio(result.model))

    def _with_physical_core(self, linear: SearchResult, largest: float = math.inf) -> SearchResult:
        """
        Return the better of a result with the linear core and of searches with the physical core.

        Effects are searched with the physical core if this core leaves at most a `largest` residual
        [standard deviations of the noise].
        """
        cores = self.cores
        is_enough = self.candidates.has_noise_residual(linear.model) and len(linear.model.effects) <= 1
        bases = cores.bases_after(linear, is_enough=is_enough)
        if is_enough and not any(cores.is_preferred(base, linear.model, linear.alternatives) for base in bases):
            return linear  # the linear core with a single effect explains the recordings
        if min(map(self.candidates.residual_ratio, bases)) > largest:
            return linear
        base, physical = self._search_from(bases, fresh=[] if is_enough else bases)
        if not cores.is_preferred(physical.model, linear.model, linear.alternatives):
            return linear
        known = {name: rivals for name, rivals in linear.alternatives.items() if name in base.effects}
        return SearchResult(physical.model, {**known, **physical.alternatives}, linear.tried + physical.tried)

    def _search_from(self, bases: Sequence[Candidate], fresh: Sequence[Candidate]) -> tuple[Candidate, SearchResult]:
        """Return the model at which the best search with the physical core began, and the search's result."""
        bases = [bases[0], *map(self.cores.prune, bases[1:]), *self._equivalent]
        base, *further = sorted(bases, key=lambda candidate: candidate.rss)
        if self.candidates.has_noise_residual(base):
            result = SearchResult(base, {}, ())
        else:
            result = self.cores.search_physical(base, fresh)
        for start in further:
            # A large residual may mean that the search began at a wrong model.
            is_large = self.candidates.residual_ratio(result.model) > LARGE_RESIDUAL
            if is_large and self._effort.allows('effects with the physical core from a further start'):
                again = self.cores.search_physical(start, fresh)
                base, result = min((base, result), (start, again), key=lambda pair: pair[1].model.rss)
        return base, result

    def _curve_after_effects(self, result: SearchResult, fit_result: Callable[[], Fit]) -> Answer | None:
        """Return a curve that explains more than a result; None if there is none. `fit_result` fits it finally."""
        is_explained = self.candidates.has_noise_residual(result.model) or _is_explained(fit_result())
        is_noise = is_explained and self.curves.is_noise(result.model)
        has_several = len(result.model.effects) > 1
        if is_noise and not has_several:
            return None
        for curve in self._curves_after_effects(result, is_noise=is_noise):
            if curve is None:
                continue
            is_simpler = has_several and not curve.base.effects  # a single curve instead of several effects
            if is_explained and not is_simpler and self.curves.is_near(curve, result.model):
                continue
            fit = self._confirm(curve, result.model.model)
            if fit is None:
                return None
            return self._with_curve(result, fit, curve)
        return None

    def _curves_after_effects(self, result: SearchResult, *, is_noise: bool) -> Iterator[FittedCurve | None]:
        """
        Yield curves to compare with the search result, in this order.

        1. A curve with a core alone: the effects may only have compensated for the missing curve.
        2. A curve with the physical core, both fitted together.
        3. A curve with the effects that were found.
        4. A curve with effects that are searched again together with the curve.
        """
        known = [result.model]
        yield self.curves.fit_best_curve(self.cores.models_without_effects, known, is_after_search=True)
        if is_noise:
            return
        yield self.cores.fit_curve_with_core(self.curves, known)
        yield self.curves.fit_best_curve([result.model], known)
        if not self.candidates.channel.cores:
            yield self.curves.fit_with_effects(self.candidates.baseline, known)


def _is_explained(fit: Fit) -> bool:
    """Return whether the residual of a fit to train and validation is noise."""
    return is_noise(fit.likelihood.tests(fit.model, fit.likelihood.noise(fit.model)))
