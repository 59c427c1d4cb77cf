# SPDX-License-Identifier: Apache-2.0
"""The fit that is reported, to train and validation together, of what the search has found."""

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

_DOES_NOTHING = 'does nothing beside the others'


def finish(before: Fit, found: SearchResult) -> tuple[Fit, Mapping[str, tuple[str, ...]], tuple[Trial, ...]]:
    """Return the final fit of a search's result without idle effects, the alternatives to effects, and the trials."""
    if not found.model.model.parts:
        return before, found.alternatives, found.tried
    after = fit_to_end(before, _without_idle(before, found.model.model))
    idle = found.model.effects.keys() - after.model.effects.keys()
    alternatives = {name: others for name, others in found.alternatives.items() if name not in idle}
    return after, {**alternatives, **_confounded(after)}, withdrawn(found.tried, idle, _DOES_NOTHING)


def withdrawn(tried: Sequence[Trial], names: Collection[str], why: str) -> tuple[Trial, ...]:
    """Return trials, of which those of some effects were not accepted in the end, and why."""
    return tuple(
        replace(trial, accepted=False, why=why) if trial.effect in names and trial.accepted else trial
        for trial in tried
    )


def with_core(before: Fit) -> Fit:
    """Return the fit of a channel's model with the physical core, where it has one, from that of the linear one."""
    names = list(before.likelihood.channel.cores)
    if not names:
        return before
    candidates = Candidates(before.likelihood, before.model)
    return fit_to_end(before, candidates.with_core(candidates.baseline, names[0]).model)


def fit_to_end(before: Fit, rough: Model) -> Fit:
    """Return the fit from a model to train and validation; that model itself if the fit runs away."""
    likelihood = before.likelihood
    how = FINAL_SEARCH_TOLERANCE / likelihood.samples, MOST_FINAL_EVALUATIONS
    found = find_optimum(likelihood, rough, *how)
    model = (as_data_sheets(likelihood, found, *how) if found.model.core else found).model
    if not all(np.all(np.isfinite(values)) for values in likelihood.simulate(model)):
        model = rough
    return summary(likelihood, model)


def _without_idle(before: Fit, model: Model) -> Model:
    """
    Return a model without effects that change nothing in addition to the others, as an effect at its null.

    They were added where the fit before them was stuck, and freed it.
    """
    likelihood = before.likelihood.representative()

    def squares(of: Model) -> float:
        return sum(float(run @ run) for run in likelihood.residuals(likelihood.simulate(of)))

    most = LARGEST_IDLE_SQUARES * squares(model)
    for idle in list(model.effects):
        effects = {name: parameters for name, parameters in model.effects.items() if name != idle}
        fewer = replace(model, effects=effects)
        if effects and squares(fewer) < most:
            model = fewer
    return model


def _confounded(after: Fit) -> Mapping[str, tuple[str, ...]]:
    """Return effects that others may pass for, as the channel knows them."""
    likelihood, model = after.likelihood.representative(), after.model
    complement = Complement(likelihood, model)
    residual = np.concatenate(likelihood.residuals(likelihood.simulate(model)))
    return likelihood.channel.confounded(
        likelihood.experiments,
        model,
        after.estimates,
        residual,
        lambda effect, start: complement.left(complement.changes(effect, [start])[:, 0]),
    )
