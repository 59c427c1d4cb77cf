# SPDX-License-Identifier: Apache-2.0
"""A law that nobody knows, as recordings have drawn it: where it enters, against what, and its curve with a band."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import PLACES, VARIABLES, Model
from cfd_pneumatic.identification.fit import Likelihood, Quadratic, Unknowns, find_optimum
from cfd_pneumatic.identification.formulas import Formula, formulas
from cfd_pneumatic.identification.residual import autoregression, independent_share
from cfd_pneumatic.identification.search import CurvePlace, FittedCurve, heights_of, penalty_of
from cfd_pneumatic.identification.thresholds import (
    BAND_HALF_WIDTH,
    CORNER_ERROR,
    CURVE_POINTS,
    EVENT_POINTS,
    FEWEST_VISITS,
    FORMULA_SEARCH,
    LARGEST_FORMULA_SQUARES,
    LEAST_EVENT_SHARE,
    MODEL_ERROR,
)
from cfd_pneumatic.model import KNOTS


@dataclass(frozen=True, eq=False)
class Characteristic:
    """
    A law that was drawn.

    Attributes
    ----------
    enters, against
        Where, and what it depends on: of those of the channel's `curve`.
    others
        Pairs of these that the recordings can't tell from its own.
    at
        Where the curve is told, shape (points,) [unit of what it depends on].
    value, low, high
        The curve and its pointwise 95 % band, shape (points,) [unit of where it enters].
    visited
        Whether recordings have been there, shape (points,).
    explains
        Share that it takes of the squares that are left without it, on train and validation.
    formulas
        The simplest formulas that stay within the band, the nearest first; several are not distinguished.

    """

    enters: str
    against: str
    others: tuple[tuple[str, str], ...]
    at: Array
    value: Array
    low: Array
    high: Array
    visited: NDArray[np.bool_]
    explains: float
    formulas: tuple[Formula, ...] = ()

    @property
    def unit(self) -> str:
        """Of the curve's height."""
        return PLACES[self.enters].unit

    @property
    def unit_against(self) -> str:
        """Of what it depends on."""
        return VARIABLES[self.against].unit

    @property
    def event(self) -> str:
        """When most of a law of the time comes at once, in a clause: that is no law; empty where it does not."""
        changes = np.abs(self.value[EVENT_POINTS:] - self.value[:-EVENT_POINTS])
        largest = int(np.argmax(changes))
        if self.against != 'time' or changes[largest] < LEAST_EVENT_SHARE * np.ptp(self.value):
            return ''
        when = 0.5 * (self.at[largest] + self.at[largest + EVENT_POINTS])
        return f'most of it comes at once, about t = {when:.3g} s: it is an event, and no law of the time'

    @property
    def words(self) -> str:
        """
        What it does, and where to look, in a clause for a mechanic.

        Of what is told but for a constant the size is by how much it changes.
        """
        seen = self.value[self.visited] if np.count_nonzero(self.visited) > 1 else self.value
        place = PLACES[self.enters]
        most = float(np.max(np.abs(seen)) if place.keeps_constant else np.ptp(seen))
        size = 100.0 * most if self.unit in ('1', '1/s') else most
        shown = float(f'{size:.2g}')
        what = f'{place.sentence.format(f"{shown:g}")}, {VARIABLES[self.against].sentence}'
        return f'{what}: look at {place.inspect}'


