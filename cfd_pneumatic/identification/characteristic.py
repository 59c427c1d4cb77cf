# SPDX-License-Identifier: Apache-2.0
"""Estimated curve of an unknown characteristic: place in the model, variable, values and confidence band."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import PLACES, VARIABLES, Model
from cfd_pneumatic.identification.fit import Likelihood, Quadratic, Unknowns, find_optimum
from cfd_pneumatic.identification.formulas import Formula, formulas
from cfd_pneumatic.identification.residual import autoregression, independent_share
from cfd_pneumatic.identification.search import CurvePlace, FittedCurve, height_indices, penalty_matrix
from cfd_pneumatic.identification.thresholds import (
    BAND_HALF_WIDTH,
    CORNER_ERROR,
    CURVE_POINTS,
    FEWEST_VISITS,
    FORMULA_SEARCH,
    LARGEST_FORMULA_SQUARES,
    MODEL_ERROR,
)
from cfd_pneumatic.model import KNOTS


@dataclass(frozen=True, eq=False)
class Characteristic:
    """
    An estimated curve of an unknown characteristic.

    Attributes
    ----------
    enters, against
        Place and variable of the curve, keys of the channel's `curve`.
    alternatives
        Further pairs of place and variable that the recordings do not distinguish from this pair.
    at
        Values of the variable, shape (points,) [unit of the variable].
    value, low, high
        Curve and its pointwise 95 % band, shape (points,) [unit of the place].
    visited
        Whether recordings visited the points, shape (points,).
    explains
        Share of the squared residual of train and validation part that the curve explains.
    formulas
        Simplest formulas within the band, the closest first. The recordings do not distinguish several formulas.

    """

    enters: str
    against: str
    alternatives: tuple[tuple[str, str], ...]
    at: Array
    value: Array
    low: Array
    high: Array
    visited: NDArray[np.bool_]
    explains: float
    formulas: tuple[Formula, ...] = ()

    @property
    def unit(self) -> str:
        """Return the unit of the curve's values."""
        return PLACES[self.enters].unit

    @property
    def unit_against(self) -> str:
        """Return the unit of the variable."""
        return VARIABLES[self.against].unit

    @property
    def description(self) -> str:
        """Return what the characteristic does, and what to inspect on the machine."""
        return f'{self.cause}. Inspect {PLACES[self.enters].inspect}'

    @property
    def cause(self) -> str:
        """
        Return what the characteristic does.

        If the curve is determined except for a constant, its size is the range of its values.
        """
        visited_values = self.value[self.visited] if np.count_nonzero(self.visited) > 1 else self.value
        place = PLACES[self.enters]
        largest = float(np.max(np.abs(visited_values)) if place.keeps_constant else np.ptp(visited_values))
        size = 100.0 * largest if self.unit in ('1', '1/s') else largest
        rounded = float(f'{size:.2g}')
        return f'{place.sentence.format(f"{rounded:g}")}, {VARIABLES[self.against].sentence}'


