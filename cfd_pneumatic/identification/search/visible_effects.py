# SPDX-License-Identifier: Apache-2.0
"""Which effects a recording could not have shown, had they been there."""

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
    Return the effects that could not have shown themselves beside a model, by their names.

    Each is added at a strength well above the noise. It shows by what the model's own parameters can't make up for:
    by small changes of theirs, as its Jacobian has them, or, as effects are not small, by any.

    Parameters
    ----------
    likelihood
        Of the samples that the model was fitted to.
    model
        What they are asked beside.
    noise
        Of the channel.

    """
    channel, strength = likelihood.channel, STRENGTH * noise.std
    alike = replace(likelihood, weights=tuple(np.ones(one.part.size) for one in likelihood.experiments))
    telling, shown = alike.representative(), SHOWN * noise.std
    known = channel.data(telling.experiments, model, likelihood.representative().simulate(model))
    data = {**known, 'residual': strength, 'mean': strength, 'lag': 0.0}

    def asks(complement: Complement, least: float, name: str) -> bool:
        return _shows(complement, name, channel.library[name].starts(data), least)

    # what shows in few samples is not asked of more
    asked = [
        (alike.excerpt(VISIBILITY_EXCERPT_STEPS), EXCERPT_MARGIN * shown),
        (alike.spread(VISIBILITY_STRETCH_STEPS), shown),
    ]
    asked = [one for one in asked if 0 < one[0].samples < telling.samples] + [(telling, shown)]
    names = channel.candidates(model)
    pending = [name for name in names if channel.may_tell(telling.experiments, name, model)]
    visible: set[str] = set()
    for part, least in asked:
        complement = Complement(part, model)
        complement.left(complement.simulated)  # made once, before threads ask for it
        visible.update(
            name for name, shows in zip(pending, map_in_threads(partial(asks, complement, least), pending)) if shows
        )
        pending = [name for name in pending if name not in visible]
        if not pending:
            break
    return tuple(name for name in names if name not in visible)


def _shows(complement: Complement, name: str, starts: Sequence[Start], least: float) -> bool:
    """Return whether an effect leaves more than so much [SI] of itself; a fit is asked where that isn't plain."""
    changes = complement.changes(name, starts)
    left, whole = _rms(complement.left(changes)), _rms(changes)
    telling = left > least
    if np.any(telling & ((left > LEAST_PLAIN_REMAINDER * least) | (whole < LARGEST_IMITATED_RATIO * left))):
        return True
    return any(_remains(complement, name, starts[rank], least) for rank in np.flatnonzero(telling).tolist())


def _remains(complement: Complement, name: str, start: Start, least: float) -> bool:
    """Return whether more than so much of an effect is left when the model is fitted to what it makes."""
    likelihood, model = complement.likelihood, complement.model
    made = likelihood.channel.simulated(likelihood.experiments, replace(model, effects={**model.effects, name: start}))
    experiments = tuple(replace(one, measured=values) for one, values in zip(likelihood.experiments, made))
    little = least**2 * likelihood.samples
    likelihood = replace(likelihood, experiments=experiments)
    frozen = (*model.core, likelihood.channel.curve.name)
    return find_optimum(likelihood, model, *IMITATION_SEARCH, enough=little, frozen=frozen).cost > little


def _rms(columns: Array) -> Array:
    with np.errstate(over='ignore'):  # an effect that makes a model run away shows
        return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))