def estimate_characteristic(
    likelihood: Likelihood, model: Model, drawing: FittedCurve, without: Model
) -> Characteristic:
    """Return the law that a model has, with its band; `without` is the model that lacks it."""
    slot = drawing.promise.slot
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, model)
    own = heights_of(unknowns, slot)
    here: Quadratic = likelihood.evaluate(unknowns, unknowns.start)
    residuals = likelihood.residuals(likelihood.simulate(model))
    share = independent_share(autoregression(residuals))
    variance = here.total / max(likelihood.samples * share - len(own), 1.0)
    scales = unknowns.scales(unknowns.start)[own]
    covariance = variance * np.linalg.pinv(here.normal + penalty_of(unknowns, drawing.promise), hermitian=True)
    covariance = covariance[np.ix_(own, own)] * np.outer(scales, scales)
    values = _visits(likelihood, model, slot.against)
    at = np.linspace(slot.low, slot.high, CURVE_POINTS)
    heights = slot.heights(model)
    value = slot.along(at) @ heights
    along = slot.along(at) @ _own(slot, values, heights)
    std = np.sqrt(np.einsum('ij,jk,ik->i', along, covariance, along))
    bend = slot.along(at) @ np.pad(np.abs(np.diff(heights, 2)), 1, 'edge')  # straight from knot to knot it cuts corners
    seen = _visited(values, at)
    size = float(np.ptp(value[seen])) if seen.any() else 0.0
    half = BAND_HALF_WIDTH * std + CORNER_ERROR * bend + MODEL_ERROR * size
    low, high = value - half, value + half
    before = sum(float(run @ run) for run in likelihood.residuals(likelihood.simulate(without)))
    return Characteristic(
        *slot.name,
        drawing.others,
        at,
        value,
        low,
        high,
        seen,
        1.0 - here.total / before,
        formulas(
            at[seen],
            value[seen],
            low[seen],
            high[seen],
            VARIABLES[slot.against].symbol,
            free=slot.absorbed.size > 0,
            holds=lambda one: _holds(likelihood, model, slot, one, LARGEST_FORMULA_SQUARES * here.total),
        ),
    )


def _holds(likelihood: Likelihood, model: Model, slot: CurvePlace, formula: Formula, most: float) -> bool:
    """Return whether a formula leaves no more, simulated in its curve's place with the gains fitted anew."""
    formed = slot.drawn(model, formula.told(slot.knots))
    return find_optimum(likelihood, formed, *FORMULA_SEARCH, frozen=formed.parts).cost < most


def centred(likelihood: Likelihood, model: Model, slot: CurvePlace) -> Model:
    """Return a model whose gains or offsets have what is even of its curve; it simulates the same."""
    heights = slot.heights(model)
    visits = slot.along(_visits(likelihood, model, slot.against)).mean(axis=0)
    mean = float(visits @ heights) / float(visits.sum())
    parameters, own = model.parameters.copy(), model.recording_values.copy()
    if slot.name == ('flow', 'error'):
        return model
    gains = PLACES[slot.enters].gains
    if gains is not None:
        parameters[gains] *= 1.0 + mean
        heights = (heights - mean) / (1.0 + mean)
    elif slot.enters == 'set_point':
        own[:, 0] += mean
        heights = heights - mean
    return slot.drawn(replace(model, parameters=parameters, recording_values=own), heights)


def _own(slot: CurvePlace, values: Array, heights: Array) -> Array:
    """Return what takes from changes of heights all that the model's own numbers make up for, where samples are."""
    is_share = PLACES[slot.enters].unit == '1'
    absorbed = slot.absorbed * (1.0 + heights[:, None]) if is_share else slot.absorbed
    weights = slot.along(values).sum(axis=0)[:, None] * absorbed
    known = np.linalg.pinv(absorbed.T @ weights)
    return np.asarray(np.eye(KNOTS) - absorbed @ known @ weights.T)


def _visits(likelihood: Likelihood, model: Model, against: str) -> Array:
    """Return where the samples that count have been, of what a law depends on, shape (n,)."""
    return np.concatenate(
        [
            likelihood.channel.variables(one, simulated, model)[against][one.counts]
            for one, simulated in zip(likelihood.experiments, likelihood.simulate(model))
        ]
    )


def _visited(values: Array, at: Array) -> NDArray[np.bool_]:
    """Return which points have values near them, shape (points,)."""
    edges = np.concatenate([at[:1] - (at[1] - at[0]), 0.5 * (at[1:] + at[:-1]), at[-1:] + (at[1] - at[0])])
    return np.asarray(np.histogram(values, edges)[0] >= FEWEST_VISITS)
