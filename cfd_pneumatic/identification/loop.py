# SPDX-License-Identifier: Apache-2.0
"""
Closing the loop: what a channel's model lacks, added to it, and the error before and after.

Ask whether the residual of the model without effects is noise; if not, ask which core the recordings need and search
for effects beside it; fit what was found to train and validation together and compare before and after once, on the
test part; say what was found, or that it is not known.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.conclusion import (
    Conclusion,
    compared,
    next_experiment,
    not_added,
    shortage_of,
    verdict_of,
    within,
)
from cfd_pneumatic.identification.data import AUTO, LINEAR, PHYSICAL, Tolerance
from cfd_pneumatic.identification.fit import Fit, as_data_sheets, find_optimum, summary
from cfd_pneumatic.identification.held_out import contradiction
from cfd_pneumatic.identification.residual import explained
from cfd_pneumatic.identification.search import (
    Candidates,
    Complement,
    Cores,
    Drawn,
    Laws,
    SearchResult,
    Trial,
    invisible,
)
from cfd_pneumatic.identification.search import fitted as fitted_curve
from cfd_pneumatic.identification.shape import Shape, centred, shape_of
from cfd_pneumatic.runtime import each

_NEAR_ENOUGH = 0.01  # by which a search may miss the least sum of squares, in variances of a sample
_MOST_EVALUATIONS = 60
_SEEN = 0.92  # of the error without a law, on validation or test: one that takes less may be a core's that is not exact
_SEEN_IN_COMPANY = 0.8  # beside effects, which it may mend where they are not quite what the device does
_MOSTLY = 0.5  # of the error on the test part: a law that takes so much is shown, though more is left there than before
_DOES_NOTHING = 'does nothing beside the others'
_LAW_INSTEAD = 'a law was drawn instead'
_IDLE = 1.01  # times the sum of squares, up to which an effect that is taken out did nothing


def close_loop(
    before: Fit, core: str = AUTO, searching: bool = True, tolerance: Tolerance = ()
) -> tuple[Fit, Conclusion]:
    """
    Return the fit with the core and the effects that were found, and what it comes to.

    Parameters
    ----------
    before
        Fit of a channel's linear model without effects to train and validation.
    core
        One of `Options.core`.
    searching
        Whether a core and effects are looked for.
    tolerance
        Errors that do not matter.

    """
    likelihood = before.likelihood
    channel, experiments = likelihood.channel, likelihood.experiments
    noise = likelihood.noise(before.model)
    tests = tests_before = likelihood.tests(before.model, noise)
    shortage = shortage_of(experiments)
    after = before
    alternatives: Mapping[str, tuple[str, ...]] = {}
    tried: tuple[Trial, ...] = ()
    unknown: Shape | None = None
    if searching and shortage is None and not all(one.passed for one in tests):
        after, alternatives, tried, unknown = _looked_for(before, core, explained(tests))
    ratio, interval = None, None
    against: list[str] = []
    if after is not before:
        ratio, interval = compared(experiments, before.simulated, after.simulated)
        if ratio >= 1.0:
            clause, tried = not_added(list(after.model.parts), ratio, interval, tried)
            against.append(clause)
            after, alternatives, ratio, interval, unknown = before, {}, None, None, None
    if after is not before:
        noise = likelihood.noise(after.model)
        tests = likelihood.tests(after.model, noise)
    hidden = invisible(likelihood, after.model, noise) if searching and shortage is None else ()
    left = [one.measured - values for one, values in zip(experiments, after.simulated)]
    if searching:
        against += contradiction(experiments, left, noise.std)
    if unknown is not None and unknown.event:
        against.append(unknown.event)
    effects = tuple(name for name in after.model.effects if name != channel.curve.name)
    used = PHYSICAL if after.model.core else LINEAR
    harmless = within(tolerance, channel.quantity.small.unit, experiments, after.simulated)
    law = '' if unknown is None else unknown.words
    verdict, why = verdict_of(
        used, effects, alternatives, tests, shortage, ratio, interval, against, harmless, law, searching, noise.known
    )
    conclusion = Conclusion(
        verdict=verdict,
        why=why,
        core=used,
        effects=effects,
        alternatives=alternatives,
        tried=tried,
        ratio=ratio,
        ratio_interval=interval,
        tests_before=tuple(tests_before),
        tests_after=tuple(tests),
        noise=noise,
        not_visible=hidden,
        next_experiment=next_experiment(hidden, channel.library, shortage),
        unknown=unknown,
        sought=searching,
    )
    return after, conclusion


def _is_explained(fit: Fit) -> bool:
    """Return whether what a fit to train and validation leaves is as noise would be."""
    return explained(fit.likelihood.tests(fit.model, fit.likelihood.noise(fit.model)))


def _looked_for(
    before: Fit, core: str, is_explained: bool
) -> tuple[Fit, Mapping[str, tuple[str, ...]], tuple[Trial, ...], Shape | None]:
    """Return the fit with what was found, alternatives to its effects, what was tried, and its law if it has one."""
    candidates = Candidates(before.likelihood, before.model)
    cores, laws = Cores(candidates, core), Laws(candidates)
    if not is_explained:
        drawing = cores.law(laws)
        with_law = None if drawing is None else _as_drawn(drawing, before, before.model)
        if with_law is not None:
            return with_law[0], {}, cores.tried, with_law[1]
    found = cores.for_memory() if is_explained else cores.searched()
    finished = cache(partial(_finished, before, found))
    may_do = candidates.leaves_noise(found.model) or _is_explained(finished()[0])
    is_noise, several = may_do and laws.is_noise(found.model), len(found.model.effects) > 1
    if several or not is_noise:
        # beside a core alone, for effects that were found instead of a law are none, and else beside them
        asked = [partial(laws.best, cores.begins, searched=True)]
        if not is_noise:
            asked += [partial(cores.beside_law, laws), partial(laws.best, [found.model])]
        if not (is_noise or candidates.channel.cores):
            asked.append(partial(laws.beside_effects, candidates.baseline))
        for ask in asked:
            drawing = ask([found.model])
            is_plainer = several and drawing is not None and not drawing.begin.effects  # one law, for several effects
            if may_do and drawing is not None and not is_plainer and laws.is_near(drawing, found.model):
                continue
            with_law = None if drawing is None else _as_drawn(drawing, before, found.model.model)
            if with_law is not None:
                after, unknown = with_law
                beside = {name: others for name, others in found.alternatives.items() if name in after.model.effects}
                instead = {one.effect for one in found.tried} - after.model.effects.keys()
                return after, beside, _withdrawn(found.tried, instead, _LAW_INSTEAD), unknown
            if drawing is not None:
                break
    return *finished(), None


def _finished(before: Fit, found: SearchResult) -> tuple[Fit, Mapping[str, tuple[str, ...]], tuple[Trial, ...]]:
    """Return what a search found fitted to the end, without what does nothing, alternatives to it, what was tried."""
    if not found.model.model.parts:
        return before, found.alternatives, found.tried
    after = _fitted(before, _without_idle(before, found.model.model))
    idle = found.model.effects.keys() - after.model.effects.keys()
    alternatives = {name: others for name, others in found.alternatives.items() if name not in idle}
    return after, {**alternatives, **_confounded(after)}, _withdrawn(found.tried, idle, _DOES_NOTHING)


def _withdrawn(tried: Sequence[Trial], names: Collection[str], why: str) -> tuple[Trial, ...]:
    """Return what was tried, some of which was not added in the end, and why."""
    return tuple(
        replace(one, accepted=False, why=why) if one.effect in names and one.accepted else one for one in tried
    )


def _as_drawn(drawing: Drawn, before: Fit, other: Model) -> tuple[Fit, Shape] | None:
    """Return a law fitted to train and validation, if the test part speaks neither against it nor for another model."""
    likelihood, begin = before.likelihood, drawing.begin
    fitted = fitted_curve(likelihood, drawing.candidate.model, drawing.promise).model
    model = centred(likelihood, fitted, drawing.promise.slot)
    others = {name: own for name, own in model.effects.items() if name != likelihood.channel.curve.name}
    asked = model, other, replace(model, effects=others), begin.model
    simulated, of_other, without, of_begin = each(likelihood.simulate, asked)
    if not all(np.all(np.isfinite(values)) for values in simulated):
        return None
    experiments = likelihood.experiments
    if compared(experiments, of_other, simulated)[0] >= 1.0:
        return None
    squares = [sum(float(run @ run) for run in likelihood.residuals(one)) for one in (simulated, without)]
    if min(compared(experiments, without, simulated)[0], math.sqrt(squares[0] / squares[1])) >= _SEEN:
        return None  # it freed a core that was stuck, and does nothing itself
    left_of_unseen = [compared(experiments, of_begin, simulated)[0]]  # of the test part first
    if begin.validation_rmse and drawing.candidate.validation_rmse is not None:
        left_of_unseen.append(drawing.candidate.validation_rmse / begin.validation_rmse)
    if min(left_of_unseen) >= (_SEEN_IN_COMPANY if begin.effects else _SEEN):
        return None
    left = [one.measured - values for one, values in zip(experiments, simulated)]
    if left_of_unseen[0] > _MOSTLY and contradiction(experiments, left, likelihood.noise(model).std):
        return None
    return summary(likelihood, model), shape_of(likelihood, model, drawing, begin.model)


def with_core(before: Fit) -> Fit:
    """Return the fit of a channel's model with the physical core, where it has one, from that of the linear one."""
    names = list(before.likelihood.channel.cores)
    if not names:
        return before
    candidates = Candidates(before.likelihood, before.model)
    return _fitted(before, candidates.with_core(candidates.baseline, names[0]).model)


