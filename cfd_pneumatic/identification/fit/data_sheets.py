# SPDX-License-Identifier: Apache-2.0
"""Hold parameters of a core that the recordings do not determine at data-sheet values."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from cfd_pneumatic.identification.channels import Channel, Model
from cfd_pneumatic.identification.fit.fit import Optimum, find_optimum, search_information
from cfd_pneumatic.identification.fit.likelihood import Likelihood, Unknowns
from cfd_pneumatic.identification.fit.thresholds import (
    CONFIDENCE,
    LARGEST_NULL_DISTANCE,
    LEAST_SUM_OF_SQUARES,
    ROUGH_SEARCH,
)


def as_data_sheets(
    likelihood: Likelihood, optimum: Optimum, tolerance: float, evaluations: int, noise: float
) -> Optimum:
    """
    Return a fitted model, fitted again with the undetermined parameters of its core held at null.

    Free undetermined parameters would be compensated by the gains. All parameters that a data sheet may omit are held,
    if the likelihood permits. Otherwise the parameters within two standard errors of null are held, if it permits. See
    `find_optimum` for tolerance, evaluations and noise.
    """
    optional = _optional_parameters(likelihood.channel, optimum.model)
    for names in (optional, optional & _near_null(likelihood, optimum.model)):
        restricted = find_optimum(likelihood, _with_null(likelihood.channel, optimum.model, names), *ROUGH_SEARCH)
        rise = likelihood.samples * math.log(restricted.cost / max(optimum.cost, LEAST_SUM_OF_SQUARES))
        if names and rise < chdtri(len(names), 1.0 - CONFIDENCE):
            return find_optimum(likelihood, restricted.model, tolerance, evaluations, noise=noise)
    return optimum


def _optional_parameters(channel: Channel, model: Model) -> frozenset[str]:
    """Return the names of a core's parameters that may be null and have null as their lower bound."""
    parameters = {
        f'{core}.{parameter.name}': parameter for core in model.core for parameter in channel.effects[core].parameters
    }
    return frozenset(name for name, parameter in parameters.items() if parameter.null == parameter.lower)


def _with_null(channel: Channel, model: Model, names: frozenset[str]) -> Model:
    """Return a model with some of its core's parameters held at null."""
    core = {
        core: tuple(
            parameter.null if f'{core}.{parameter.name}' in names else value
            for parameter, value in zip(channel.effects[core].parameters, values)
        )
        for core, values in model.core.items()
    }
    return replace(model, core=core, assumed_parameters=names)


def _near_null(likelihood: Likelihood, model: Model) -> frozenset[str]:
    """Return the names of the unknowns within two standard errors of null."""
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    fisher = search_information(likelihood, unknowns, likelihood.simulate(model))
    free = np.flatnonzero(unknowns.start > unknowns.lower)
    stds = np.zeros(unknowns.start.size)
    stds[free] = np.sqrt(np.diag(fisher.covariance(max(fisher.size - free.size, 1), free)))
    # a standard error of zero: at null, or without influence on the residuals
    is_near = (stds == 0.0) | (unknowns.start <= LARGEST_NULL_DISTANCE * stds)
    return frozenset(unknown.name for unknown, near in zip(unknowns.table, is_near.tolist()) if near)
