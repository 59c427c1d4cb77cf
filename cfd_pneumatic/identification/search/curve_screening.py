# SPDX-License-Identifier: Apache-2.0
"""
Screening of curves: predict what a curve at each place would explain, before the curve is fitted.

The prediction is linear in the curve's heights: for each place and variable, the marginal likelihood of a smooth curve
(restricted maximum likelihood) in addition to the model's own unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.residual import independent_share
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.complement import Complement
from cfd_pneumatic.identification.search.curve_places import CurvePlace, curve_places
from cfd_pneumatic.identification.search.thresholds import (
    CURVE_STRETCH_STEPS,
    HEIGHT_PENALTY,
    LEAST_DIVISOR,
    LEAST_EIGENVALUE,
)
from cfd_pneumatic.model import COUNT, KNOTS
from cfd_pneumatic.runtime import map_in_threads

_PENALTIES = np.logspace(-8.0, 8.0, 65)  # on the roughness, in units of the largest eigenvalue of the data
_COARSE = np.maximum(1.0 - np.abs(0.5 * np.arange(KNOTS) - np.arange(KNOTS // 2 + 1)[:, None]), 0.0)  # every other knot


@dataclass(frozen=True, eq=False)
class ScreenedCurve:
    """
    Prediction for a curve at a place.

    Attributes
    ----------
    place
        Place, variable and knots.
    evidence
        Rise of twice the log likelihood.
    remainder
        Share of the squared residual that remains with the curve.
    penalty
        Penalty on the roughness: variance of the noise over variance of the curve's bends.
    heights
        Heights in the unit of the place, shape (knots,).

    """

    place: CurvePlace
    evidence: float
    remainder: float
    penalty: float
    heights: Array


def add_screened_curve(model: Model, screened: ScreenedCurve, share: float = 1.0) -> Model:
    """Return a model with a share of a predicted curve."""
    return screened.place.add_curve(model, share * screened.place.unit * screened.heights)


def screen_curves(candidates: Candidates, base: Candidate) -> list[ScreenedCurve]:
    """Predict what a curve at each place would add to a model; return the most promising curve first."""
    complement = Complement(candidates.train_validation.spread(CURVE_STRETCH_STEPS), base.model)
    residual = complement.residual
    share = independent_share(candidates.noise_autoregression(base))

    def screen(places: Sequence[CurvePlace]) -> list[ScreenedCurve]:
        starts = [place.parameters(place.unit * coarse) for place in places for coarse in _COARSE]
        changes = complement.remainder(complement.changes(candidates.channel.curve.name, starts))
        by_place = np.hsplit(changes, len(places))
        return [_screen(place, residual, columns, share) for place, columns in zip(places, by_place)]

    places = curve_places(candidates, base)
    batches = [places[first : first + COUNT] for first in range(0, len(places), COUNT)]
    return sorted(chain.from_iterable(map_in_threads(screen, batches)), key=lambda screened: -screened.evidence)


def _screen(place: CurvePlace, residual: Array, changes: Array, share: float) -> ScreenedCurve:
    """
    Predict a curve from the changes of the simulation by its coarse heights, shape (n, coarse).

    The heights are normally distributed with the inverse roughness matrix as covariance. The evidence is the marginal
    likelihood at the best penalty, with the variance of the noise profiled out.
    """
    root = np.linalg.cholesky(_COARSE @ roughness_matrix() @ _COARSE.T)
    with np.errstate(over='ignore', invalid='ignore'):  # some heights make the simulation diverge
        whitened = np.linalg.solve(root, changes.T)
        products = whitened @ whitened.T
    if not np.all(np.isfinite(products)) or not np.any(products):
        return ScreenedCurve(place, -math.inf, 1.0, 1.0, np.zeros(KNOTS))
    eigenvalues, axes = np.linalg.eigh(products)
    eigenvalues = np.maximum(eigenvalues, LEAST_EIGENVALUE * eigenvalues[-1])
    along = axes.T @ (whitened @ residual)
    power, count = float(residual @ residual), residual.size * share
    penalties = _PENALTIES * float(eigenvalues[-1])
    shrinkage = eigenvalues / (eigenvalues + penalties[:, None])
    remaining = 1.0 - shrinkage @ (along**2 / eigenvalues) / max(power, LEAST_DIVISOR)
    values = count * np.log(np.maximum(remaining, LEAST_DIVISOR)) - np.sum(np.log1p(-shrinkage), axis=1)
    best = int(np.argmin(values))
    penalty = float(penalties[best])
    heights = np.linalg.solve(root.T, axes @ (along / (eigenvalues + penalty))) @ _COARSE
    return ScreenedCurve(place, -float(values[best]), float(remaining[best]), penalty, heights)


def roughness_matrix() -> Array:
    """Return the matrix of a curve's squared bends, and of a little of its height, shape (knots, knots)."""
    bends = np.diff(np.eye(KNOTS), 2, axis=0)
    return np.asarray(bends.T @ bends + HEIGHT_PENALTY * np.eye(KNOTS))
