# SPDX-License-Identifier: Apache-2.0
"""
Which core a recording needs: the linear one, or one with the physics that it leaves out.

Full physics is no missing effect. Where the linear core leaves more than noise, the other core is fitted, and both are
searched for effects as far as that may change the answer; the criterion decides. The linear core keeps what it explains
as well, unless by effects that the other core holds anyway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from cfd_pneumatic.identification.data import LINEAR, PHYSICAL
from cfd_pneumatic.identification.residual import autoregression
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.laws import OF_VALVES, Drawn, Laws
from cfd_pneumatic.identification.search.stepwise import ALIKE, HOPELESS, TIE, Search, SearchResult, Step, Trial
from cfd_pneumatic.lazy import lazy_property

_NONE: Mapping[str, tuple[str, ...]] = MappingProxyType({})
_MUCH = 3.0  # times the noise
_HOPEFUL = 1.2  # times what another leaves: what leaves more roughly will not come down to it in the end
_RIVALLING = 30.0  # times a law's squares: an effect that leaves more roughly will not come near it
_CLEARLY = 0.95  # of another's squares, of which those of the validation part were not fitted


class Cores:
    """
    The cores that a model may have, and what is found beside them; none is fitted twice.

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
        self._only = self._name is not None and core == PHYSICAL
        self._linear = Search(candidates, candidates.baseline)
        self._led: list[Candidate] = []  # what a law led to: an effect that does as well

    @property
    def begins(self) -> list[Candidate]:
        """Every core that is asked for, without effects."""
        if self._name is None:
            return [self.candidates.baseline]
        return [self._alone] if self._only else [self.candidates.baseline, self._alone]

    @property
    def tried(self) -> tuple[Trial, ...]:
        """What came of each effect beside the linear core."""
        return () if self._only else self._first.trials()

    @lazy_property
    def _first(self) -> Step:
        """Each effect beside the linear core, to the end only where it may do as well as the other core."""
        baseline, most = self.candidates.baseline, math.inf
        if self._name is not None:
            most = HOPELESS * self.candidates.roughly_left_with_core(baseline, self._name)
        return self._linear.step(baseline, most)

    @lazy_property
    def _alone(self) -> Candidate:
        """The other core, fitted to the end only where it may do as well as the linear one with an effect."""
        assert self._name is not None
        most = math.inf
        if not self._only:
            best = min(self._first.candidates.values(), key=lambda one: one.rss, default=self.candidates.baseline)
            most = self._hopeful(best)
        return self.candidates.with_core(self.candidates.baseline, self._name, most)

    def searched(self) -> SearchResult:
        """Return what is found beside a core; by default beside that which the recordings need."""
        if self._name is None:
            return self._linear.run()
        if self._only:
            return self._beside(self._alone)
        if self._is_full_physics():
            return SearchResult(self._alone, {}, ())
        found = self._linear.run()
        enough = self.candidates.leaves_noise(found.model) and len(found.model.effects) <= 1
        begins = [self._alone]
        if found.model.effects:
            most = self._hopeful(found.model) if enough else math.inf
            begins.append(self.candidates.with_core(found.model, self._name, most))
        if enough and not any(_preferred(self.candidates, one, found.model, found.alternatives) for one in begins):
            return found  # what the linear core explains with one effect is not looked for elsewhere
        fresh = [] if enough else begins
        begins = [self._alone, *(Search(self.candidates, self._alone).pruned(one) for one in begins[1:]), *self._led]
        begins.sort(key=lambda one: one.rss)
        begin = begins[0]
        beside = SearchResult(begin, {}, ()) if self.candidates.leaves_noise(begin) else self._beside(begin, fresh)
        for other in begins[1:]:
            if self.candidates.size(beside.model) > _MUCH:  # the way there may have led astray
                again = self._beside(other, fresh)
                begin, beside = min((begin, beside), (other, again), key=lambda pair: pair[1].model.rss)
        if not _preferred(self.candidates, beside.model, found.model, found.alternatives):
            return found
        known = {name: others for name, others in found.alternatives.items() if name in begin.effects}
        return SearchResult(beside.model, {**known, **beside.alternatives}, found.tried + beside.tried)

    def for_memory(self) -> SearchResult:
        """
        Return the core of what looks like noise with a memory beside the linear one.

        Sensors have such noise, and so has physics that no test of the inputs names: where the other core takes it
        away, it was no noise.
        """
        baseline = self.candidates.baseline
        if self._name is not None:
            alone = self.candidates.with_core(baseline, self._name)
            if self.candidates.leaves_noise(alone) and _preferred(self.candidates, alone, baseline):
                return SearchResult(alone, {}, ())
        return SearchResult(baseline, {}, ())

    def law(self, laws: Laws) -> Drawn | None:
        """
        Return a law that leaves noise beside a core alone, or hardly more, where no single effect comes near it.

        So much is known before effects are looked for in company, which takes longest where none is the answer. An
        effect that does as well beside the core is where `searched` goes on from.
        """
        if self._name is not None and not self._only and self._is_full_physics():
            return None
        singles = [] if self._only else list(self._first.candidates.values())
        if any(laws.is_noise(one) for one in sorted(singles, key=lambda one: one.rss)[:1]):
            return None
        if not any(laws.may_explain(begin) for begin in self.begins):
            return None
        drawing = laws.best(self.begins, singles) or self.beside_law(laws, singles)
        if drawing is None or drawing.name == OF_VALVES:
            return None
        rivals = self._rivals(drawing)
        near = [one for one in rivals if laws.is_near(drawing, one)]
        self._led = sorted((one for one in near if one.model.core), key=self.candidates.squares)[:1]
        alone = self.candidates.leaves_noise(drawing.candidate) or laws.is_far_better(drawing, [*singles, *rivals])
        return drawing if alone and not near else None

    def beside_law(self, laws: Laws, known: Sequence[Candidate]) -> Drawn | None:
        """Return a law beside the other core, which finds its place only beside the law; see `Laws.beside_core`."""
        if self._name is None or self._only:
            return None
        return laws.beside_core(self._alone, self.candidates.baseline, self._name, known)

    def _rivals(self, drawing: Drawn) -> list[Candidate]:
        """
        Return single effects in a law's place.

        They begin beside the core as it stands beside the law: one that was fitted without either is astray.
        """
        model = drawing.candidate.model
        there = self.candidates.finished(replace(model, effects=drawing.begin.effects), drawing.begin.model)
        names, _ = self.candidates.promising(there, self.candidates.names(there))
        most = _RIVALLING * self.candidates.roughly_left(drawing.candidate)
        return list(self.candidates.beside(there, names, most).values())

    def _is_full_physics(self) -> bool:
        """Return whether the other core alone leaves noise, and no effect beside the linear one does as well."""
        singles = self._first.candidates.values()
        alone = self._alone
        return self.candidates.leaves_noise(alone) and all(_preferred(self.candidates, alone, one) for one in singles)

    def _beside(self, begin: Candidate, fresh: Sequence[Candidate] = ()) -> SearchResult:
        """
        Return what is found beside a core.

        Where more than noise is left beside effects, the core is fitted once more from its starts: its many numbers may
        be stuck, unless they are `fresh` from there.
        """
        assert self._name is not None
        found = Search(self.candidates, begin).run()
        if not found.model.effects or found.model in fresh or self.candidates.leaves_noise(found.model):
            return found
        again = self.candidates.with_core(found.model, self._name)
        return replace(found, model=min(found.model, again, key=lambda one: one.rss))

    def _hopeful(self, other: Candidate) -> float:
        """Return the mean square above which a rough fit will not come to do as well as a model that leaves noise."""
        return _HOPEFUL * self.candidates.roughly_left(other) if self.candidates.leaves_noise(other) else math.inf


