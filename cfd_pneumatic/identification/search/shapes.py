"""
The shape of what nobody knows: a curve, where no effect of the library leaves noise.

Where it enters and on what it depends is asked of the residual, linearised: what each place and each variable may take
beside the model's own unknowns, by the marginal likelihood of a smooth curve (restricted maximum likelihood). The best
few are fitted inside the simulation and compared by what they foretell.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels.channel import Curve, Model
from cfd_pneumatic.identification.fit.fit import Optimum
from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares
from cfd_pneumatic.identification.fit.likelihood import Likelihood, Unknowns
from cfd_pneumatic.identification.residual.autoregression import autoregression, independent_share
from cfd_pneumatic.identification.residual.tests import explained
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.complement import Complement
from cfd_pneumatic.identification.search.stepwise import small_enough
from cfd_pneumatic.model.effects.knots import KNOTS
from cfd_pneumatic.model.lanes import COUNT
from cfd_pneumatic.parallel import each

_PENALTIES = np.logspace(-8.0, 8.0, 65)  # of a curve's roughness, beside what data say of it
_RIDGE = 1e-4  # of its height, beside its roughness: what the gains make up for is none of it
_CROWDS = (0.3, 0.1, 0.03)  # how knots lie about nothing moving, and where a curve bends
_COARSE = np.maximum(1.0 - np.abs(0.5 * np.arange(KNOTS) - np.arange(KNOTS // 2 + 1)[:, None]), 0.0)  # every other knot
_LEAST_VISITED = 1e-9  # that a variable has to change by [SI]: of a piston at rest speed and place do not
_VISITED = 0.002  # share of the samples at either end of a range that does not count
_ASKED = 10_000  # grid steps of which a promise is
_SKETCHED = 10_000  # and of which the rough fits are
_FITTED = 4  # of the most promising
_OF_EACH = 2  # with their knots here or there
_SHARPENED = 2  # of the most promising
_FARTHEST = 1.5  # times the noise: no fit to the end brings a curve from there down to it
_RIVALLING = 2.0  # times what the best one leaves of an excerpt: those worth a fit to the end
_MOST_OF_ALL = 0.25  # of that, which a law may leave that is asked for before effects in company
_PROMISING = 0.6  # of what the best one promises: those worth a fit
_MOST_LEFT = 0.53  # of the squares above the noise, as the linearised model foretells it
_FINE = (1e-5, 25)  # tolerance and evaluations of a fit
_SHARES = (1.0, 0.3, 0.1, 0.03)  # of a promise, with which a fit begins
_RENEWED = (1e-6, 1e3)  # by how much a penalty may change
_LEAST_EVIDENCE = 50.0  # by which twice the log likelihood, and the criterion, have to rise
_LEAST_DROP = 0.02  # share by which the error on the validation part has to fall
_CLEARLY = 0.8  # times another's error of validation: whatever the train part, that one foretells too little
_FAR_BETTER = 0.4  # times the error of effects: a law that may leave hardly more than noise, and still is the answer
_MUCH_BETTER = 0.6  # times the error without a law: one that may have led a core astray
_MOST_BESIDE = 3  # effects that are sought beside a law
_ALIKE = 1.05  # times the least error of validation: places that are not told apart
_NEAR_NOISE = 1.25  # times the noise: a curve beside which more is left is no law
_SMOOTHED = 0.05  # of what was left before: what a large law's corners leave beside straight pieces

FROM_NOTHING = ('chamber', 'leak', 'friction')
"""Where a law enters of which no other number has what is even."""


@dataclass(frozen=True)
class Slot:
    """
    A place for a curve.

    Attributes
    ----------
    enters, against
        Where, and what it depends on: of those of `curve`.
    memory
        Of the flow, where it depends on that [s], or of friction [m].
    low, high, middle, crowd
        Its range, and how its knots crowd about what middle.
    unit
        A height that is small beside what it acts on.
    curve
        What draws it.

    """

    enters: str
    against: str
    memory: float
    low: float
    high: float
    middle: float
    crowd: float
    unit: float
    curve: Curve

    def parameters(self, heights: Sequence[float] | Array) -> tuple[float, ...]:
        """Return the parameters of a curve with some heights, shape (knots,)."""
        where = float(self.curve.enters.index(self.enters)), float(self.curve.against.index(self.against))
        return (*where, self.memory, self.low, self.high, self.middle, self.crowd, *map(float, heights))

    def heights(self, model: Model) -> Array:
        """Return the heights that a model's curve has, shape (knots,)."""
        return np.array(model.effects[self.curve.name][-KNOTS:])

    def on(self, model: Model, heights: Array) -> Model:
        """Return a model with a curve here that has some heights, shape (knots,)."""
        return replace(model, effects={**model.effects, self.curve.name: self.parameters(heights)})

    def drawn(self, model: Model, heights: Array) -> Model:
        """Return a model that has a curve with other heights, shape (knots,)."""
        own = *model.effects[self.curve.name][:-KNOTS], *heights.tolist()
        return replace(model, effects={**model.effects, self.curve.name: own})

    @property
    def name(self) -> tuple[str, str]:
        """Where it enters, and against what."""
        return self.enters, self.against

    def remembering(self, model: Model) -> Slot:
        """Return it with the memory that a model's curve has."""
        return replace(self, memory=model.effects[self.curve.name][2])

    @property
    def absorbed(self) -> Array:
        """Heights that the model's own numbers make up for, shape (knots, k): what is even, on either side of zero."""
        if self.enters in FROM_NOTHING:
            return np.zeros((KNOTS, 0))
        if self.name == ('flow', 'error'):
            charging = np.heaviside(self.knots, 0.5)
            return np.column_stack([charging, 1.0 - charging])
        return np.ones((KNOTS, 1))

    @property
    def knots(self) -> Array:
        """Where its knots are, shape (knots,)."""
        place = np.linspace(-1.0, 1.0, KNOTS)
        share = place * self.crowd / (1.0 + self.crowd - np.abs(place))
        return np.asarray(self.middle + share * np.where(share > 0.0, self.high - self.middle, self.middle - self.low))

    def along(self, at: Array) -> Array:
        """Return what each knot's height adds to the curve's at some points of its range, shape (points, knots)."""
        at = np.clip(at, self.low, self.high)
        share = (at - self.middle) / np.where(at > self.middle, self.high - self.middle, self.middle - self.low)
        place = 0.5 * (KNOTS - 1) * (1.0 + share * (1.0 + self.crowd) / (np.abs(share) + self.crowd))
        return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(KNOTS)), 0.0))


