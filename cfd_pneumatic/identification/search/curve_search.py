# SPDX-License-Identifier: Apache-2.0
"""
Search for the curve of an unknown characteristic, if no effect of the library reduces the residual to noise.

The most promising places are fitted inside the simulation, first to short stretches of the recordings. The fits are
compared by their prediction errors.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.identification.channels import PLACES, Model
from cfd_pneumatic.identification.fit import Likelihood, Optimum
from cfd_pneumatic.identification.residual import autoregression, independent_share
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.curve_fit import fit_curve, update_penalty
from cfd_pneumatic.identification.search.curve_places import visited_ranges
from cfd_pneumatic.identification.search.curve_screening import ScreenedCurve, add_screened_curve, screen_curves
from cfd_pneumatic.identification.search.thresholds import (
    CLEARLY_SMALLER_ERROR,
    CURVE_START_SHARES,
    CURVE_STRETCH_STEPS,
    EFFORT_NEAR_NOISE,
    EXPECTED_CURVE_EVALUATIONS,
    FAR_SMALLER_ERROR,
    FEWER_STRETCH_STEPS,
    LARGE_RESIDUAL,
    LARGEST_ALIKE_ERROR,
    LARGEST_CORNER_ERROR,
    LARGEST_CURVE_REMAINDER,
    LARGEST_CURVE_REMAINDER_WITH_EFFECTS,
    LARGEST_ERROR_FOR_NEW_CORE,
    LARGEST_HYPOTHESIS_ERROR,
    LARGEST_NEAR_NOISE,
    LARGEST_REMAINDER_OF_SOLE_CURVE,
    LARGEST_SHARPENED_SQUARES,
    LARGEST_SKETCH_RESIDUAL,
    LARGEST_SKETCH_SHARE,
    LARGEST_SKETCH_SQUARES,
    LEAST_CURVE_EVIDENCE,
    LEAST_ERROR_DROP,
    LEAST_EVIDENCE_SHARE,
    LEAST_FALLBACK_EVIDENCE_SHARE,
    LEAST_WIDER_RANGE,
    MOST_EFFECTS_WITH_CURVE,
    MOST_FITTED_CURVES,
    MOST_FURTHER_PLACES,
    ROUGH_CURVE_SEARCH,
    SHARPENED_SKETCHES,
    SHORT_CURVE_SEARCH,
    SHORT_STRETCH_STEPS,
    SKETCHES_OF_PLACE,
)
from cfd_pneumatic.runtime import map_in_threads

VALVE_CURVE = ('flow', 'error')
"""Curve of a valve: hardly visible before the core is fitted again, because it misleads the fit of the core."""


@dataclass(frozen=True)
class FittedCurve:
    """
    A fitted curve, and the model to which the curve was added.

    Attributes
    ----------
    screened
        Place and penalty of the curve.
    candidate
        Model with the curve, fitted to the train part.
    base
        Model without the curve.
    alternatives
        Places that the recordings do not distinguish from this place.

    """

    screened: ScreenedCurve
    candidate: Candidate
    base: Candidate
    alternatives: tuple[tuple[str, str], ...]

    @property
    def name(self) -> tuple[str, str]:
        """Return place and variable of the curve."""
        return self.screened.place.name

    @property
    def is_possible(self) -> bool:
        """Whether a device can have values as large as the curve's."""
        place = PLACES[self.screened.place.enters]
        heights = self.screened.place.heights(self.candidate.model)
        return float(np.max(np.abs(heights)) if place.keeps_constant else np.ptp(heights)) <= place.largest


