# SPDX-License-Identifier: Apache-2.0
"""Final fit of a search's result to the train and validation parts together; its values are reported."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Fit, as_data_sheets, find_optimum, summary
from cfd_pneumatic.identification.search.candidates import Candidates
from cfd_pneumatic.identification.search.complement import Complement
from cfd_pneumatic.identification.search.stepwise import SearchResult, Trial
from cfd_pneumatic.identification.search.thresholds import (
    FINAL_SEARCH_TOLERANCE,
    LARGEST_IDLE_SQUARES,
    MOST_FINAL_EVALUATIONS,
)

_IDLE = 'explains nothing in addition to the other effects'


def finish(before: Fit, result: SearchResult) -> tuple[Fit, Mapping[str, tuple[str, ...]], tuple[Trial, ...]]:
    """Fit a search's result without idle effects; return the fit, the alternatives to effects, and the trials."""
    if not result.model.model.parts:
        return before, result.alternatives, result.tried
    after = fit_to_end(before, _without_idle(before, result.model.model))
    idle = result.model.effects.keys() - after.model.effects.keys()
    alternatives = {name: rivals for name, rivals in result.alternatives.items() if name not in idle}
    return after, {**alternatives, **_confounded(after)}, withdraw_trials(result.tried, idle, _IDLE)


def withdraw_trials(tried: Sequence[Trial], names: Collection[str], why: str) -> tuple[Trial, ...]:
    """Return trials in which some effects are not accepted, for a reason."""
    return tuple(
        replace(trial, accepted=False, why=why) if trial.effect in names and trial.accepted else trial
        for trial in tried
    )


def with_core(before: Fit) -> Fit:
    """Return the fit of a channel's model with the physical core; the linear fit if the channel has no such core."""
    names = list(before.likelihood.channel.cores)
    if not names:
        return before
    candidates = Candidates(before.likelihood, before.model)
    return fit_to_end(before, candidates.with_core(candidates.baseline, names[0]).model)


def fit_to_end(before: Fit, rough: Model) -> Fit:
    """Fit a model to train and validation; return the fit, or the unchanged model if the fit diverges."""
    likelihood = before.likelihood
    search = FINAL_SEARCH_TOLERANCE / likelihood.samples, MOST_FINAL_EVALUATIONS
    noise = likelihood.noise(rough).std
    optimum = find_optimum(likelihood, rough, *search, noise=noise)
    model = (as_data_sheets(likelihood, optimum, *search, noise) if optimum.model.core else optimum).model
    if not all(np.all(np.isfinite(values)) for values in likelihood.simulate(model)):
        model = rough
    return summary(likelihood, model)


def _without_idle(before: Fit, model: Model) -> Model:
    """
    Return a model without idle effects: effects at their null, which explain nothing in addition to other effects.

    The search added such an effect because it freed a fit that was stuck.
    """
    likelihood = before.likelihood.representative()

    def squares(tried: Model) -> float:
        return sum(float(run @ run) for run in likelihood.residuals(likelihood.simulate(tried)))

    limit = LARGEST_IDLE_SQUARES * squares(model)
    for idle in list(model.effects):
        effects = {name: parameters for name, parameters in model.effects.items() if name != idle}
        reduced = replace(model, effects=effects)
        if effects and squares(reduced) < limit:
            model = reduced
    return model


def _confounded(after: Fit) -> Mapping[str, tuple[str, ...]]:
    """Return for each effect the effects that the channel cannot distinguish from it."""
    likelihood, model = after.likelihood.representative(), after.model
    complement = Complement(likelihood, model)
    residual = np.concatenate(likelihood.residuals(likelihood.simulate(model)))
    return likelihood.channel.confounded(
        likelihood.experiments,
        model,
        after.estimates,
        residual,
        lambda effect, start: complement.remainder(complement.changes(effect, [start])[:, 0]),
    )