@dataclass(frozen=True)
class Promise:
    """
    What a curve in some place promises.

    Attributes
    ----------
    slot
        The place.
    evidence
        By how much it raises twice the log likelihood.
    left
        Share of the residual's squares that it leaves.
    penalty
        Of its roughness: the variance of the noise over that of its bends.
    heights
        In the slot's unit, shape (knots,).

    """

    slot: Slot
    evidence: float
    left: float
    penalty: float
    heights: Array


@dataclass(frozen=True)
class Drawn:
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

    promise: Promise
    candidate: Candidate
    begin: Candidate
    others: tuple[tuple[str, str], ...]

    @property
    def name(self) -> tuple[str, str]:
        """Where it enters, and against what."""
        return self.promise.slot.name


class Laws:
    """
    Curves that may be drawn beside models; none is fitted twice.

    Parameters
    ----------
    candidates
        Fits models.

    """

    def __init__(self, candidates: Candidates) -> None:
        self.candidates = candidates
        self._excerpt = candidates.train.spread(_SKETCHED)
        self._known: dict[Candidate, list[Drawn]] = {}
        self._sketches: dict[Candidate, list[_Sketch]] = {}
        self._promised: dict[Candidate, list[Promise]] = {}

    def may_explain(self, begin: Candidate) -> bool:
        """Return whether a curve promises most of what is above the noise beside a model."""
        promised, above = self._promises(begin), _size(self.candidates, begin) ** 2 - 1.0
        return any(one.left * (above + 1.0) - 1.0 < _MOST_OF_ALL * above for one in promised)

    def best(self, begins: Sequence[Candidate], known: Sequence[Candidate]) -> Drawn | None:
        """
        Return the curve that foretells best beside one of some models; None where none explains what is left.

        An effect of the library that explains as much is preferred: `known` are models with what was found of it.
        """
        least = min((one.rss for one in known), default=math.inf)
        found: list[Drawn] = []
        for begin in sorted(begins, key=self._least_promised):
            if self._least_promised(begin) < least:
                found += [one for one in self._beside(begin) if self.is_better(one, [begin, *known])]
            if any(small_enough(self.candidates.residual_tests(one.candidate)) for one in found):
                break  # what leaves noise beside one core is not looked for beside another
        if not found:
            return None
        best = min(found, key=lambda one: _error(one.candidate))
        if not self._is_near_noise(best):
            return None
        alike = [one.name for one in found if _error(one.candidate) < _ALIKE * _error(best.candidate)]
        return replace(best, others=tuple(dict.fromkeys(name for name in alike if name != best.name)))

    def beside_core(self, core: Candidate, begin: Candidate, name: str, known: Sequence[Candidate]) -> Drawn | None:
        """Return a law beside a core that finds its place only beside the law, which was drawn beside another one."""
        sketches = self._sketches.get(begin)
        is_nearer = _error(core) < _CLEARLY * _error(begin)
        least = _MUCH_BETTER**2 * self._left(begin.model)
        if not sketches or not is_nearer or sketches[0].found.cost > least:
            return None
        drawn = self.candidates.finished(sketches[0].found.model, begin.model)
        model = self.candidates.with_core(drawn, name).model
        there = self.candidates.finished(replace(model, effects=core.effects), core.model)
        self._known[core] = [replace(one, begin=core) for one in self._beside(there)]
        return self.best([core], known)

    def beside_effects(self, begin: Candidate, known: Sequence[Candidate]) -> Drawn | None:
        """Return a law beside effects that were sought beside the law: what was found without it may be astray."""
        sketches = self._sketches.get(begin)
        if not sketches:
            return None
        drawn = self.candidates.finished(sketches[0].found.model, begin.model)
        for _ in range(_MOST_BESIDE):
            beside = self.candidates.beside(drawn, self.candidates.names(drawn))
            better = [one for one in beside.values() if _is_better(self.candidates, one, drawn)]
            if not better:
                break
            drawn = min(better, key=lambda one: one.rss)
        effects = {name: own for name, own in drawn.effects.items() if name in self.candidates.channel.library}
        if not effects:
            return None
        return self.best([self.candidates.finished(replace(drawn.model, effects=effects), begin.model)], known)

    def is_better(self, drawing: Drawn, known: Sequence[Candidate]) -> bool:
        """Return whether a curve explains more than every one of some models."""
        return all(_is_better(self.candidates, drawing.candidate, other) for other in dict.fromkeys(known))

    def is_near(self, drawing: Drawn, other: Candidate) -> bool:
        """Return whether a model does nearly as well as one with a curve: on the validation part, and on everything."""
        return all(size(other) * _CLEARLY < size(drawing.candidate) for size in (_error, self._size))

    def is_noise(self, one: Candidate) -> bool:
        """Return whether what a model leaves is noise in kind and hardly larger: where none was seen it may be."""
        return explained(self.candidates.residual_tests(one)) and _size(self.candidates, one) < _NEAR_NOISE

    def is_far_better(self, drawing: Drawn, others: Sequence[Candidate]) -> bool:
        """Return whether a curve errs so much less than every one of some models that hardly two of them make up."""
        return all(_error(drawing.candidate) < _FAR_BETTER * _error(one) for one in others)

    def _beside(self, begin: Candidate) -> list[Drawn]:
        """
        Return the most promising curves beside a model, fitted to the train part.

        Short stretches tell before which these are, and whether they do better with their knots elsewhere.
        """
        if begin not in self._known:
            promised = _worth_a_fit(self._promises(begin), self._size(begin))
            sketches = self._sketched(begin, [(one, self._begun(begin, one)) for one in promised])
            sharper = [other for one in sketches[:_SHARPENED] for other in _otherwise(one)]
            sketches = _best_first(sketches + self._sketched(begin, sharper))
            self._sketches[begin] = sketches
            noise = self.candidates.noise**2 * self._excerpt.samples
            farthest = (_FARTHEST * self._near_noise(begin) / _NEAR_NOISE) ** 2 * noise
            most = min(_RIVALLING * sketches[0].found.cost, farthest) if sketches else 0.0
            near = _few_of_each([one for one in sketches if one.found.cost < most])
            self._known[begin] = self._finished(begin, near[:_FITTED])
        return self._known[begin]

    def _finished(self, begin: Candidate, sketches: Sequence[_Sketch]) -> list[Drawn]:
        """Return sketches fitted to the train part."""
        models = each(lambda one: fitted(self.candidates.train, one.found.model, one.promise).model, sketches)
        finished = [self.candidates.finished(model, begin.model) for model in models]
        return [
            Drawn(one.promise, own, begin, ())
            for one, own in zip(sketches, finished)
            if one.promise.slot.curve.name in own.effects
        ]

    def _is_near_noise(self, drawing: Drawn) -> bool:
        """Return whether what a law leaves is noise in kind, or hardly larger and no other cause's."""
        tests = self.candidates.residual_tests(drawing.candidate)
        follows = any(one.name == 'inputs' and not one.passed for one in tests)
        if follows and self.candidates.channel.may_hide(self.candidates.train.experiments):
            return False
        return small_enough(tests) or _size(self.candidates, drawing.candidate) < self._near_noise(drawing.begin)

    def _near_noise(self, begin: Candidate) -> float:
        """Return the size up to which what a law leaves is hardly larger than the noise, which is 1."""
        return max(_NEAR_NOISE, _SMOOTHED * _size(self.candidates, begin))

    def _size(self, candidate: Candidate) -> float:
        return _size(self.candidates, candidate)

    def _least_promised(self, begin: Candidate) -> float:
        """Return the least sum of squares that a curve promises to leave."""
        return min((one.left for one in self._promises(begin)), default=1.0) * begin.rss

    def _promises(self, begin: Candidate) -> list[Promise]:
        """Return what curves promise; none where no part is left to foretell."""
        if begin not in self._promised:
            told = self.candidates.baseline.validation_rmse is not None
            self._promised[begin] = promises(self.candidates, begin) if told else []
        return self._promised[begin]

    def _begun(self, begin: Candidate, promise: Promise) -> Model:
        """Return a model with so much of a promise as mends it: the whole of a large law may lead astray."""
        models = [beside(begin.model, promise, share) for share in _SHARES]
        return next((one for one in models if self._left(one) < self._left(begin.model)), models[-1])

    def _left(self, model: Model) -> float:
        """Return the sum of squares that a model leaves of the short stretches."""
        with np.errstate(over='ignore'):  # of one that runs away
            return sum(float(run @ run) for run in self._excerpt.residuals(self._excerpt.simulate(model)))

    def _sketched(self, begin: Candidate, some: Sequence[tuple[Promise, Model]]) -> list[_Sketch]:
        """Return curves fitted to short stretches, from models that have them, the best first."""
        share = independent_share(self.candidates.resting_coefficients(begin))

        def sketch(promise: Promise, model: Model) -> _Sketch:
            model = fitted(self._excerpt, model, promise).model
            promise = replace(promise, slot=promise.slot.remembering(model))
            again = renewed(self._excerpt, model, promise, share)
            return _Sketch(again, fitted(self._excerpt, model, again))

        return _best_first(each(lambda one: sketch(*one), some))


