# SPDX-License-Identifier: Apache-2.0
"""
What a curve in some place screened_curves, before it is fitted.

Where it enters and on what it depends is asked of the residual, linearised: what each place and each variable may take
beside the model's own unknowns, by the marginal likelihood of a smooth curve (restricted maximum likelihood).
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
from cfd_pneumatic.identification.search.curve_places import CurvePlace, slots
from cfd_pneumatic.identification.search.thresholds import (
    CURVE_STRETCH_STEPS,
    HEIGHT_PENALTY,
    LEAST_DIVISOR,
    LEAST_EIGENVALUE,
)
from cfd_pneumatic.model import COUNT, KNOTS
from cfd_pneumatic.runtime import map_in_threads

_PENALTIES = np.logspace(-8.0, 8.0, 65)  # of a curve's roughness, beside what data say of it
_COARSE = np.maximum(1.0 - np.abs(0.5 * np.arange(KNOTS) - np.arange(KNOTS // 2 + 1)[:, None]), 0.0)  # every other knot


@dataclass(frozen=True)
class ScreenedCurve:
    """
    What a curve in some place screened_curves.

    Attributes
    ----------
    slot
        The place.
    evidence
        By how much it raises twice the log likelihood.
    left
        Share of the residual's squares that it leaves.
    penalty
        Of its roughness: the variance of the noise over that of its bends.
    heights
        In the slot's unit, shape (knots,).

    """

    slot: CurvePlace
    evidence: float
    left: float
    penalty: float
    heights: Array


def beside(model: Model, promise: ScreenedCurve, share: float = 1.0) -> Model:
    """Return a model with a share of a curve as it is promised."""
    return promise.slot.on(model, share * promise.slot.unit * promise.heights)


def screened_curves(candidates: Candidates, begin: Candidate) -> list[ScreenedCurve]:
    """Return what a curve in each place screened_curves beside a model, the most promising one first."""
    complement = Complement(candidates.learn.spread(CURVE_STRETCH_STEPS), begin.model)
    residual = complement.residual
    share = independent_share(candidates.resting_coefficients(begin))

    def promised(some: Sequence[CurvePlace]) -> list[ScreenedCurve]:
        starts = [slot.parameters(slot.unit * coarse) for slot in some for coarse in _COARSE]
        changes = np.hsplit(complement.left(complement.changes(candidates.channel.curve.name, starts)), len(some))
        return [_promise(slot, residual, own, share) for slot, own in zip(some, changes)]

    places = slots(candidates, begin)
    together = [places[first : first + COUNT] for first in range(0, len(places), COUNT)]
    return sorted(chain.from_iterable(map_in_threads(promised, together)), key=lambda one: -one.evidence)


def _promise(slot: CurvePlace, residual: Array, changes: Array, share: float) -> ScreenedCurve:
    """
    Return what the coarse heights of a curve promise, which change the simulation so, shape (n, coarse).

    Heights are normal, with the inverse of the roughness as their covariance: the evidence is the marginal likelihood,
    of which the noise's variance is profiled out, at its best penalty.
    """
    if not np.all(np.isfinite(changes)) or not np.any(changes):
        return ScreenedCurve(slot, -math.inf, 1.0, 1.0, np.zeros(KNOTS))
    root = np.linalg.cholesky(_COARSE @ roughness() @ _COARSE.T)
    bent = np.linalg.solve(root, changes.T)
    squares, axes = np.linalg.eigh(bent @ bent.T)
    squares = np.maximum(squares, LEAST_EIGENVALUE * squares[-1])  # below rounding, and far below every penalty
    along = axes.T @ (bent @ residual)
    power, count = float(residual @ residual), residual.size * share
    penalties = _PENALTIES * float(squares[-1])
    taken = squares / (squares + penalties[:, None])
    remaining = 1.0 - taken @ (along**2 / squares) / max(power, LEAST_DIVISOR)
    values = count * np.log(np.maximum(remaining, LEAST_DIVISOR)) - np.sum(np.log1p(-taken), axis=1)
    best = int(np.argmin(values))
    penalty = float(penalties[best])
    heights = np.linalg.solve(root.T, axes @ (along / (squares + penalty))) @ _COARSE
    return ScreenedCurve(slot, -float(values[best]), float(remaining[best]), penalty, heights)


def roughness() -> Array:
    """Return the matrix of a curve's squared bends, and of a little of its height, shape (knots, knots)."""
    bends = np.diff(np.eye(KNOTS), 2, axis=0)
    return np.asarray(bends.T @ bends + HEIGHT_PENALTY * np.eye(KNOTS))
