# SPDX-License-Identifier: Apache-2.0
"""
Cores of a model: the linear core, and the physical core with physics that the linear core neglects.

This module fits models with either core and compares them; `strategy` decides when.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from cfd_pneumatic.identification.data import LINEAR, PHYSICAL
from cfd_pneumatic.identification.residual import autoregression
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.curve_search import CurveSearch, FittedCurve
from cfd_pneumatic.identification.search.stepwise import Search, SearchResult, Step, Trial
from cfd_pneumatic.identification.search.thresholds import (
    EXPECTED_CORE_EVALUATIONS,
    LARGEST_ALIKE_ERROR,
    LARGEST_CORE_SQUARES,
    LARGEST_ROUGH_CORE,
    LARGEST_ROUGH_EFFECT,
    LARGEST_ROUGH_RIVAL,
    MOST_EFFECTS,
    TIE,
)
from cfd_pneumatic.lazy import lazy_property

_NONE: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class Cores:
    """
    Fits models with each core, alone and with effects; the fits are cached.

    Parameters
    ----------
    candidates
        Fits models.
    core
        One of `Options.core`.

    """

    def __init__(self, candidates: Candidates, core: str) -> None:
        names = list(candidates.channel.cores)
        self.candidates = candidates
        self._name = names[0] if names and core != LINEAR else None
        self._is_given = self._name is not None and core == PHYSICAL
        self._linear = Search(candidates, candidates.baseline)
        self._known_bases: dict[Candidate, Candidate] = {}
        self._known_results: dict[Candidate, SearchResult] = {}

    @property
    def is_chosen_here(self) -> bool:
        """Whether both cores are possible; the recordings then decide between them."""
        return self._name is not None and not self._is_given

    @property
    def models_without_effects(self) -> list[Candidate]:
        """Return a model without effects for each possible core."""
        if self._name is None:
            return [self.candidates.baseline]
        return [self.physical] if self._is_given else [self.candidates.baseline, self.physical]

    @property
    def tried(self) -> tuple[Trial, ...]:
        """Return the trials of every effect with the linear core alone."""
        return () if self._is_given else self._linear_step.trials()

    @property
    def single_effects(self) -> list[Candidate]:
        """Return models with the linear core and one effect, the best first; none if the physical core is given."""
        fits = [] if self._is_given else self._linear_step.candidates.values()
        return sorted(fits, key=lambda candidate: candidate.rss)

    @lazy_property
    def _linear_step(self) -> Step:
        """Try each effect with the linear core; continue rough fits only if they may compete with the physical core."""
        baseline, limit = self.candidates.baseline, math.inf
        if self._name is not None:
            limit = LARGEST_ROUGH_RIVAL * self.candidates.rough_mean_square_with_core(baseline, self._name)
        return self._linear.try_effects(baseline, limit)

    @lazy_property
    def physical(self) -> Candidate:
        """Fit the physical core alone; continue the rough fit only if it may compete with linear core and effect."""
        assert self._name is not None
        limit = math.inf
        if not self._is_given:
            best = min(self._linear_step.candidates.values(), key=lambda fit: fit.rss, default=self.candidates.baseline)
            limit = self._rough_limit(best)
        return self.candidates.with_core(self.candidates.baseline, self._name, limit)

    def fit_physical_to_end(self) -> Candidate | None:
        """Fit the physical core alone to the end; return None if the channel has no such core."""
        return None if self._name is None else self.candidates.with_core(self.candidates.baseline, self._name)

    def is_full_physics(self) -> bool:
        """Return whether the physical core alone explains the recordings and is preferred to every single effect."""
        return self.candidates.has_noise_residual(self.physical) and all(
            self.is_preferred(self.physical, single) for single in self._linear_step.candidates.values()
        )

    def search_linear(self, most: int = MOST_EFFECTS) -> SearchResult:
        """Search at most some effects with the linear core."""
        return self._linear.run(most)

    def search_only_core(self) -> SearchResult:
        """Search effects with the core that is given, or with the only core of the channel."""
        return self.search_linear() if self._name is None else self.search_physical(self.physical)

    def search_physical(self, base: Candidate, fresh: Sequence[Candidate] = ()) -> SearchResult:
        """
        Search effects with the physical core, from a model with this core.

        The core is fitted again from its starts if the residual with effects is not noise: its many parameters may be
        stuck. Models in `fresh` were just fitted from these starts.
        """
        if base not in self._known_results:
            self._known_results[base] = self._search_physical(base, fresh)
        return self._known_results[base]

    def _search_physical(self, base: Candidate, fresh: Sequence[Candidate]) -> SearchResult:
        assert self._name is not None
        result = Search(self.candidates, base).run()
        if not result.model.effects or result.model in fresh or self.candidates.has_noise_residual(result.model):
            return result
        if not self.candidates.effort.allows(f'the physical core again with {" and ".join(result.model.effects)}'):
            return result
        again = self.candidates.with_core(result.model, self._name)
        return replace(result, model=min(result.model, again, key=lambda candidate: candidate.rss))

    def bases_after(self, linear: SearchResult, *, is_enough: bool) -> list[Candidate]:
        """Return the physical core alone, and with the effects of the linear core; `is_enough` allows rough fits."""
        assert self._name is not None
        if not linear.model.effects:
            return [self.physical]
        steps = EXPECTED_CORE_EVALUATIONS * self.candidates.train.effort_of(self.physical.model)
        if not self.candidates.effort.allows(f'the physical core with {" and ".join(linear.model.effects)}', steps):
            return [self.physical]
        limit = self._rough_limit(linear.model) if is_enough else math.inf
        if linear.model not in self._known_bases:
            self._known_bases[linear.model] = self.candidates.with_core(linear.model, self._name, limit)
        return [self.physical, self._known_bases[linear.model]]

    def prune(self, candidate: Candidate) -> Candidate:
        """Return a model with the physical core without effects that are not needed."""
        return Search(self.candidates, self.physical).prune(candidate)

    def fit_curve_with_core(self, curves: CurveSearch, known: Sequence[Candidate]) -> FittedCurve | None:
        """Return a curve with the physical core, both fitted together: see `CurveSearch.fit_with_new_core`."""
        if self._name is None or self._is_given:
            return None
        return curves.fit_with_new_core(self.physical, self.candidates.baseline, self._name, known)

    def fit_rivals(self, curve: FittedCurve) -> list[Candidate]:
        """
        Return models with a single effect instead of a curve.

        The fits start with the core that was fitted with the curve. A core without curve and effect was misled.
        """
        model = curve.candidate.model
        base = self.candidates.to_candidate(replace(model, effects=curve.base.effects), curve.base.model)
        names, _ = self.candidates.screen_effects(base, self.candidates.possible_effects(base))
        limit = LARGEST_ROUGH_EFFECT * self.candidates.rough_mean_square(curve.candidate)
        return list(self.candidates.add_effects(base, names, limit).values())

    def is_preferred(
        self, physical: Candidate, linear: Candidate, alternatives: Mapping[str, tuple[str, ...]] = _NONE
    ) -> bool:
        """
        Return whether a model with the physical core is preferred to a model with the linear core.

        The physical core has to predict the validation part better, and to be better by the criterion or by both parts
        together. A tie is enough if the core covers the effects that it replaces, or their `alternatives`. A tie is
        also enough if the residual of only the physical core is noise, or if the linear core needs several effects for
        it. At a tie the core's parameters, which data sheets have, do not count.
        """
        if not physical.model.core:  # its fit diverged
            return False
        candidates, train = self.candidates, self.candidates.train
        errors = physical.validation_rmse, linear.validation_rmse
        predicts_better = errors[0] is not None and errors[1] is not None and errors[0] < errors[1]
        squares = candidates.sum_of_squares(physical), candidates.sum_of_squares(linear)
        if predicts_better and squares[0] < LARGEST_CORE_SQUARES * squares[1]:
            return True
        (core,) = (candidates.channel.effects[name] for name in physical.model.core)
        replaced = set(linear.effects) - set(physical.effects)
        is_covered = bool(replaced) and all({name, *alternatives.get(name, ())} & set(core.covers) for name in replaced)
        needs_several = len(linear.effects) > max(len(physical.effects), 1)
        is_tie_enough = is_covered or (
            (needs_several or not candidates.has_noise_residual(linear)) and candidates.has_noise_residual(physical)
        )
        charged = physical.unknowns - (len(core.parameters) if is_tie_enough else 0)
        coefficients = autoregression(min((physical, linear), key=lambda model: model.rss).residuals)
        criterion, criterion_of_linear = (
            train.criterion(model.residuals, unknowns, coefficients)
            for model, unknowns in ((physical, charged), (linear, linear.unknowns))
        )
        if is_tie_enough:
            return criterion < criterion_of_linear + TIE and squares[0] < LARGEST_ALIKE_ERROR**2 * squares[1]
        return (predicts_better or None in errors) and criterion < criterion_of_linear

    def _rough_limit(self, model: Candidate) -> float:
        """Return the mean square above which a rough fit of the core is not continued, given a competing model."""
        if not self.candidates.has_noise_residual(model):
            return math.inf
        return LARGEST_ROUGH_CORE * self.candidates.rough_mean_square(model)
