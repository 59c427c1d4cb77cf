# SPDX-License-Identifier: Apache-2.0
"""
Laws that nobody knows: curves, where no effect of the library leaves noise.

The most promising places are fitted inside the simulation, first to short stretches, and compared by what they
foretell.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Optimum
from cfd_pneumatic.identification.residual import autoregression, independent_share
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.curve_fit import fitted, renewed
from cfd_pneumatic.identification.search.curve_places import ranges_of
from cfd_pneumatic.identification.search.curve_screening import ScreenedCurve, beside, screened_curves
from cfd_pneumatic.identification.search.thresholds import (
    CLEARLY_SMALLER_ERROR,
    CURVE_START_SHARES,
    CURVE_STRETCH_STEPS,
    FAR_SMALLER_ERROR,
    LARGE_RESIDUAL,
    LARGEST_ALIKE_ERROR,
    LARGEST_CORNER_ERROR,
    LARGEST_CURVE_REMAINDER,
    LARGEST_CURVE_REMAINDER_WITH_EFFECTS,
    LARGEST_ERROR_FOR_NEW_CORE,
    LARGEST_NEAR_NOISE,
    LARGEST_REMAINDER_OF_SOLE_CURVE,
    LARGEST_SKETCH_RESIDUAL,
    LARGEST_SKETCH_SQUARES,
    LEAST_CURVE_EVIDENCE,
    LEAST_ERROR_DROP,
    LEAST_EVIDENCE_SHARE,
    LEAST_FALLBACK_EVIDENCE_SHARE,
    LEAST_WIDER_RANGE,
    MOST_EFFECTS_WITH_CURVE,
    MOST_FITTED_CURVES,
    ROUGH_CURVE_SEARCH,
    SHARPENED_SKETCHES,
    SKETCHES_OF_PLACE,
)
from cfd_pneumatic.runtime import map_in_threads

OF_VALVES = ('flow', 'error')
"""The law of a valve, which hardly shows before the core is fitted anew: beside one that it led astray."""


@dataclass(frozen=True)
class FittedCurve:
    """
    A curve that was drawn, and the model beside which it was.

    Attributes
    ----------
    promise
        Its place, and how smooth it is.
    candidate
        The model with it, fitted to the train part.
    begin
        The model without it.
    others
        Places that the recordings can't tell from its own.

    """

    promise: ScreenedCurve
    candidate: Candidate
    begin: Candidate
    others: tuple[tuple[str, str], ...]

    @property
    def name(self) -> tuple[str, str]:
        """Where it enters, and against what."""
        return self.promise.slot.name


class CurveSearch:
    """
    Curves that may be drawn beside models; none is fitted twice.

    Parameters
    ----------
    candidates
        Fits models.

    """

    def __init__(self, candidates: Candidates) -> None:
        self.candidates = candidates
        self._excerpt = candidates.train.spread(CURVE_STRETCH_STEPS)
        self._noise = candidates.noise**2 * self._excerpt.samples
        self._known: dict[Candidate, list[FittedCurve]] = {}
        self._sketches: dict[Candidate, list[_Sketch]] = {}
        self._promised: dict[Candidate, list[ScreenedCurve]] = {}

    def may_explain(self, begin: Candidate) -> bool:
        """Return whether a curve promises most of what is above the noise beside a model."""
        promised, above = self._promises(begin), self.candidates.size(begin) ** 2 - 1.0
        return any(one.left * (above + 1.0) - 1.0 < LARGEST_REMAINDER_OF_SOLE_CURVE * above for one in promised)

    def best(
        self, begins: Sequence[Candidate], known: Sequence[Candidate], searched: bool = False
    ) -> FittedCurve | None:
        """
        Return the curve that foretells best beside one of some models; None where none explains what is left.

        An effect of the library that explains as much is preferred: `known` are models with what was found of it. Where
        effects were `searched` in company and leave much, laws that promise less are tried: large ones come to more.
        """
        least = min(
            (one.rss for one in known if not searched or self.candidates.size(one) < LARGE_RESIDUAL), default=math.inf
        )
        found: list[FittedCurve] = []
        for begin in sorted(begins, key=self._least_promised):
            if begin in self._known or self._least_promised(begin) < least:
                found += [one for one in self._beside(begin) if self.is_better(one, known)]
            if any(self.is_noise(one.candidate) for one in found):
                break  # what leaves hardly more than noise beside one core is not looked for beside another
        if not found:
            return None
        best = min(found, key=lambda one: self.candidates.squares(one.candidate))
        if not self._is_near_noise(best):
            return None
        least_error = min(_error(one.candidate) for one in found)
        alike = [one.name for one in found if _error(one.candidate) < LARGEST_ALIKE_ERROR * least_error]
        return replace(best, others=tuple(dict.fromkeys(name for name in alike if name != best.name)))

    def beside_core(
        self, core: Candidate, begin: Candidate, name: str, known: Sequence[Candidate]
    ) -> FittedCurve | None:
        """Return a law beside a core that finds its place only beside the law, which was drawn beside another one."""
        sketches = self._sketches.get(begin)
        most = LARGEST_ERROR_FOR_NEW_CORE**2 * min(self._left(one.model) for one in (begin, core))
        if not sketches or sketches[0].found.cost > most:
            return None
        drawn = self.candidates.finished(sketches[0].found.model, begin.model)
        model = self.candidates.with_core(drawn, name).model
        there = self.candidates.finished(replace(model, effects=core.effects), core.model)
        self._known[core] = [replace(one, begin=core) for one in self._beside(there)]
        return self.best([core], known)

    def beside_effects(self, begin: Candidate, known: Sequence[Candidate]) -> FittedCurve | None:
        """Return a law beside effects that were sought beside the law: what was found without it may be astray."""
        sketches = self._sketches.get(begin)
        if not sketches:
            return None
        drawn = self.candidates.finished(sketches[0].found.model, begin.model)
        for _ in range(MOST_EFFECTS_WITH_CURVE):
            beside = self.candidates.beside(drawn, self.candidates.names(drawn))
            better = [one for one in beside.values() if _is_better(self.candidates, one, drawn)]
            if not better:
                break
            drawn = min(better, key=lambda one: one.rss)
        effects = {name: own for name, own in drawn.effects.items() if name in self.candidates.channel.library}
        if not effects:
            return None
        return self.best([self.candidates.finished(replace(drawn.model, effects=effects), begin.model)], known)

    def is_better(self, drawing: FittedCurve, known: Sequence[Candidate]) -> bool:
        """Return whether a curve explains more than the model without it, and than every one of some others."""
        drawn, begin = drawing.candidate, drawing.begin
        foretells = _error(drawn) < LARGEST_ALIKE_ERROR * min((_error(one) for one in known), default=math.inf)
        return (
            _is_better(self.candidates, drawn, begin)
            and foretells
            and all(_explains_more(self.candidates, drawn, one) for one in dict.fromkeys(known))
        )

    def is_near(self, drawing: FittedCurve, other: Candidate) -> bool:
        """Return whether a model does nearly as well as one with a curve: on the validation part, and on everything."""
        return all(
            size(other) * CLEARLY_SMALLER_ERROR < size(drawing.candidate) for size in (_error, self.candidates.size)
        )

    def is_noise(self, one: Candidate) -> bool:
        """Return whether what a model leaves is noise in kind and hardly larger: where none was seen it may be."""
        return self.candidates.size(one) < LARGEST_NEAR_NOISE and self.candidates.leaves_noise(one)

    def is_far_better(self, drawing: FittedCurve, others: Sequence[Candidate]) -> bool:
        """Return whether a curve leaves hardly more than noise, and hardly two of some models might err as little."""
        most = FAR_SMALLER_ERROR * min(map(_error, others), default=math.inf)
        return self.candidates.size(drawing.candidate) < LARGEST_NEAR_NOISE and _error(drawing.candidate) < most

    def _beside(self, begin: Candidate) -> list[FittedCurve]:
        """
        Return the most promising curves beside a model, fitted to the train part.

        Short stretches tell before which these are, and whether they do better with their knots elsewhere.
        """
        if begin not in self._known:
            promised, size = self._promises(begin), self.candidates.size(begin)
            left = LARGEST_CURVE_REMAINDER_WITH_EFFECTS if begin.effects else LARGEST_CURVE_REMAINDER
            most = max((one.evidence for one in promised if one.slot.name[1] != 'time'), default=0.0)
            likely = _worth_a_fit(promised, size, left, LEAST_EVIDENCE_SHARE * most)
            near = self._near(begin, likely)
            if likely and size > LARGE_RESIDUAL and not self._is_at_noise(near):  # far from where it was linearised
                names = {one.slot.name for one in likely}
                others = [one for one in promised if one.slot.name not in names]
                hardly = _worth_a_fit(others, size, left, LEAST_FALLBACK_EVIDENCE_SHARE * most)
                of_valve = [one for one in others if one.slot.name == OF_VALVES and one not in hardly]
                near = self._near(begin, hardly + of_valve)
            drawn = self._fitted(begin, [(one.promise, one.found.model) for one in near[:MOST_FITTED_CURVES]])
            self._known[begin] = [self._over_its_range(one) for one in drawn]
        return self._known[begin]

    def _near(self, begin: Candidate, promised: Sequence[ScreenedCurve]) -> list[_Sketch]:
        """Return sketches that come near the noise, those made before as well, the best first."""
        sketches = self._sketched(begin, [(one, self._begun(begin, one)) for one in promised])
        sharper = [other for one in sketches[:SHARPENED_SKETCHES] for other in _otherwise(one.promise, one.found.model)]
        sketches = _best_first(self._sketches.get(begin, []) + sketches + self._sketched(begin, sharper))
        self._sketches[begin] = sketches
        farthest = (LARGEST_SKETCH_RESIDUAL * self._near_noise(begin) / LARGEST_NEAR_NOISE) ** 2 * self._noise
        most = min(LARGEST_SKETCH_SQUARES * sketches[0].found.cost, farthest) if sketches else 0.0
        return _few_of_each([one for one in sketches if one.found.cost < most])

    def _is_at_noise(self, near: Sequence[_Sketch]) -> bool:
        """Return whether the best of some sketches may come down to the noise."""
        return bool(near) and near[0].found.cost < LARGEST_SKETCH_RESIDUAL**2 * self._noise

    def _fitted(self, begin: Candidate, begun: Sequence[tuple[ScreenedCurve, Model]]) -> list[FittedCurve]:
        """Return curves fitted to the train part, from models that have them."""

        def finished(promise: ScreenedCurve, model: Model) -> Candidate:
            return self.candidates.finished(
                fitted(self.candidates.train, model, promise, ROUGH_CURVE_SEARCH).model, begin.model
            )

        ended = map_in_threads(lambda one: finished(*one), begun)
        drawn = [FittedCurve(promise, own, begin, ()) for (promise, _), own in zip(begun, ended)]
        return [one for one in drawn if one.promise.slot.curve.name in one.candidate.effects]

    def _over_its_range(self, drawing: FittedCurve) -> FittedCurve:
        """Return a curve drawn over all that is visited beside it: a large law leads to where nothing was without."""
        slot, model = drawing.promise.slot, drawing.candidate.model
        low, high = ranges_of(self.candidates, drawing.candidate, 0.0)[slot.against]
        if self._is_near_noise(drawing) or high - low < LEAST_WIDER_RANGE * (slot.high - slot.low):
            return drawing
        wide = slot.over(low, high)
        promise = replace(drawing.promise, slot=wide)
        begun = wide.on(model, slot.along(wide.knots) @ slot.heights(model))
        others = self._fitted(drawing.begin, [(promise, begun), *_otherwise(promise, begun)])
        return min([drawing, *others], key=lambda one: self.candidates.squares(one.candidate))

    def _is_near_noise(self, drawing: FittedCurve) -> bool:
        """Return whether what a law leaves is noise in kind, or hardly larger and no other cause's."""
        may_hide = self.candidates.channel.may_hide(self.candidates.train.experiments)
        if may_hide and self.candidates.follows_inputs(drawing.candidate):
            return False
        return self.candidates.size(drawing.candidate) < self._near_noise(drawing.begin)

    def _near_noise(self, begin: Candidate) -> float:
        """Return the size up to which what a law leaves is hardly larger than the noise, which is 1."""
        return math.hypot(LARGEST_NEAR_NOISE, LARGEST_CORNER_ERROR * self.candidates.size(begin))

    def _least_promised(self, begin: Candidate) -> float:
        """Return the least sum of squares that a curve promises to leave."""
        return min((one.left for one in self._promises(begin)), default=1.0) * begin.rss

    def _promises(self, begin: Candidate) -> list[ScreenedCurve]:
        """Return what curves promise; none where no part is left to foretell."""
        if begin not in self._promised:
            told = self.candidates.baseline.validation_rmse is not None
            self._promised[begin] = screened_curves(self.candidates, begin) if told else []
        return self._promised[begin]

    def _begun(self, begin: Candidate, promise: ScreenedCurve) -> Model:
        """Return a model with so much of a promise as mends it: the whole of a large law may lead astray."""
        models = [beside(begin.model, promise, share) for share in CURVE_START_SHARES]
        return next((one for one in models if self._left(one) < self._left(begin.model)), models[-1])

    def _left(self, model: Model) -> float:
        """Return the sum of squares that a model leaves of the short stretches."""
        with np.errstate(over='ignore'):  # of one that runs away
            return sum(float(run @ run) for run in self._excerpt.residuals(self._excerpt.simulate(model)))

    def _sketched(self, begin: Candidate, some: Sequence[tuple[ScreenedCurve, Model]]) -> list[_Sketch]:
        """Return curves fitted to short stretches, from models that have them, the best first."""
        share = independent_share(self.candidates.resting_coefficients(begin))

        def sketch(promise: ScreenedCurve, model: Model) -> _Sketch:
            model = fitted(self._excerpt, model, promise, ROUGH_CURVE_SEARCH).model
            promise = replace(promise, slot=promise.slot.remembering(model))
            again = renewed(self._excerpt, model, promise, share)
            return _Sketch(again, fitted(self._excerpt, model, again, ROUGH_CURVE_SEARCH))

        return _best_first(map_in_threads(lambda one: sketch(*one), some))