def _preferred(
    candidates: Candidates, one: Candidate, other: Candidate, alternatives: Mapping[str, tuple[str, ...]] = _NONE
) -> bool:
    """
    Return whether a model with another core is preferred to one with the linear core.

    It is where the validation part says so, and either the criterion or both parts together do. A tie will do, and the
    core is not charged for its own numbers, which data sheets have, where it holds the effects that it takes the place
    of, or their `alternatives`; and where it leaves noise instead of one of several effects, or of more than noise.
    """
    if not one.model.core:  # it ran away
        return False
    errors = one.validation_rmse, other.validation_rmse
    foretells = errors[0] is not None and errors[1] is not None and errors[0] < errors[1]
    if foretells and candidates.squares(one) < _CLEARLY * candidates.squares(other):
        return True
    train = candidates.train
    (core,) = (candidates.channel.effects[name] for name in one.model.core)
    coefficients = autoregression(min((one, other), key=lambda model: model.rss).residuals)
    more = set(other.effects) - set(one.effects)
    is_held = bool(more) and all({name, *alternatives.get(name, ())} & set(core.covers) for name in more)
    several = len(other.effects) > max(len(one.effects), 1)
    is_instead = is_held or ((several or not candidates.leaves_noise(other)) and candidates.leaves_noise(one))
    charged = one.unknowns - (len(core.parameters) if is_instead else 0)
    criteria = [
        train.criterion(model.residuals, unknowns, coefficients)
        for model, unknowns in ((one, charged), (other, other.unknowns))
    ]
    if is_instead:
        return criteria[0] < criteria[1] + TIE and candidates.squares(one) < ALIKE**2 * candidates.squares(other)
    return (foretells or None in errors) and criteria[0] < criteria[1]
