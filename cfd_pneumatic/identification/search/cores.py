"""
Which core a recording needs: the linear one, or one with the physics that it leaves out.

Full physics is no missing effect. Where the linear core leaves more than noise, the other core is fitted, and both are
searched for effects as far as that may change the answer; the criterion decides. The linear core keeps what it explains
as well, unless by effects that the other core holds anyway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from cfd_pneumatic.identification.data.options import LINEAR, PHYSICAL
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.residual.autoregression import autoregression
from cfd_pneumatic.identification.residual.tests import explained
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.stepwise import ALIKE, TIE, Search, SearchResult

_NONE: Mapping[str, tuple[str, ...]] = MappingProxyType({})
_MUCH = 3.0  # times the noise
_HOPEFUL = 1.2  # times what another leaves: what leaves more roughly will not come down to it in the end
_CLEARLY = 0.95  # of another's squares, of which those of the validation part were not fitted


def searched(candidates: Candidates, core: str) -> SearchResult:
    """Return what is found beside a core, one of `Options.core`; by default beside that which the recordings need."""
    linear = Search(candidates, candidates.baseline)
    names = list(candidates.channel.cores)
    if core == LINEAR or not names:
        return linear.run()
    if core == PHYSICAL:
        return _beside(candidates, candidates.with_core(candidates.baseline, names[0]), names[0])
    singles = linear.step(candidates.baseline).candidates.values()
    best = min(singles, key=lambda one: one.rss, default=candidates.baseline)
    alone = candidates.with_core(candidates.baseline, names[0], _hopeful(candidates, best))
    if _leaves_noise(candidates, alone) and all(_preferred(candidates, alone, one) for one in singles):
        return SearchResult(alone, {}, ())
    found = linear.run()
    enough = _leaves_noise(candidates, found.model) and len(found.model.effects) <= 1
    begins = [alone]
    if found.model.effects:
        most = _hopeful(candidates, found.model) if enough else math.inf
        begins.append(candidates.with_core(found.model, names[0], most))
    if enough and not any(_preferred(candidates, one, found.model, found.alternatives) for one in begins):
        return found  # what the linear core explains with one effect is not looked for elsewhere
    begins = [alone, *(Search(candidates, alone).pruned(one) for one in begins[1:])]
    begins.sort(key=lambda one: one.rss)
    begin = begins[0]
    beside = SearchResult(begin, {}, ()) if _leaves_noise(candidates, begin) else _beside(candidates, begin, names[0])
    for other in begins[1:]:
        if _leaves_much(candidates, beside.model):  # the way there may have led astray
            again = _beside(candidates, other, names[0])
            begin, beside = min((begin, beside), (other, again), key=lambda pair: pair[1].model.rss)
    if not _preferred(candidates, beside.model, found.model, found.alternatives):
        return found
    known = {name: others for name, others in found.alternatives.items() if name in begin.effects}
    return SearchResult(beside.model, {**known, **beside.alternatives}, found.tried + beside.tried)


def core_for_memory(candidates: Candidates, core: str) -> SearchResult:
    """
    Return the core of what looks like noise with a memory beside the linear one.

    Sensors have such noise, and so has physics that no test of the inputs names: where the other core takes it away,
    it was no noise.
    """
    names = list(candidates.channel.cores)
    if core != LINEAR and names:
        alone = candidates.with_core(candidates.baseline, names[0])
        if _leaves_noise(candidates, alone) and _preferred(candidates, alone, candidates.baseline):
            return SearchResult(alone, {}, ())
    return SearchResult(candidates.baseline, {}, ())


def _beside(candidates: Candidates, begin: Candidate, core: str) -> SearchResult:
    """
    Return what is found beside a core.

    Where more than noise is left beside effects, the core is fitted once more from its starts: its many numbers may be
    stuck.
    """
    found = Search(candidates, begin).run()
    if not found.model.effects or _leaves_noise(candidates, found.model):
        return found
    again = candidates.with_core(found.model, core)
    return replace(found, model=min(found.model, again, key=lambda one: one.rss))


def _hopeful(candidates: Candidates, other: Candidate) -> float:
    """Return the mean square above which a rough fit will not come to do as well as a model that leaves noise."""
    return _HOPEFUL * candidates.roughly_left(other) if _leaves_noise(candidates, other) else math.inf


def _leaves_noise(candidates: Candidates, one: Candidate) -> bool:
    return explained(candidates.residual_tests(one))


def _leaves_much(candidates: Candidates, one: Candidate) -> bool:
    return any(test.name == 'noise_floor' and test.statistic > _MUCH for test in candidates.residual_tests(one))


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
    train = candidates.train
    (core,) = (candidates.channel.effects[name] for name in one.model.core)
    coefficients = autoregression(min((one, other), key=lambda model: model.rss).residuals)
    more = set(other.effects) - set(one.effects)
    is_held = bool(more) and all({name, *alternatives.get(name, ())} & set(core.covers) for name in more)
    several = len(other.effects) > max(len(one.effects), 1)
    is_instead = is_held or ((several or not _leaves_noise(candidates, other)) and _leaves_noise(candidates, one))
    charged = one.unknowns - (len(core.parameters) if is_instead else 0)
    criteria = [
        train.criterion(model.residuals, unknowns, coefficients)
        for model, unknowns in ((one, charged), (other, other.unknowns))
    ]
    if is_instead:
        return criteria[0] < criteria[1] + TIE and _squares(candidates, one) < ALIKE**2 * _squares(candidates, other)
    errors = one.validation_rmse, other.validation_rmse
    if errors[0] is None or errors[1] is None:
        return criteria[0] < criteria[1]
    clearly = _squares(candidates, one) < _CLEARLY * _squares(candidates, other)
    return errors[0] < errors[1] and (clearly or criteria[0] < criteria[1])


def _squares(candidates: Candidates, one: Candidate) -> float:
    """Return the sum of squares that a model leaves of train and validation."""
    unseen = sum(np.count_nonzero(run.part == PARTS.index('validation')) for run in candidates.learn.experiments)
    return one.rss + (unseen * one.validation_rmse**2 if one.validation_rmse is not None else 0.0)