class _Sketch(NamedTuple):
    """A curve that was fitted to an excerpt."""

    promise: ScreenedCurve
    found: Optimum


def _best_first(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    return sorted(sketches, key=lambda one: one.found.cost)


def _few_of_each(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    """Return the best few of each place: the best one of every place first."""
    ranks: Counter[tuple[str, str]] = Counter()
    turns: list[list[_Sketch]] = [[] for _ in range(SKETCHES_OF_PLACE)]
    for one in sketches:
        if ranks[one.promise.slot.name] < SKETCHES_OF_PLACE:
            turns[ranks[one.promise.slot.name]].append(one)
        ranks[one.promise.slot.name] += 1
    return [*chain.from_iterable(turns)]


def _otherwise(promise: ScreenedCurve, model: Model) -> list[tuple[ScreenedCurve, Model]]:
    """Return a curve with its knots elsewhere, as a model has it."""
    heights = promise.slot.heights(model)
    others = promise.slot.elsewhere(heights)
    return [(replace(promise, slot=one), one.on(model, promise.slot.along(one.knots) @ heights)) for one in others]


def _worth_a_fit(promised: Sequence[ScreenedCurve], size: float, left: float, least: float) -> list[ScreenedCurve]:
    """
    Return the most promising of each place and memory, if they may bring a residual down to the noise, of 1.

    They are to leave less than a share `left` of the squares above it, and their evidence is to be more than `least`.
    """
    best: dict[tuple[str, str, float], ScreenedCurve] = {}
    for one in promised:
        may = one.left * size**2 - 1.0 < left * (size**2 - 1.0)
        if may and one.evidence > max(LEAST_CURVE_EVIDENCE, least):
            best.setdefault((*one.slot.name, one.slot.memory), one)
    return list(best.values())[:MOST_FITTED_CURVES]


def _error(candidate: Candidate) -> float:
    """Return the error of the validation part, of the train part where there is none [SI]."""
    squares = candidate.rss / max(sum(one.size for one in candidate.residuals), 1)
    error = math.sqrt(squares) if candidate.validation_rmse is None else candidate.validation_rmse
    return error if math.isfinite(error) else math.inf


def _is_better(candidates: Candidates, candidate: Candidate, begin: Candidate) -> bool:
    """Return whether a curve explains more than a model, and foretells what it was not fitted to."""
    return _explains_more(candidates, candidate, begin) and _error(candidate) < (1.0 - LEAST_ERROR_DROP) * _error(begin)


def _explains_more(candidates: Candidates, candidate: Candidate, other: Candidate) -> bool:
    """Return whether a curve explains more of train and validation than a model, or foretells far more."""
    learn, coefficients = candidates.learn, autoregression(candidate.residuals)
    before, after = (
        learn.criterion(learn.residuals(one.simulated), one.unknowns, coefficients) for one in (other, candidate)
    )
    return before - after > LEAST_CURVE_EVIDENCE or _error(candidate) < CLEARLY_SMALLER_ERROR * _error(other)
