# SPDX-License-Identifier: Apache-2.0
"""Fits of models that have a curve, with a penalty on its roughness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Likelihood, Optimum, Quadratic, Unknowns, least_squares
from cfd_pneumatic.identification.search.curve_places import CurvePlace
from cfd_pneumatic.identification.search.curve_screening import ScreenedCurve, roughness
from cfd_pneumatic.identification.search.thresholds import FINE_CURVE_SEARCH, LEAST_DIVISOR, PENALTY_FACTORS
from cfd_pneumatic.model import KNOTS


def fitted(
    likelihood: Likelihood, begin: Model, promise: ScreenedCurve, how: tuple[float, int] = FINE_CURVE_SEARCH
) -> Optimum:
    """
    Return a model that has a curve, fitted with a penalty on its roughness, which counts among what it leaves.

    `how` has the tolerance and the most evaluations.
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, begin)
    bends = penalty_of(unknowns, promise)

    def evaluate(point: Array) -> Quadratic:
        here = likelihood.evaluate(unknowns, point)
        slope = bends @ point
        return Quadratic(here.total + float(point @ slope), here.gradient + slope, here.normal + bends)

    start, lower, upper = unknowns.start, unknowns.lower, unknowns.upper
    point, reached = least_squares(evaluate, start, lower, upper, *how, longest=unknowns.longest_step)
    return Optimum(unknowns.model(point), reached.total)


def heights_of(unknowns: Unknowns, slot: CurvePlace) -> list[int]:
    """Return which unknowns are the heights of a curve."""
    return [index for index, one in enumerate(unknowns.table) if one.name.startswith(f'{slot.curve.name}.w')]


def renewed(likelihood: Likelihood, model: Model, promise: ScreenedCurve, share: float) -> ScreenedCurve:
    """
    Return a promise with the penalty that goes with a fitted curve's bends and with what it leaves (MacKay, 1992).

    Before the fit most of what is left is the law itself, and passes for noise, under which a curve seems smooth.
    `share` is how many independent samples a sample is worth.
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    here = likelihood.evaluate(unknowns, unknowns.start)
    bends = penalty_of(unknowns, promise)
    if not here.is_finite:
        return promise
    told = KNOTS - float(np.sum(np.linalg.pinv(here.normal + bends, hermitian=True) * bends))
    heights = promise.slot.heights(model) / promise.slot.unit
    variance = here.total / (likelihood.samples * share)
    penalty = variance * told / max(float(heights @ roughness() @ heights), LEAST_DIVISOR)
    return replace(promise, penalty=float(np.clip(penalty / promise.penalty, *PENALTY_FACTORS)) * promise.penalty)


def penalty_of(unknowns: Unknowns, promise: ScreenedCurve) -> Array:
    """Return the matrix of the penalty on a curve, as unknowns are searched, shape (k, k)."""
    own = heights_of(unknowns, promise.slot)
    scales = unknowns.scales(unknowns.start)[own] / promise.slot.unit
    matrix = np.zeros((len(unknowns.table), len(unknowns.table)))
    matrix[np.ix_(own, own)] = promise.penalty * roughness() * np.outer(scales, scales)
    return matrix
