# SPDX-License-Identifier: Apache-2.0
"""Fits of models with a curve, with a penalty on the curve's roughness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Likelihood, Optimum, Quadratic, Unknowns, least_squares
from cfd_pneumatic.identification.search.curve_places import CurvePlace
from cfd_pneumatic.identification.search.curve_screening import ScreenedCurve, roughness_matrix
from cfd_pneumatic.identification.search.thresholds import FINE_CURVE_SEARCH, LEAST_DIVISOR, PENALTY_FACTORS
from cfd_pneumatic.model import KNOTS


def fit_curve(
    likelihood: Likelihood, start: Model, screened: ScreenedCurve, search: tuple[float, int] = FINE_CURVE_SEARCH
) -> Optimum:
    """
    Fit a model that has a curve, with a penalty on the curve's roughness.

    Parameters
    ----------
    likelihood
        Samples and weights.
    start
        Model with the curve from which the fit starts.
    screened
        Place and penalty of the curve.
    search
        End of the fit: least relative fall of the sum of squares [-] and most evaluations [1].

    Returns
    -------
    Optimum
        Fitted model; the cost includes the penalty.

    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, start)
    penalty = penalty_matrix(unknowns, screened)

    def evaluate(point: Array) -> Quadratic:
        quadratic = likelihood.evaluate(unknowns, point)
        slope = penalty @ point
        return Quadratic(quadratic.total + float(point @ slope), quadratic.gradient + slope, quadratic.normal + penalty)

    first, lower, upper = unknowns.start, unknowns.lower, unknowns.upper
    point, reached = least_squares(
        evaluate, first, lower, upper, *search, longest=unknowns.longest_step, is_stopped=likelihood.effort.is_stopped
    )
    return Optimum(unknowns.model(point), reached.total)


def height_indices(unknowns: Unknowns, place: CurvePlace) -> list[int]:
    """Return the indices of the unknowns that are heights of a curve."""
    return [index for index, unknown in enumerate(unknowns.table) if unknown.name.startswith(f'{place.curve.name}.w')]


def update_penalty(likelihood: Likelihood, model: Model, screened: ScreenedCurve, share: float) -> ScreenedCurve:
    """
    Return a curve with the penalty that follows from its fitted bends and the fit's residual (MacKay, 1992).

    Before the fit most of the residual is the missing curve itself. The screening takes this residual for noise and
    the curve for smooth. `share` is the number of independent samples in a sample [-].
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    quadratic = likelihood.evaluate(unknowns, unknowns.start)
    matrix = penalty_matrix(unknowns, screened)
    if not quadratic.is_finite:
        return screened
    determined = KNOTS - float(np.sum(np.linalg.pinv(quadratic.normal + matrix, hermitian=True) * matrix))
    heights = screened.place.heights(model) / screened.place.unit
    variance = quadratic.total / (likelihood.samples * share)
    penalty = variance * determined / max(float(heights @ roughness_matrix() @ heights), LEAST_DIVISOR)
    return replace(screened, penalty=float(np.clip(penalty / screened.penalty, *PENALTY_FACTORS)) * screened.penalty)


def penalty_matrix(unknowns: Unknowns, screened: ScreenedCurve) -> Array:
    """Return the matrix of the penalty on a curve, by the unknowns as they are searched, shape (k, k)."""
    indices = height_indices(unknowns, screened.place)
    scales = unknowns.scales(unknowns.start)[indices] / screened.place.unit
    matrix = np.zeros((len(unknowns.table), len(unknowns.table)))
    matrix[np.ix_(indices, indices)] = screened.penalty * roughness_matrix() * np.outer(scales, scales)
    return matrix