class CurveSearch:
    """
    Fits curves in addition to models; the fits are cached.

    Parameters
    ----------
    candidates
        Fits models.

    """

    def __init__(self, candidates: Candidates) -> None:
        self.candidates = candidates
        self._stretches = candidates.train.spread(CURVE_STRETCH_STEPS)
        self._brief = candidates.train.spread(SHORT_STRETCH_STEPS)
        self._effort = candidates.effort
        self._fewer_stretches = candidates.train.spread(FEWER_STRETCH_STEPS)
        self._known_stretches: dict[Candidate, Likelihood] = {}
        self._known_curves: dict[Candidate, list[FittedCurve]] = {}
        self._sketches: dict[Candidate, list[_Sketch]] = {}
        self._screened: dict[Candidate, list[ScreenedCurve]] = {}

    def is_promising(self, base: Candidate) -> bool:
        """Return whether a curve is predicted to explain most of what a model's residual has above the noise."""
        screened, excess = self._screen(base), self.candidates.residual_ratio(base) ** 2 - 1.0
        return any(
            curve.remainder * (excess + 1.0) - 1.0 < LARGEST_REMAINDER_OF_SOLE_CURVE * excess for curve in screened
        )

    def fit_best_curve(
        self, bases: Sequence[Candidate], known: Sequence[Candidate], is_after_search: bool = False
    ) -> FittedCurve | None:
        """
        Return the curve with the least error in addition to any of some models; None if no curve reaches the noise.

        Parameters
        ----------
        bases
            Models to which curves are added.
        known
            Models with effects of the library. A model that explains as much is preferred to a curve.
        is_after_search
            Whether `known` are the result of a search for combined effects. If their residual is large, curves of less
            promise are tried too: large curves explain more than predicted.

        """
        limit = min(
            (
                model.rss
                for model in known
                if not is_after_search or self.candidates.residual_ratio(model) < LARGE_RESIDUAL
            ),
            default=math.inf,
        )
        curves: list[FittedCurve] = []
        for base in sorted(bases, key=self._least_predicted_squares):
            if base in self._known_curves or self._least_predicted_squares(base) < limit:
                curves += [
                    curve for curve in self._fit_curves(base) if curve.is_possible and self.is_better(curve, known)
                ]
            if any(self.is_noise(curve.candidate) for curve in curves):
                break  # a curve that reaches the noise with a core is not searched with a further core
        if not curves:
            return None
        best = min(curves, key=lambda curve: self.candidates.sum_of_squares(curve.candidate))
        if not self._is_near_noise(best):
            return None
        least_error = min(_prediction_error(curve.candidate) for curve in curves)
        similar = [
            curve.name for curve in curves if _prediction_error(curve.candidate) < LARGEST_ALIKE_ERROR * least_error
        ]
        return replace(best, alternatives=tuple(dict.fromkeys(name for name in similar if name != best.name)))

    def fit_with_new_core(
        self, core: Candidate, base: Candidate, name: str, known: Sequence[Candidate]
    ) -> FittedCurve | None:
        """
        Return a curve with a core that is fitted together with the curve; None if no curve reaches the noise.

        Parameters
        ----------
        core
            Model with the core, fitted without a curve.
        base
            Model with a different core, to which curves were added before.
        name
            Name of the core.
        known
            See `fit_best_curve`.

        """
        sketches = self._sketches.get(base)
        if not self._effort.allows('curves with the physical core'):
            return None
        limit = LARGEST_ERROR_FOR_NEW_CORE**2 * min(
            _squares(self._stretches, candidate.model) for candidate in (base, core)
        )
        if not sketches or sketches[0].optimum.cost > limit:
            return None
        with_curve = self.candidates.to_candidate(sketches[0].optimum.model, base.model)
        model = self.candidates.with_core(with_curve, name).model
        refitted = self.candidates.to_candidate(replace(model, effects=core.effects), core.model)
        self._known_curves[core] = [replace(curve, base=core) for curve in self._fit_curves(refitted)]
        return self.fit_best_curve([core], known)

    def fit_with_effects(self, base: Candidate, known: Sequence[Candidate]) -> FittedCurve | None:
        """Return a curve with effects that are searched together with the curve; effects found without it may err."""
        sketches = self._sketches.get(base)
        if not sketches or not self._effort.allows('effects together with a curve'):
            return None
        with_curve = self.candidates.to_candidate(sketches[0].optimum.model, base.model)
        for _ in range(MOST_EFFECTS_WITH_CURVE):
            extended = self.candidates.add_effects(with_curve, self.candidates.possible_effects(with_curve))
            better = [
                candidate for candidate in extended.values() if _is_better(self.candidates, candidate, with_curve)
            ]
            if not better:
                break
            with_curve = min(better, key=lambda candidate: candidate.rss)
        library = self.candidates.channel.library
        effects = {name: values for name, values in with_curve.effects.items() if name in library}
        if not effects:
            return None
        with_effects = self.candidates.to_candidate(replace(with_curve.model, effects=effects), base.model)
        return self.fit_best_curve([with_effects], known)

    def find_hypothesis(self, known: Candidate) -> FittedCurve | None:
        """
        Return the curve that predicts best of all that were fitted; None if none is much better than a known model.

        The curve is no answer, because more than noise remains.
        """
        curves = list(chain.from_iterable(self._known_curves.values()))
        if not curves:
            first = [(sketches[0], base) for base, sketches in self._sketches.items() if sketches]
            for sketch, base in sorted(first, key=lambda pair: pair[0].optimum.cost / self._noise_squares(pair[1]))[:1]:
                curves = self._fit_to_train(base, [(sketch.screened, sketch.optimum.model)])
        much_better = [
            curve
            for curve in curves
            if curve.is_possible
            and all(
                error(curve.candidate) < LARGEST_HYPOTHESIS_ERROR * error(model)
                for error in (_prediction_error, self.candidates.residual_ratio)
                for model in (known, self.candidates.baseline)
            )
        ]
        return min(much_better, key=lambda curve: _prediction_error(curve.candidate), default=None)

    def is_better(self, curve: FittedCurve, known: Sequence[Candidate]) -> bool:
        """Return whether a curve explains more than the model without the curve, and than every known model."""
        candidate, base = curve.candidate, curve.base
        least_error = min((_prediction_error(model) for model in known), default=math.inf)
        predicts_as_well = _prediction_error(candidate) < LARGEST_ALIKE_ERROR * least_error
        return (
            _is_better(self.candidates, candidate, base)
            and predicts_as_well
            and all(_explains_more(self.candidates, candidate, model) for model in dict.fromkeys(known))
        )

    def is_near(self, curve: FittedCurve, rival: Candidate) -> bool:
        """Return whether a model is nearly as good as a curve: on the validation part, and on all samples."""
        return all(
            error(rival) * CLEARLY_SMALLER_ERROR < error(curve.candidate)
            for error in (_prediction_error, self.candidates.residual_ratio)
        )

    def is_noise(self, candidate: Candidate) -> bool:
        """Return whether a residual passes the noise tests and is hardly larger than the noise."""
        candidates = self.candidates
        return candidates.residual_ratio(candidate) < LARGEST_NEAR_NOISE and candidates.has_noise_residual(candidate)

    def is_far_better(self, curve: FittedCurve, rivals: Sequence[Candidate]) -> bool:
        """Return whether a curve reaches the noise, and two combined rivals would hardly err as little."""
        limit = FAR_SMALLER_ERROR * min(map(_prediction_error, rivals), default=math.inf)
        candidate = curve.candidate
        return self.candidates.residual_ratio(candidate) < LARGEST_NEAR_NOISE and _prediction_error(candidate) < limit

    def _fit_curves(self, base: Candidate) -> list[FittedCurve]:
        """
        Return the most promising curves in addition to a model, fitted to the train part.

        Fits to short stretches select the curves, and the positions of the knots.
        """
        if base not in self._known_curves:
            best = self._best_sketches(base, self._places_to_fit(base))
            if self._is_astray(base) and not self._is_at_noise(base, best):  # the prediction errs far from the noise
                best = self._best_sketches(base, self._further_places(base))
            starts = [(sketch.screened, sketch.optimum.model) for sketch in best[:MOST_FITTED_CURVES]]
            curves = self._fit_to_train(base, self._worth_fitting(base, starts))
            self._known_curves[base] = [self._extend_range(curve) for curve in curves]
        return self._known_curves[base]

    def _is_astray(self, base: Candidate) -> bool:
        """Return whether a model errs so much that the linear prediction of curves may err."""
        return self.candidates.residual_ratio(base) > LARGE_RESIDUAL

    def _places_to_fit(self, base: Candidate) -> list[ScreenedCurve]:
        """Return the curves that are predicted to explain most."""
        return self._predicted(self._screen(base), base, LEAST_EVIDENCE_SHARE)

    def _further_places(self, base: Candidate) -> list[ScreenedCurve]:
        """
        Return curves that a prediction from a model far from the noise may have missed.

        Short fits with the linear core rank all places. The physical core takes over the ranking. The curve of the
        valve is always among them.
        """
        known = {curve.place.name for curve in self._places_to_fit(base)}
        further = [curve for curve in self._screen(base) if curve.place.name not in known]
        of_valve = [curve for curve in further if curve.place.name == VALVE_CURVE][:1]
        if not base.model.parts:
            chosen = self._best_of_short_fits(base, further)
        else:
            ranked = [sketch.screened.place.name for sketch in self._sketches.get(self.candidates.baseline, [])]
            names = list(dict.fromkeys(ranked))[:MOST_FURTHER_PLACES]
            best = {curve.place.name: curve for curve in reversed(further)}
            chosen = [best[name] for name in names if name in best]
            if known and not chosen:
                chosen = self._predicted(further, base, LEAST_FALLBACK_EVIDENCE_SHARE)
        is_included = any(curve.place.name == VALVE_CURVE for curve in chosen)
        return chosen + ([] if is_included or not chosen else of_valve)

    def _predicted(self, screened: Sequence[ScreenedCurve], base: Candidate, share: float) -> list[ScreenedCurve]:
        """Return the curves with at least a share of the best curve's evidence that may reach the noise."""
        evidence = max((curve.evidence for curve in self._screen(base) if curve.place.name[1] != 'time'), default=0.0)
        remainder = LARGEST_CURVE_REMAINDER_WITH_EFFECTS if base.effects else LARGEST_CURVE_REMAINDER
        return _select_for_fit(screened, self.candidates.residual_ratio(base), remainder, share * evidence)

    def _best_of_short_fits(self, base: Candidate, screened: Sequence[ScreenedCurve]) -> list[ScreenedCurve]:
        """Return the best places by short fits to a few stretches, from the model's gains and from nominal gains."""
        first: dict[tuple[str, str, float], ScreenedCurve] = {}
        for curve in screened:
            first.setdefault((*curve.place.name, curve.place.memory), curve)
        models = self.candidates.channel.beginnings(base.model, True)
        evaluations = len(models) * SHORT_CURVE_SEARCH[1]
        steps = evaluations * sum(
            self._brief.effort_of(add_screened_curve(base.model, curve, 0.0)) for curve in first.values()
        )
        if not self._effort.allows(_question(base), steps):
            return []
        starts = [
            (curve, replace(model, effects=self._start_with_curve(base, curve, self._brief).effects))
            for curve in first.values()
            for model in models
        ]
        costs = map_in_threads(
            lambda start: fit_curve(self._brief, start[1], start[0], SHORT_CURVE_SEARCH).cost, starts
        )
        ranked = sorted(zip(costs, (curve for curve, _ in starts)), key=lambda fit: fit[0])
        return list(dict.fromkeys(curve for _, curve in ranked))[:MOST_FURTHER_PLACES]

    def _best_sketches(self, base: Candidate, screened: Sequence[ScreenedCurve]) -> list[_Sketch]:
        """Return sketches whose residual comes near the noise, earlier sketches included, the best first."""
        starts = [(curve, self._start_with_curve(base, curve, self._stretches)) for curve in screened]
        sketches = self._fit_sketches(base, starts)
        largest = (
            LARGEST_SKETCH_RESIDUAL * self._near_noise_limit(base) / LARGEST_NEAR_NOISE
        ) ** 2 * self._noise_squares(base)
        promising = [
            sketch
            for sketch in sketches[:SHARPENED_SKETCHES]
            if sketch.optimum.cost < LARGEST_SHARPENED_SQUARES * largest
        ]
        if any(_squares(self.candidates.train, sketch.optimum.model) < base.rss for sketch in promising):
            self._effort.extend(EFFORT_NEAR_NOISE)
        moved = [
            variant for sketch in promising for variant in _with_moved_knots(sketch.screened, sketch.optimum.model)
        ]
        sketches = _sort_by_cost(self._sketches.get(base, []) + sketches + self._fit_sketches(base, moved))
        self._sketches[base] = sketches
        limit = min(LARGEST_SKETCH_SQUARES * sketches[0].optimum.cost, largest) if sketches else 0.0
        return _best_of_each_place([sketch for sketch in sketches if sketch.optimum.cost < limit])

    def _is_at_noise(self, base: Candidate, sketches: Sequence[_Sketch]) -> bool:
        """Return whether the first sketch may reach the noise."""
        return bool(sketches) and sketches[0].optimum.cost < LARGEST_SKETCH_RESIDUAL**2 * self._noise_squares(base)

    def _worth_fitting(
        self, base: Candidate, starts: Sequence[tuple[ScreenedCurve, Model]]
    ) -> Sequence[tuple[ScreenedCurve, Model]]:
        """
        Return the curves that improve the train part, too, and that the effort suffices for.

        Curves that reach the noise there are nearly the answer. Only such curves are then returned, in any case.
        """
        train = self.candidates.train
        squares = [_squares(train, model) for _, model in starts]
        noise_squares = LARGEST_SKETCH_RESIDUAL**2 * self.candidates.noise**2 * train.samples
        at_noise = [start for start, square in zip(starts, squares) if square < noise_squares]
        better = [start for start, square in zip(starts, squares) if square < base.rss]
        return at_noise or self._affordable(base, better)

    def _affordable(
        self, base: Candidate, starts: Sequence[tuple[ScreenedCurve, Model]]
    ) -> Sequence[tuple[ScreenedCurve, Model]]:
        """Return the first curves that the effort suffices to fit to the train part."""
        if not starts:
            return []
        steps = EXPECTED_CURVE_EVALUATIONS * self.candidates.train.effort_of(starts[0][1])
        return self._effort.affordable(_question(base), starts, steps)

    def _fit_to_train(self, base: Candidate, starts: Sequence[tuple[ScreenedCurve, Model]]) -> list[FittedCurve]:
        """Return curves fitted to the train part, each from a model that has the curve."""

        def fit(screened: ScreenedCurve, model: Model) -> Candidate:
            return self.candidates.to_candidate(
                fit_curve(self.candidates.train, model, screened, ROUGH_CURVE_SEARCH).model, base.model
            )

        fits = map_in_threads(lambda start: fit(*start), starts)
        curves = [FittedCurve(screened, candidate, base, ()) for (screened, _), candidate in zip(starts, fits)]
        return [curve for curve in curves if curve.screened.place.curve.name in curve.candidate.effects]

    def _extend_range(self, curve: FittedCurve) -> FittedCurve:
        """Return a curve over the range that its model visits; a large curve may lead the model out of the range."""
        place, model = curve.screened.place, curve.candidate.model
        low, high = visited_ranges(self.candidates, curve.candidate, 0.0)[place.against]
        if self._is_near_noise(curve) or high - low < LEAST_WIDER_RANGE * (place.high - place.low):
            return curve
        wide = place.with_range(low, high)
        screened = replace(curve.screened, place=wide)
        start = wide.add_curve(model, place.interpolation(wide.knots) @ place.heights(model))
        wide_curves = self._fit_to_train(
            curve.base, self._affordable(curve.base, [(screened, start), *_with_moved_knots(screened, start)])
        )
        return min([curve, *wide_curves], key=lambda fitted: self.candidates.sum_of_squares(fitted.candidate))

    def _is_near_noise(self, curve: FittedCurve) -> bool:
        """Return whether a curve's residual is hardly larger than the noise; it must not depend on the inputs."""
        may_hide = self.candidates.channel.may_hide(self.candidates.train.experiments)
        if may_hide and self.candidates.has_input_dependence(curve.candidate):
            return False
        return self.candidates.residual_ratio(curve.candidate) < self._near_noise_limit(curve.base)

    def _near_noise_limit(self, base: Candidate) -> float:
        """Return the largest residual with a curve that is hardly larger than the noise [standard deviations of it]."""
        return math.hypot(LARGEST_NEAR_NOISE, LARGEST_CORNER_ERROR * self.candidates.residual_ratio(base))

    def _least_predicted_squares(self, base: Candidate) -> float:
        """Return the least sum of squares that is predicted for a curve in addition to a model."""
        return min((curve.remainder for curve in self._screen(base)), default=1.0) * base.rss

    def _screen(self, base: Candidate) -> list[ScreenedCurve]:
        """Return the screened curves for a model; none without a validation part, which has to confirm a curve."""
        if base not in self._screened:
            has_validation = self.candidates.baseline.validation_rmse is not None
            self._screened[base] = screen_curves(self.candidates, base) if has_validation else []
        return self._screened[base]

    def _start_with_curve(self, base: Candidate, screened: ScreenedCurve, stretches: Likelihood) -> Model:
        """Return a model with the largest share of a predicted curve that reduces the error; the whole may be wrong."""
        models = [add_screened_curve(base.model, screened, share) for share in CURVE_START_SHARES]
        squares, limit = _squares_side_by_side(stretches, models), _squares(stretches, base.model)
        return next((model for model, square in zip(models, squares) if square < limit), models[-1])

    def _stretches_of(self, base: Candidate) -> Likelihood:
        """Return the short stretches for curves in addition to a model."""
        return self._known_stretches.get(base, self._stretches)

    def _choose_stretches(self, base: Candidate, starts: Sequence[tuple[ScreenedCurve, Model]]) -> Likelihood:
        """Return the short stretches for all curves in addition to a model: fewer if the effort does not suffice."""
        if base not in self._known_stretches:
            steps = 2 * len(starts) * EXPECTED_CURVE_EVALUATIONS * self._stretches.effort_of(starts[0][1])
            is_affordable = steps < LARGEST_SKETCH_SHARE * self._effort.room
            self._known_stretches[base] = self._stretches if is_affordable else self._fewer_stretches
        return self._known_stretches[base]

    def _noise_squares(self, base: Candidate) -> float:
        """Return the sum of squares of the noise on the short stretches for curves in addition to a model."""
        return self.candidates.noise**2 * self._stretches_of(base).samples

    def _fit_sketches(self, base: Candidate, starts: Sequence[tuple[ScreenedCurve, Model]]) -> list[_Sketch]:
        """Return curves fitted to short stretches, each from a model that has the curve, the best first."""
        if not starts:
            return []
        self._effort.ask(_question(base), self.candidates.residual_ratio(base))
        stretches = self._choose_stretches(base, starts)
        steps = 2 * EXPECTED_CURVE_EVALUATIONS * stretches.effort_of(starts[0][1])
        starts = self._effort.affordable(_question(base), starts, steps)
        share = independent_share(self.candidates.noise_autoregression(base))

        def sketch(screened: ScreenedCurve, model: Model) -> _Sketch:
            model = fit_curve(stretches, model, screened, ROUGH_CURVE_SEARCH).model
            screened = replace(screened, place=screened.place.with_memory_of(model))
            updated = update_penalty(stretches, model, screened, share)
            return _Sketch(updated, fit_curve(stretches, model, updated, ROUGH_CURVE_SEARCH))

        return _sort_by_cost(map_in_threads(lambda start: sketch(*start), starts))