class _Sketch(NamedTuple):
    """A curve that was fitted to an excerpt."""

    promise: Promise
    found: Optimum


def _best_first(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    return sorted(sketches, key=lambda one: one.found.cost)


def _few_of_each(sketches: Sequence[_Sketch]) -> list[_Sketch]:
    """Return the best few of each place, so that others have their turn."""
    ranks: Counter[tuple[str, str]] = Counter()
    few = []
    for one in sketches:
        ranks[one.promise.slot.name] += 1
        if ranks[one.promise.slot.name] <= _OF_EACH:
            few.append(one)
    return few


def _otherwise(sketch: _Sketch) -> list[tuple[Promise, Model]]:
    """Return a curve with its knots elsewhere: where it bends most, or of what goes both ways nearer to nothing."""
    slot, model = sketch.promise.slot, sketch.found.model
    heights = slot.heights(model)
    others = [replace(slot, middle=_bend(slot, heights), crowd=crowd) for crowd in _CROWDS]
    return [
        (replace(sketch.promise, slot=one), one.on(model, slot.along(one.knots) @ heights))
        for one in others
        if one != slot
    ]


def _bend(slot: Slot, heights: Array) -> float:
    """Return where a curve bends most; of what goes both ways its middle, where nothing moves."""
    if slot.against in slot.curve.both_ways:
        return slot.middle
    bends = np.abs(np.diff(np.diff(heights) / np.diff(slot.knots)))
    return float(slot.knots[1 + int(np.argmax(bends))])


def beside(model: Model, promise: Promise, share: float = 1.0) -> Model:
    """Return a model with a share of a curve as it is promised."""
    return promise.slot.on(model, share * promise.slot.unit * promise.heights)


def _worth_a_fit(promised: Sequence[Promise], size: float) -> list[Promise]:
    """Return the most promising of each place and memory, if they may bring a residual down to the noise, of 1."""
    best: dict[tuple[str, str, float], Promise] = {}
    for one in promised:
        may = one.left * size**2 - 1.0 < _MOST_LEFT * (size**2 - 1.0)
        if may and one.evidence > max(_LEAST_EVIDENCE, _PROMISING * promised[0].evidence):
            best.setdefault((*one.slot.name, one.slot.memory), one)
    return list(best.values())[:_FITTED]


def _size(candidates: Candidates, candidate: Candidate) -> float:
    """Return the root mean square of what a model leaves, over the noise."""
    (size,) = (one.statistic for one in candidates.residual_tests(candidate) if one.name == 'noise_floor')
    return size


def _error(candidate: Candidate) -> float:
    """Return the error of the validation part, of the train part where there is none [SI]."""
    squares = candidate.rss / max(sum(one.size for one in candidate.residuals), 1)
    error = math.sqrt(squares) if candidate.validation_rmse is None else candidate.validation_rmse
    return error if math.isfinite(error) else math.inf


def _is_better(candidates: Candidates, candidate: Candidate, begin: Candidate) -> bool:
    coefficients = autoregression(candidate.residuals)
    criteria = [candidates.train.criterion(one.residuals, one.unknowns, coefficients) for one in (begin, candidate)]
    tells = criteria[0] - criteria[1] > _LEAST_EVIDENCE or _error(candidate) < _CLEARLY * _error(begin)
    return tells and _error(candidate) < (1.0 - _LEAST_DROP) * _error(begin)


# where it may enter, and what that promises


def slots(candidates: Candidates, begin: Candidate) -> list[Slot]:
    """Return all places for a curve beside a model, over what the recordings have visited."""
    ranges, curve = _ranges(candidates, begin), candidates.channel.curve
    noise = math.sqrt(begin.rss / candidates.train.samples)
    most = {name: max(map(abs, ends)) for name, ends in ranges.items()}
    units = candidates.channel.law_units(candidates.train.experiments, begin.model, noise, most)
    found = []
    for against, places in curve.asked.items():
        low, high = ranges[against]
        if high - low <= _LEAST_VISITED:
            continue
        for enters in filter(units.__contains__, places):
            memories = curve.memories.get((enters, against), (curve.memory,))
            both_ways = _CROWDS[:1] if len(memories) > 1 else _CROWDS
            crowds = both_ways if against in curve.both_ways else curve.crowds
            found += [
                Slot(enters, against, memory, low, high, 0.5 * (low + high), crowd, units[enters], curve)
                for memory, crowd in product(memories, crowds)
            ]
    return found


def _ranges(candidates: Candidates, begin: Candidate) -> dict[str, tuple[float, float]]:
    """Return what the train and validation parts have visited of each variable; of speeds the same both ways."""
    curve = candidates.channel.curve
    seen: dict[str, list[Array]] = {name: [] for name in curve.against}
    for one, simulated in zip(candidates.learn.experiments, begin.simulated):
        for name, values in candidates.channel.variables(one, simulated, begin.model).items():
            end = 0.0 if name in curve.whole else _VISITED
            seen[name].append(np.quantile(values, (end, 1.0 - end)))
    ranges = {name: (float(np.min(ends)), float(np.max(ends))) for name, ends in seen.items()}
    for name in curve.both_ways:
        most = max(map(abs, ranges[name]))
        ranges[name] = -most, most
    return ranges


def promises(candidates: Candidates, begin: Candidate, some: Sequence[Slot] | None = None) -> list[Promise]:
    """Return what a curve in some places, or in all, promises beside a model, the most promising one first."""
    complement = Complement(candidates.learn.spread(_ASKED), begin.model)
    residual = complement.residual
    share = independent_share(candidates.resting_coefficients(begin))

    def promised(some: Sequence[Slot]) -> list[Promise]:
        starts = [slot.parameters(slot.unit * coarse) for slot in some for coarse in _COARSE]
        changes = np.hsplit(complement.left(complement.changes(candidates.channel.curve.name, starts)), len(some))
        return [_promise(slot, residual, own, share) for slot, own in zip(some, changes)]

    places = slots(candidates, begin) if some is None else some
    together = [places[first : first + COUNT] for first in range(0, len(places), COUNT)]
    return sorted(chain.from_iterable(each(promised, together)), key=lambda one: -one.evidence)


def _promise(slot: Slot, residual: Array, changes: Array, share: float) -> Promise:
    """
    Return what the coarse heights of a curve promise, which change the simulation so, shape (n, coarse).

    Heights are normal, with the inverse of the roughness as their covariance: the evidence is the marginal likelihood,
    of which the noise's variance is profiled out, at its best penalty.
    """
    if not np.all(np.isfinite(changes)) or not np.any(changes):
        return Promise(slot, -math.inf, 1.0, 1.0, np.zeros(KNOTS))
    root = np.linalg.cholesky(_COARSE @ roughness() @ _COARSE.T)
    left, sizes, right = np.linalg.svd(np.linalg.solve(root, changes.T).T, full_matrices=False)
    along = left.T @ residual
    power, count = float(residual @ residual), residual.size * share
    penalties = _PENALTIES * float(np.max(sizes)) ** 2
    taken = sizes**2 / (sizes**2 + penalties[:, None])
    remaining = 1.0 - taken @ along**2 / max(power, 1e-300)
    values = count * np.log(np.maximum(remaining, 1e-300)) - np.sum(np.log1p(-taken), axis=1)
    best = int(np.argmin(values))
    penalty = float(penalties[best])
    heights = np.linalg.solve(root.T, right.T @ (sizes / (sizes**2 + penalty) * along)) @ _COARSE
    return Promise(slot, -float(values[best]), float(remaining[best]), penalty, heights)


def roughness() -> Array:
    """Return the matrix of a curve's squared bends, and of a little of its height, shape (knots, knots)."""
    bends = np.diff(np.eye(KNOTS), 2, axis=0)
    return np.asarray(bends.T @ bends + _RIDGE * np.eye(KNOTS))


# a fit


def fitted(likelihood: Likelihood, begin: Model, promise: Promise) -> Optimum:
    """Return a model that has a curve, fitted with a penalty on its roughness, which counts among what it leaves."""
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, begin)
    bends = penalty_of(unknowns, promise)

    def evaluate(point: Array) -> Quadratic:
        here = likelihood.evaluate(unknowns, point)
        slope = bends @ point
        return Quadratic(here.total + float(point @ slope), here.gradient + slope, here.normal + bends)

    start, lower, upper = unknowns.start, unknowns.lower, unknowns.upper
    point, reached = least_squares(evaluate, start, lower, upper, *_FINE, longest=unknowns.longest_step)
    return Optimum(unknowns.model(point), reached.total)


