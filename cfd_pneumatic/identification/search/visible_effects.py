# SPDX-License-Identifier: Apache-2.0
"""Effects that a recording could not have shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Likelihood, find_optimum
from cfd_pneumatic.identification.residual import Noise
from cfd_pneumatic.identification.search.complement import Complement, Start
from cfd_pneumatic.identification.search.thresholds import (
    EXCERPT_MARGIN,
    IMITATION_SEARCH,
    LARGEST_IMITATED_RATIO,
    LEAST_PLAIN_REMAINDER,
    SHOWN,
    STRENGTH,
    VISIBILITY_EXCERPT_STEPS,
    VISIBILITY_STRETCH_STEPS,
)
from cfd_pneumatic.runtime import map_in_threads


def effects_not_visible(likelihood: Likelihood, model: Model, noise: Noise) -> tuple[str, ...]:
    """
    Return the names of effects that the recordings could not have shown in addition to a model.

    Each effect is added at a strength well above the noise. The effect is visible if the model's own parameters cannot
    compensate for it: by small changes (Jacobian), or by a fit if small changes do not decide.

    Parameters
    ----------
    likelihood
        Samples to which the model was fitted.
    model
        Fitted model.
    noise
        Noise of the channel.

    """
    channel, strength = likelihood.channel, STRENGTH * noise.std
    unweighted = replace(
        likelihood, weights=tuple(np.ones(experiment.part.size) for experiment in likelihood.experiments)
    )
    representative, visible_size = unweighted.representative(), SHOWN * noise.std
    measured_data = channel.data(representative.experiments, model, likelihood.representative().simulate(model))
    data = {**measured_data, 'residual': strength, 'mean': strength, 'lag': 0.0, 'setpoint_lag': 0.0}

    def is_visible(complement: Complement, least: float, name: str) -> bool:
        return _is_visible(complement, name, channel.library[name].starts(data), least)

    # An effect that is visible in few samples needs no more samples, which would take longer.
    stages = [
        (unweighted.excerpt(VISIBILITY_EXCERPT_STEPS), EXCERPT_MARGIN * visible_size),
        (unweighted.spread(VISIBILITY_STRETCH_STEPS), visible_size),
    ]
    stages = [stage for stage in stages if 0 < stage[0].samples < representative.samples]
    stages += [(representative, visible_size)]
    names = channel.candidates(model)
    pending = [name for name in names if channel.may_tell(representative.experiments, name, model)]
    visible: set[str] = set()
    for part, least in stages:
        complement = Complement(part, model)
        complement.remainder(complement.simulated)  # computes the basis before the threads start, so once
        results = map_in_threads(partial(is_visible, complement, least), pending)
        visible.update(name for name, result in zip(pending, results) if result)
        pending = [name for name in pending if name not in visible]
        if not pending:
            break
    return tuple(name for name in names if name not in visible)


def _is_visible(complement: Complement, name: str, starts: Sequence[Start], least: float) -> bool:
    """Return whether the model's parameters cannot reduce an effect to at most `least` [SI]; fit if it is not plain."""
    changes = complement.changes(name, starts)
    remainder, whole = _rms(complement.remainder(changes)), _rms(changes)
    is_large = remainder > least
    is_plain = (remainder > LEAST_PLAIN_REMAINDER * least) | (whole < LARGEST_IMITATED_RATIO * remainder)
    if np.any(is_large & is_plain):
        return True
    return any(_has_remainder(complement, name, starts[rank], least) for rank in np.flatnonzero(is_large).tolist())


def _has_remainder(complement: Complement, name: str, start: Start, least: float) -> bool:
    """Return whether a model that is fitted to a simulated effect still errs by more than `least` [SI]."""
    likelihood, model = complement.likelihood, complement.model
    with_effect = replace(model, effects={**model.effects, name: start})
    simulated = likelihood.channel.simulated(likelihood.experiments, with_effect)
    experiments = tuple(
        replace(experiment, measured=values) for experiment, values in zip(likelihood.experiments, simulated)
    )
    limit = least**2 * likelihood.samples
    likelihood = replace(likelihood, experiments=experiments)
    frozen = (*model.core, likelihood.channel.curve.name)
    return find_optimum(likelihood, model, *IMITATION_SEARCH, enough=limit, frozen=frozen).cost > limit


def _rms(columns: Array) -> Array:
    with np.errstate(over='ignore'):  # an effect that makes a model diverge is visible
        return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))