class _Sketch(NamedTuple):
    """A curve that was fitted to short stretches."""

    screened: ScreenedCurve
    optimum: Optimum


def _question(base: Candidate) -> str:
    """Return what is tried when curves are added to a model."""
    core = 'physical' if base.model.core else 'linear'
    return f'curves with the {core} core' + (f' and {" and ".join(base.effects)}' if base.effects else '')


def _sort_by_cost(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    return sorted(sketches, key=lambda sketch: sketch.optimum.cost)


def _best_of_each_place(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    """Return the best few sketches of each place, in turns: first the best sketch of every place."""
    counts: Counter[tuple[str, str]] = Counter()
    turns: list[list[_Sketch]] = [[] for _ in range(SKETCHES_OF_PLACE)]
    for sketch in sketches:
        if counts[sketch.screened.place.name] < SKETCHES_OF_PLACE:
            turns[counts[sketch.screened.place.name]].append(sketch)
        counts[sketch.screened.place.name] += 1
    return [*chain.from_iterable(turns)]


def _with_moved_knots(screened: ScreenedCurve, model: Model) -> list[tuple[ScreenedCurve, Model]]:
    """Return variants of a model's curve with different knots."""
    heights = screened.place.heights(model)
    places = screened.place.with_moved_knots(heights)
    return [
        (replace(screened, place=place), place.add_curve(model, screened.place.interpolation(place.knots) @ heights))
        for place in places
    ]


def _squares(likelihood: Likelihood, model: Model) -> float:
    """Return the sum of squared residuals of a model; infinite if the model diverges."""
    with np.errstate(over='ignore', invalid='ignore'):
        squares = sum(float(run @ run) for run in likelihood.residuals(likelihood.simulate(model)))
    return squares if math.isfinite(squares) else math.inf


def _squares_side_by_side(likelihood: Likelihood, models: Sequence[Model]) -> list[float]:
    """Return the sums of squared residuals of models with the same core and effects, simulated side by side."""
    likelihood.effort.add(likelihood.effort_of(models[0], len(models)))
    simulated = likelihood.channel.simulate(likelihood.experiments, models)
    with np.errstate(over='ignore', invalid='ignore'):
        return [
            sum(float(run @ run) for run in likelihood.residuals([values[:, rank] for values in simulated]))
            for rank in range(len(models))
        ]


def _select_for_fit(
    screened: Sequence[ScreenedCurve], ratio: float, remainder: float, evidence: float
) -> list[ScreenedCurve]:
    """
    Return the most promising curve of each place and memory that may reduce a residual to the noise.

    Parameters
    ----------
    screened
        Curves, the most promising first.
    ratio
        Residual without a curve [standard deviations of the noise].
    remainder
        Largest predicted remainder [squares above the noise].
    evidence
        Least evidence.

    """
    best: dict[tuple[str, str, float], ScreenedCurve] = {}
    for curve in screened:
        may_reach_noise = curve.remainder * ratio**2 - 1.0 < remainder * (ratio**2 - 1.0)
        if may_reach_noise and curve.evidence > max(LEAST_CURVE_EVIDENCE, evidence):
            best.setdefault((*curve.place.name, curve.place.memory), curve)
    return list(best.values())[:MOST_FITTED_CURVES]


def _prediction_error(candidate: Candidate) -> float:
    """Return the error on the validation part, or on the train part if there is no validation part [SI]."""
    mean_square = candidate.rss / max(sum(residual.size for residual in candidate.residuals), 1)
    error = math.sqrt(mean_square) if candidate.validation_rmse is None else candidate.validation_rmse
    return error if math.isfinite(error) else math.inf


def _is_better(candidates: Candidates, candidate: Candidate, base: Candidate) -> bool:
    """Return whether a candidate explains more than a model, and reduces the prediction error."""
    largest_error = (1.0 - LEAST_ERROR_DROP) * _prediction_error(base)
    return _explains_more(candidates, candidate, base) and _prediction_error(candidate) < largest_error


def _explains_more(candidates: Candidates, candidate: Candidate, rival: Candidate) -> bool:
    """Return whether a candidate lowers the criterion on train and validation, or predicts clearly better."""
    likelihood, coefficients = candidates.train_validation, autoregression(candidate.residuals)
    before, after = (
        likelihood.criterion(likelihood.residuals(model.simulated), model.unknowns, coefficients)
        for model in (rival, candidate)
    )
    largest_error = CLEARLY_SMALLER_ERROR * _prediction_error(rival)
    return before - after > LEAST_CURVE_EVIDENCE or _prediction_error(candidate) < largest_error
