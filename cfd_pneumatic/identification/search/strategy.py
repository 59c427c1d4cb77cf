# SPDX-License-Identifier: Apache-2.0
"""
The order of the questions that find what a model lacks.

This module decides; `cores`, `curve_search` and `stepwise` propose models and score them.

1. Does the residual of the linear core look like noise? Then only the core is asked about: sensors have autocorrelated
   noise, and so has physics that no test of the inputs names.
2. Does a curve with a core alone leave noise, and no single effect comes near? This question comes before effects are
   combined, because combining takes longest where no combination is the answer.
3. Which core, and which effects? Full physics is no missing effect, so that the core is asked about first. The linear
   core keeps what it explains as well as the physical core.
4. Does a curve explain more than that? It may if more than noise is left. It also may if several effects were found,
   because several effects can imitate a single curve.
5. If not, the effects are the answer.

The search does not see the test part. `confirm`, which the caller gives, does if a curve is to be the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.residual import is_noise
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.cores import Cores
from cfd_pneumatic.identification.search.curve_search import OF_VALVES, CurveSearch, FittedCurve
from cfd_pneumatic.identification.search.final_fit import finish, withdrawn
from cfd_pneumatic.identification.search.stepwise import SearchResult, Trial
from cfd_pneumatic.identification.search.thresholds import LARGE_RESIDUAL

_CURVE_INSTEAD = 'a law was drawn instead'

Confirm = Callable[[FittedCurve, Model], 'Fit | None']
"""Returns the fit of a curve to train and validation; None if the test part contradicts it or prefers the model."""


class Answer(NamedTuple):
    """
    What a model lacks.

    Attributes
    ----------
    fit
        Of the model with that, to train and validation.
    alternatives
        For each effect those that the recordings cannot tell from it.
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
    The questions, each asked only if the answers before it leave it open.

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
        self.candidates = Candidates(before.likelihood, before.model)
        self.cores = Cores(self.candidates, core)
        self.curves = CurveSearch(self.candidates)
        self._confirm = confirm
        self._equivalent: list[Candidate] = []  # models with an effect that does as well as a curve

    def answer(self, *, is_noise: bool) -> Answer:
        """Return what the model lacks; `is_noise` tells whether the residual of the linear core looks like noise."""
        if is_noise:
            found = self._core_for_autocorrelated_noise()
        else:
            curve = self._curve_instead_of_effects()
            fit = None if curve is None else self._confirm(curve, self.before.model)
            if fit is not None:
                return Answer(fit, {}, self.cores.tried, curve)
            found = self._core_and_effects()
        finished = cache(partial(finish, self.before, found))
        with_curve = self._curve_after_effects(found, lambda: finished()[0])
        return Answer(*finished(), None) if with_curve is None else with_curve

    def _core_for_autocorrelated_noise(self) -> SearchResult:
        """Return the physical core if it takes the autocorrelation away; else the linear one."""
        baseline, physical = self.candidates.baseline, self.cores.physical_to_end()
        if physical is not None and self.candidates.leaves_noise(physical) and self.cores.prefers(physical, baseline):
            return SearchResult(physical, {}, ())
        return SearchResult(baseline, {}, ())

    def _curve_instead_of_effects(self) -> FittedCurve | None:
        """Return a curve that leaves noise with a core alone, or hardly more, where no single effect comes near it."""
        if self.cores.is_chosen_here and self.cores.is_full_physics():
            return None
        singles = self.cores.single_effects
        if any(self.curves.is_noise(single) for single in singles[:1]):
            return None
        if not any(self.curves.may_explain(core) for core in self.cores.alone):
            return None
        curve = self.curves.best(self.cores.alone, singles) or self.cores.curve_before_core(self.curves, singles)
        if curve is None or curve.name == OF_VALVES:
            return None
        rivals = self.cores.rivals(curve)
        near = [rival for rival in rivals if self.curves.is_near(curve, rival)]
        self._equivalent = sorted((rival for rival in near if rival.model.core), key=self.candidates.squares)[:1]
        is_answer = self.candidates.leaves_noise(curve.candidate)
        is_answer = is_answer or self.curves.is_far_better(curve, [*singles, *rivals])
        return curve if is_answer and not near else None

    def _core_and_effects(self) -> SearchResult:
        """Return the core that the recordings need, and the effects that were found with it."""
        cores = self.cores
        if not cores.is_chosen_here:
            return cores.search_only_core()
        if cores.is_full_physics():
            return SearchResult(cores.physical, {}, ())
        linear = cores.search_linear()
        is_enough = self.candidates.leaves_noise(linear.model) and len(linear.model.effects) <= 1
        begins = cores.begins_after(linear, is_enough=is_enough)
        if is_enough and not any(cores.prefers(begin, linear.model, linear.alternatives) for begin in begins):
            return linear  # what the linear core explains with one effect is not looked for elsewhere
        begin, physical = self._search_from(begins, fresh=[] if is_enough else begins)
        if not cores.prefers(physical.model, linear.model, linear.alternatives):
            return linear
        known = {name: rivals for name, rivals in linear.alternatives.items() if name in begin.effects}
        return SearchResult(physical.model, {**known, **physical.alternatives}, linear.tried + physical.tried)

    def _search_from(self, begins: Sequence[Candidate], fresh: Sequence[Candidate]) -> tuple[Candidate, SearchResult]:
        """Return where the best search with the physical core began, and its result."""
        begins = [begins[0], *map(self.cores.pruned, begins[1:]), *self._equivalent]
        begin, *others = sorted(begins, key=lambda candidate: candidate.rss)
        if self.candidates.leaves_noise(begin):
            found = SearchResult(begin, {}, ())
        else:
            found = self.cores.search_physical(begin, fresh)
        for other in others:
            if self.candidates.size(found.model) > LARGE_RESIDUAL:  # the way there may have led astray
                again = self.cores.search_physical(other, fresh)
                begin, found = min((begin, found), (other, again), key=lambda pair: pair[1].model.rss)
        return begin, found

    def _curve_after_effects(self, found: SearchResult, finished: Callable[[], Fit]) -> Answer | None:
        """Return a curve that explains more than what was found; None if there is none. `finished` is its final fit."""
        leaves_noise = self.candidates.leaves_noise(found.model) or _is_explained(finished())
        is_noise = leaves_noise and self.curves.is_noise(found.model)
        has_several = len(found.model.effects) > 1
        if is_noise and not has_several:
            return None
        for curve in self._curves_after_effects(found, is_noise=is_noise):
            if curve is None:
                continue
            is_plainer = has_several and not curve.begin.effects  # a single curve instead of several effects
            if leaves_noise and not is_plainer and self.curves.is_near(curve, found.model):
                continue
            fit = self._confirm(curve, found.model.model)
            if fit is None:
                return None
            kept = {name: rivals for name, rivals in found.alternatives.items() if name in fit.model.effects}
            replaced = {trial.effect for trial in found.tried} - fit.model.effects.keys()
            return Answer(fit, kept, withdrawn(found.tried, replaced, _CURVE_INSTEAD), curve)
        return None

    def _curves_after_effects(self, found: SearchResult, *, is_noise: bool) -> Iterator[FittedCurve | None]:
        """
        Yield curves to compare with what was found, in this order.

        With a core alone first: effects that were found in the place of a curve are none. Then with the core that finds
        its place only with the curve, with the effects that were found, and with effects that are sought again with it.
        """
        known = [found.model]
        yield self.curves.best(self.cores.alone, known, searched=True)
        if is_noise:
            return
        yield self.cores.curve_before_core(self.curves, known)
        yield self.curves.best([found.model], known)
        if not self.candidates.channel.cores:
            yield self.curves.beside_effects(self.candidates.baseline, known)


def _is_explained(fit: Fit) -> bool:
    """Return whether the residual of a fit to train and validation is as noise would be."""
    return is_noise(fit.likelihood.tests(fit.model, fit.likelihood.noise(fit.model)))
