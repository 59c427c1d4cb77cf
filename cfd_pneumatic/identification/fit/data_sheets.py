# SPDX-License-Identifier: Apache-2.0
"""What recordings don't tell of a core: it stands as data sheets have it, or the gains would make up for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from cfd_pneumatic.identification.channels import Channel, Model
from cfd_pneumatic.identification.fit.fit import Optimum, find_optimum, information_of
from cfd_pneumatic.identification.fit.likelihood import Likelihood, Unknowns
from cfd_pneumatic.identification.fit.thresholds import (
    CONFIDENCE,
    LARGEST_NULL_DISTANCE,
    LEAST_SUM_OF_SQUARES,
    ROUGH_SEARCH,
)


def as_data_sheets(likelihood: Likelihood, found: Optimum, tolerance: float, evaluations: int) -> Optimum:
    """
    Return a fitted model, fitted again with what its recordings don't tell of its core held as data sheets have it.

    All that a data sheet may leave out is held, where the recordings' likelihood doesn't contradict that; else what
    lies within two standard errors of nothing, where it doesn't contradict that.
    """
    absent = _absent(likelihood.channel, found.model)
    for names in (absent, absent & _near_nothing(likelihood, found.model)):
        held = find_optimum(likelihood, _without(likelihood.channel, found.model, names), *ROUGH_SEARCH)
        rise = likelihood.samples * math.log(held.cost / max(found.cost, LEAST_SUM_OF_SQUARES))
        if names and rise < chdtri(len(names), 1.0 - CONFIDENCE):
            return find_optimum(likelihood, held.model, tolerance, evaluations)
    return found


def _absent(channel: Channel, model: Model) -> frozenset[str]:
    """Return the names of a core's numbers that may be nothing at all, and can't be less."""
    parameters = {f'{core}.{one.name}': one for core in model.core for one in channel.effects[core].parameters}
    return frozenset(name for name, one in parameters.items() if one.null == one.lower)


def _without(channel: Channel, model: Model, names: frozenset[str]) -> Model:
    """Return a model with some of its core's numbers held at nothing."""
    core = {
        core: tuple(
            one.null if f'{core}.{one.name}' in names else value
            for one, value in zip(channel.effects[core].parameters, values)
        )
        for core, values in model.core.items()
    }
    return replace(model, core=core, untold=names)


def _near_nothing(likelihood: Likelihood, model: Model) -> frozenset[str]:
    """Return the names of the unknowns that lie within two standard errors of nothing."""
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    fisher = information_of(likelihood, unknowns, likelihood.simulate(model))
    free = np.flatnonzero(unknowns.start > unknowns.lower)
    stds = np.zeros(unknowns.start.size)
    stds[free] = np.sqrt(np.diag(fisher.covariance(max(fisher.size - free.size, 1), free)))
    near = (stds == 0.0) | (unknowns.start <= LARGEST_NULL_DISTANCE * stds)  # at nothing, or nothing depends on it
    return frozenset(one.name for one, is_near in zip(unknowns.table, near.tolist()) if is_near)
