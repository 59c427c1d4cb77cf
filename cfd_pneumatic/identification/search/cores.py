"""
Which core a recording needs: the linear one, or one with the physics that it leaves out.

Full physics is no missing effect. Where the linear core leaves more than noise, the other core is fitted, and both are
searched for effects as far as that may change the answer; the criterion decides. The linear core keeps what it explains
as well, unless by effects that the other core holds anyway.
"""

from __future__ import annotations

from cfd_pneumatic.identification.data.options import LINEAR, PHYSICAL
from cfd_pneumatic.identification.residual.autoregression import autoregression
from cfd_pneumatic.identification.residual.tests import explained
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.stepwise import TIE, Search, SearchResult, alike


def searched(candidates: Candidates, core: str) -> SearchResult:
    """Return what is found beside a core, one of `Options.core`; by default beside that which the recordings need."""
    linear = Search(candidates, candidates.baseline)
    names = list(candidates.channel.cores)
    if core == LINEAR or not names:
        return linear.run()
    other = candidates.with_core(candidates.baseline, names[0])
    if core == PHYSICAL:
        return Search(candidates, other).run()
    if _leaves_noise(candidates, other):
        single = linear.step(candidates.baseline).candidates.values()
        if all(_preferred(candidates, other, one) for one in single):
            return SearchResult(other, {}, ())
    found = linear.run()
    if _leaves_noise(candidates, found.model) and not _preferred(candidates, other, found.model):
        return found  # what the linear core explains is not looked for elsewhere
    begins = [other, candidates.with_core(found.model, names[0])] if found.model.effects else [other]
    best = min(begins, key=lambda one: one.rss)
    beside = Search(candidates, best).run()
    return beside if _preferred(candidates, beside.model, found.model) else found


def _leaves_noise(candidates: Candidates, one: Candidate) -> bool:
    return explained(candidates.residual_tests(one))


def _preferred(candidates: Candidates, one: Candidate, other: Candidate) -> bool:
    """
    Return whether a model with another core is preferred to one with the linear core.

    It is where the criterion and the validation part say so; beside effects that the core holds anyway, a tie will do.
    """
    train, covers = candidates.train, candidates.channel.effects[next(iter(one.model.core))].covers
    coefficients = autoregression(min((one, other), key=lambda model: model.rss).residuals)
    gain = train.criterion(other.residuals, other.unknowns, coefficients) - train.criterion(
        one.residuals, one.unknowns, coefficients
    )
    if other.effects and set(other.effects) <= set(covers):
        return gain > -TIE and alike(one, other)
    errors = one.validation_rmse, other.validation_rmse
    return gain > 0.0 and (errors[0] is None or errors[1] is None or errors[0] < errors[1])