def _without_idle(before: Fit, model: Model) -> Model:
    """
    Return a model without effects that do nothing beside the others, as one at its null.

    They were added where the fit before them was stuck, and freed it.
    """
    telling = before.likelihood.representative()

    def squares(one: Model) -> float:
        return sum(float(run @ run) for run in telling.residuals(telling.simulate(one)))

    most = _IDLE * squares(model)
    for name in list(model.effects):
        others = replace(model, effects={other: own for other, own in model.effects.items() if other != name})
        if others.effects and squares(others) < most:
            model = others
    return model


def _fitted(before: Fit, rough: Model) -> Fit:
    """Return what was found fitted to the end; as it was found where that runs away."""
    likelihood = before.likelihood
    how = _NEAR_ENOUGH / likelihood.samples, _MOST_EVALUATIONS
    found = find_optimum(likelihood, rough, *how)
    model = (as_data_sheets(likelihood, found, *how) if found.model.core else found).model
    if not all(np.all(np.isfinite(values)) for values in likelihood.simulate(model)):
        model = rough
    return summary(likelihood, model)


def _confounded(after: Fit) -> Mapping[str, tuple[str, ...]]:
    """Return effects that others may pass for, as the channel knows them."""
    telling, model = after.likelihood.representative(), after.model
    complement = Complement(telling, model)
    residual = np.concatenate(telling.residuals(telling.simulate(model)))
    return telling.channel.confounded(
        telling.experiments,
        model,
        after.estimates,
        residual,
        lambda effect, start: complement.left(complement.changes(effect, [start])[:, 0]),
    )
