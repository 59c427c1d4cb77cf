# SPDX-License-Identifier: Apache-2.0
"""
The cores that a model may have: the linear one, and the one with the physics that the linear one leaves out.

Models with either are proposed here and compared; `strategy` says when which is asked for.
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
    LARGEST_ALIKE_ERROR,
    LARGEST_CORE_SQUARES,
    LARGEST_ROUGH_CORE,
    LARGEST_ROUGH_EFFECT,
    LARGEST_ROUGH_RIVAL,
    TIE,
)
from cfd_pneumatic.lazy import lazy_property

_NONE: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class Cores:
    """
    Models with each core, alone and with effects; none is fitted twice.

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

    @property
    def is_chosen_here(self) -> bool:
        """Whether both cores are possible, so that the recordings choose."""
        return self._name is not None and not self._is_given

    @property
    def alone(self) -> list[Candidate]:
        """Every core that is possible, without effects."""
        if self._name is None:
            return [self.candidates.baseline]
        return [self.physical] if self._is_given else [self.candidates.baseline, self.physical]

    @property
    def tried(self) -> tuple[Trial, ...]:
        """Every effect as it was tried with the linear core alone."""
        return () if self._is_given else self._linear_step.trials()

    @property
    def single_effects(self) -> list[Candidate]:
        """The linear core with each effect alone, the best first; none if the physical core is given."""
        fits = [] if self._is_given else self._linear_step.candidates.values()
        return sorted(fits, key=lambda candidate: candidate.rss)

    @lazy_property
    def _linear_step(self) -> Step:
        """Each effect with the linear core, fitted to the end only if it may do as well as the physical core."""
        baseline, most = self.candidates.baseline, math.inf
        if self._name is not None:
            most = LARGEST_ROUGH_RIVAL * self.candidates.roughly_left_with_core(baseline, self._name)
        return self._linear.step(baseline, most)

    @lazy_property
    def physical(self) -> Candidate:
        """The physical core alone, fitted to the end only if it may do as well as the linear one with an effect."""
        assert self._name is not None
        most = math.inf
        if not self._is_given:
            best = min(self._linear_step.candidates.values(), key=lambda fit: fit.rss, default=self.candidates.baseline)
            most = self._hopeful(best)
        return self.candidates.with_core(self.candidates.baseline, self._name, most)

    def physical_to_end(self) -> Candidate | None:
        """Return the physical core alone, fitted to the end however it compares; None if the channel has none."""
        return None if self._name is None else self.candidates.with_core(self.candidates.baseline, self._name)

    def is_full_physics(self) -> bool:
        """Return whether the physical core alone leaves noise, and no effect with the linear one does as well."""
        return self.candidates.leaves_noise(self.physical) and all(
            self.prefers(self.physical, single) for single in self._linear_step.candidates.values()
        )

    def search_linear(self) -> SearchResult:
        """Return the effects that are found with the linear core."""
        return self._linear.run()

    def search_only_core(self) -> SearchResult:
        """Return the effects that are found with the core that is given, or the only one."""
        return self.search_linear() if self._name is None else self.search_physical(self.physical)

    def search_physical(self, begin: Candidate, fresh: Sequence[Candidate] = ()) -> SearchResult:
        """
        Return the effects that are found with the physical core.

        If more than noise is left with effects, the core is fitted once more from its starts: its many parameters may
        be stuck, unless the model is among those that are `fresh` from there.
        """
        assert self._name is not None
        found = Search(self.candidates, begin).run()
        if not found.model.effects or found.model in fresh or self.candidates.leaves_noise(found.model):
            return found
        again = self.candidates.with_core(found.model, self._name)
        return replace(found, model=min(found.model, again, key=lambda candidate: candidate.rss))

    def begins_after(self, linear: SearchResult, *, is_enough: bool) -> list[Candidate]:
        """Return the physical core alone, and with the effects of the linear one, fitted to the end if need be."""
        assert self._name is not None
        if not linear.model.effects:
            return [self.physical]
        most = self._hopeful(linear.model) if is_enough else math.inf
        return [self.physical, self.candidates.with_core(linear.model, self._name, most)]

    def pruned(self, candidate: Candidate) -> Candidate:
        """Return a model with the physical core without the effects that it does not need."""
        return Search(self.candidates, self.physical).pruned(candidate)

    def curve_before_core(self, curves: CurveSearch, known: Sequence[Candidate]) -> FittedCurve | None:
        """Return a curve with the physical core, which is fitted with the curve: see `Laws.beside_core`."""
        if self._name is None or self._is_given:
            return None
        return curves.beside_core(self.physical, self.candidates.baseline, self._name, known)

    def rivals(self, curve: FittedCurve) -> list[Candidate]:
        """
        Return single effects in a curve's place.

        They begin with the core as it is with the curve: a core that was fitted without either is astray.
        """
        model = curve.candidate.model
        there = self.candidates.finished(replace(model, effects=curve.begin.effects), curve.begin.model)
        names, _ = self.candidates.promising(there, self.candidates.names(there))
        most = LARGEST_ROUGH_EFFECT * self.candidates.roughly_left(curve.candidate)
        return list(self.candidates.beside(there, names, most).values())

    def prefers(
        self, physical: Candidate, linear: Candidate, alternatives: Mapping[str, tuple[str, ...]] = _NONE
    ) -> bool:
        """
        Return whether a model with the physical core is preferred to one with the linear core.

        It is if the validation part prefers it, and either the criterion or both parts together do. A tie is enough,
        and the core's own parameters, which data sheets have, do not count, if the core holds the effects that it
        replaces or their `alternatives`. The same holds if the physical core leaves noise, and the linear one needs
        several effects or leaves more than noise.
        """
        if not physical.model.core:  # its fit ran away
            return False
        candidates, train = self.candidates, self.candidates.train
        errors = physical.validation_rmse, linear.validation_rmse
        predicts_better = errors[0] is not None and errors[1] is not None and errors[0] < errors[1]
        squares = candidates.squares(physical), candidates.squares(linear)
        if predicts_better and squares[0] < LARGEST_CORE_SQUARES * squares[1]:
            return True
        (core,) = (candidates.channel.effects[name] for name in physical.model.core)
        replaced = set(linear.effects) - set(physical.effects)
        is_held = bool(replaced) and all({name, *alternatives.get(name, ())} & set(core.covers) for name in replaced)
        needs_several = len(linear.effects) > max(len(physical.effects), 1)
        is_instead = is_held or (
            (needs_several or not candidates.leaves_noise(linear)) and candidates.leaves_noise(physical)
        )
        charged = physical.unknowns - (len(core.parameters) if is_instead else 0)
        coefficients = autoregression(min((physical, linear), key=lambda model: model.rss).residuals)
        criterion, criterion_of_linear = (
            train.criterion(model.residuals, unknowns, coefficients)
            for model, unknowns in ((physical, charged), (linear, linear.unknowns))
        )
        if is_instead:
            return criterion < criterion_of_linear + TIE and squares[0] < LARGEST_ALIKE_ERROR**2 * squares[1]
        return (predicts_better or None in errors) and criterion < criterion_of_linear

    def _hopeful(self, model: Candidate) -> float:
        """Return the mean square above which a rough fit will not come to do as well as a model that leaves noise."""
        if not self.candidates.leaves_noise(model):
            return math.inf
        return LARGEST_ROUGH_CORE * self.candidates.roughly_left(model)