def heights_of(unknowns: Unknowns, slot: Slot) -> list[int]:
    """Return which unknowns are the heights of a curve."""
    return [index for index, one in enumerate(unknowns.table) if one.name.startswith(f'{slot.curve.name}.w')]


def renewed(likelihood: Likelihood, model: Model, promise: Promise, share: float) -> Promise:
    """
    Return a promise with the penalty that goes with a fitted curve's bends and with what it leaves (MacKay, 1992).

    Before the fit most of what is left is the law itself, and passes for noise, under which a curve seems smooth.
    `share` is how many independent samples a sample is worth.
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    here = likelihood.evaluate(unknowns, unknowns.start)
    bends = penalty_of(unknowns, promise)
    if not here.is_finite:
        return promise
    told = KNOTS - float(np.sum(np.linalg.pinv(here.normal + bends, hermitian=True) * bends))
    heights = promise.slot.heights(model) / promise.slot.unit
    variance = here.total / (likelihood.samples * share)
    penalty = variance * told / max(float(heights @ roughness() @ heights), 1e-300)
    return replace(promise, penalty=float(np.clip(penalty / promise.penalty, *_RENEWED)) * promise.penalty)


def penalty_of(unknowns: Unknowns, promise: Promise) -> Array:
    """Return the matrix of the penalty on a curve, as unknowns are searched, shape (k, k)."""
    own = heights_of(unknowns, promise.slot)
    scales = unknowns.scales(unknowns.start)[own] / promise.slot.unit
    matrix = np.zeros((len(unknowns.table), len(unknowns.table)))
    matrix[np.ix_(own, own)] = promise.penalty * roughness() * np.outer(scales, scales)
    return matrix