def estimate_characteristic(
    likelihood: Likelihood, model: Model, curve: FittedCurve, model_without: Model
) -> Characteristic:
    """Return the curve of a fitted model with its confidence band; `model_without` is the model without the curve."""
    place = curve.screened.place
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    indices = height_indices(unknowns, place)
    optimum: Quadratic = likelihood.evaluate(unknowns, unknowns.start)
    residuals = likelihood.residuals(likelihood.simulate(model))
    share = independent_share(autoregression(residuals))
    variance = optimum.total / max(likelihood.samples * share - len(indices), 1.0)
    scales = unknowns.scales(unknowns.start)[indices]
    covariance = variance * np.linalg.pinv(optimum.normal + penalty_matrix(unknowns, curve.screened), hermitian=True)
    covariance = covariance[np.ix_(indices, indices)] * np.outer(scales, scales)
    values = _visited_values(likelihood, model, place.against)
    points = np.linspace(place.low, place.high, CURVE_POINTS)
    heights = place.heights(model)
    value = place.interpolation(points) @ heights
    derivatives = place.interpolation(points) @ _without_absorbed(place, values, heights)
    std = np.sqrt(np.einsum('ij,jk,ik->i', derivatives, covariance, derivatives))
    # Straight lines between knots cut the corners of a bent curve.
    bend = place.interpolation(points) @ np.pad(np.abs(np.diff(heights, 2)), 1, 'edge')
    is_visited = _is_visited(values, points)
    size = float(np.ptp(value[is_visited])) if is_visited.any() else 0.0
    half = BAND_HALF_WIDTH * std + CORNER_ERROR * bend + MODEL_ERROR * size
    low, high = value - half, value + half
    before = sum(float(run @ run) for run in likelihood.residuals(likelihood.simulate(model_without)))
    limit = LARGEST_FORMULA_SQUARES * optimum.total
    return Characteristic(
        *place.name,
        curve.alternatives,
        points,
        value,
        low,
        high,
        is_visited,
        1.0 - optimum.total / before,
        formulas(
            points[is_visited],
            value[is_visited],
            low[is_visited],
            high[is_visited],
            VARIABLES[place.against].symbol,
            has_free_constant=place.absorbed.size > 0,
            is_accepted=lambda formula: _fits(likelihood, model, place, formula, limit),
        ),
    )


def _fits(likelihood: Likelihood, model: Model, place: CurvePlace, formula: Formula, limit: float) -> bool:
    """Return whether the sum of squares with a formula instead of the curve, gains refitted, is below a limit."""
    with_formula = place.replace_heights(model, formula.evaluate(place.knots))
    return find_optimum(likelihood, with_formula, *FORMULA_SEARCH, frozen=with_formula.parts).cost < limit


def centre_curve(likelihood: Likelihood, model: Model, place: CurvePlace) -> Model:
    """Move the mean of a curve to the gains or offsets; the simulation stays the same."""
    heights = place.heights(model)
    visits = place.interpolation(_visited_values(likelihood, model, place.against)).mean(axis=0)
    mean = float(visits @ heights) / float(visits.sum())
    parameters, offsets = model.parameters.copy(), model.recording_values.copy()
    if place.name == ('flow', 'error'):
        return model
    gains = PLACES[place.enters].gains
    if gains is not None:
        parameters[gains] *= 1.0 + mean
        heights = (heights - mean) / (1.0 + mean)
    elif place.enters == 'set_point':
        offsets[:, 0] += mean
        heights = heights - mean
    return place.replace_heights(replace(model, parameters=parameters, recording_values=offsets), heights)


def _without_absorbed(place: CurvePlace, values: Array, heights: Array) -> Array:
    """Return the matrix that removes from changes of the heights what the model's own parameters absorb."""
    is_share = PLACES[place.enters].unit == '1'
    absorbed = place.absorbed * (1.0 + heights[:, None]) if is_share else place.absorbed
    weights = place.interpolation(values).sum(axis=0)[:, None] * absorbed
    inverse = np.linalg.pinv(absorbed.T @ weights)
    return np.asarray(np.eye(KNOTS) - absorbed @ inverse @ weights.T)


def _visited_values(likelihood: Likelihood, model: Model, against: str) -> Array:
    """Return the values of a variable at the samples that count, shape (n,)."""
    return np.concatenate(
        [
            likelihood.channel.variables(experiment, simulated, model)[against][experiment.counts]
            for experiment, simulated in zip(likelihood.experiments, likelihood.simulate(model))
        ]
    )


def _is_visited(values: Array, points: Array) -> NDArray[np.bool_]:
    """Return which points have enough values near them, shape (points,)."""
    edges = np.concatenate(
        [points[:1] - (points[1] - points[0]), 0.5 * (points[1:] + points[:-1]), points[-1:] + (points[1] - points[0])]
    )
    return np.asarray(np.histogram(values, edges)[0] >= FEWEST_VISITS)
