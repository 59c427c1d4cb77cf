# SPDX-License-Identifier: Apache-2.0
"""
Least squares within bounds, by Levenberg and Marquardt.

Where residuals are many and unknowns few, all that a step needs is the small normal matrix, which may be summed up from
blocks of residuals: memory and time go into the simulations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.fit.thresholds import (
    FIRST_DAMPING,
    LARGEST_DAMPING,
    LARGEST_SHORTENING,
    LEAST_DAMPING_FACTOR,
    LEAST_PIVOT,
    LEAST_SCALE,
    LEAST_SHORTENING,
    MOST_ACTIVE_SET_CHANGES,
)
from cfd_pneumatic.identification.residual import gram


@dataclass(frozen=True)
class Quadratic:
    """
    What a sum of squared residuals is like near a point.

    Attributes
    ----------
    total
        The sum, r'r.
    gradient
        Half of its gradient, J'r, shape (k,).
    normal
        J'J, shape (k, k).

    """

    total: float
    gradient: Array
    normal: Array

    @classmethod
    def of(cls, rows: Array) -> Quadratic:
        """Return it for residuals with their derivatives below them, shape (1 + k, n)."""
        products = gram(rows)
        return cls(float(products[0, 0]), products[0, 1:], products[1:, 1:])

    def beside_prior(self, away: Array, precision: Array, count: int) -> Quadratic:
        """
        Return it beside what is known of the point: how far it is from what is expected, and how precisely that is.

        Times 1 + q / n with q = sum(precision away^2), as n log(sum) + q falls where the residuals' variance is not
        known.
        """
        if not self.is_finite:
            return self
        slope, variance = precision * away, self.total / count
        factor = 1.0 + float(away @ slope) / count
        return Quadratic(
            factor * self.total,
            factor * self.gradient + variance * slope,
            factor * self.normal + variance * np.diag(precision),
        )

    @property
    def is_finite(self) -> bool:
        """Whether the model has not run away."""
        return math.isfinite(self.total) and bool(np.isfinite(self.normal).all())

    def size(self, step: Array) -> float:
        """Return the size of a step, shape (k,): each unknown counts by what it alone changes."""
        return math.sqrt(float(np.diag(self.normal) @ step**2))


Evaluate = Callable[[Array], Quadratic]
"""Takes a point, shape (k,)."""


def least_squares(
    evaluate: Evaluate,
    start: Array,
    lower: Array,
    upper: Array,
    tolerance: float,
    evaluations: int,
    enough: float = 0.0,
    longest: Array | None = None,
) -> tuple[Array, Quadratic]:
    """
    Return the point with the least sum of squared residuals that is found from a start, and what the sum is like there.

    Damped by the diagonal of the normal matrix (Marquardt, 1963), the damping led by how well the last step was
    predicted (Nielsen, 1999). A step that raised the sum is made so much shorter as a parabola through both sums says,
    between a tenth and a half (More, 1978). An unknown at a bound stays there while the sum falls outwards. One that
    changes the residuals less than a millionth as much as another does is held back, as if nothing depended on it.

    Parameters
    ----------
    evaluate
        The sum and its slope at a point.
    start, lower, upper
        Shape (k,).
    tolerance
        The search ends when a step, taken or predicted, lowers the sum by less than this share.
    evaluations
        Most calls of `evaluate`.
    enough
        A sum that is not to be lowered any more.
    longest
        Step of each unknown at most, shape (k,); by default any.

    """
    longest = np.full(start.size, np.inf) if longest is None else longest
    point = np.clip(start, lower, upper)
    here = evaluate(point)
    if not here.is_finite:
        return point, replace(here, total=math.inf)
    damping = FIRST_DAMPING
    for _ in range(evaluations - 1):
        if here.total <= enough:
            break
        step, predicted = _step(here, damping, lower - point, upper - point, longest)
        if predicted <= tolerance * here.total:
            break
        trial = np.clip(point + step, lower, upper)  # exactly, where rounding takes it past a bound
        there = evaluate(trial)
        fell = here.total - there.total
        if not (fell > 0.0 and there.is_finite):
            shorter = _shortening(here, step, there.total) * here.size(step)
            while here.size(step) > shorter and damping < LARGEST_DAMPING:
                damping *= 2.0
                step, _ = _step(here, damping, lower - point, upper - point, longest)
            if damping >= LARGEST_DAMPING:
                break
            continue
        damping *= max(LEAST_DAMPING_FACTOR, 1.0 - (2.0 * fell / predicted - 1.0) ** 3)
        point, here = trial, there
        if fell <= tolerance * here.total:
            break
    return point, here


def _shortening(here: Quadratic, step: Array, risen: float) -> float:
    """Return by how much a step that raised the sum is to be shortened: to the least of a parabola through both."""
    if not math.isfinite(risen):
        return LEAST_SHORTENING
    fall = -2.0 * float(here.gradient @ step)
    return min(max(0.5 * fall / (risen - here.total + fall), LEAST_SHORTENING), LARGEST_SHORTENING)


def _step(here: Quadratic, damping: float, down: Array, up: Array, longest: Array) -> tuple[Array, float]:
    """
    Return the damped step within `down` and `up` that lowers the sum most, as far as it is predicted, and by how much.

    By an active set: unknowns are held at bounds that they meet on the way, and let go where the sum falls inwards.
    Were the free step clipped instead, it might not lower the sum at all.
    """
    normal, gradient = here.normal, here.gradient
    size = gradient.size
    scale = np.diag(normal)
    inner = normal + damping * np.diag(np.maximum(scale, LEAST_SCALE * max(np.max(scale), LEAST_PIVOT)))
    step = np.zeros(size)
    held = ((down >= 0.0) & (gradient > 0.0)) | ((up <= 0.0) & (gradient < 0.0))
    for _ in range(MOST_ACTIVE_SET_CHANGES * size):
        free = np.flatnonzero(~held)
        slope = gradient + inner @ step
        move = -np.linalg.solve(inner[free][:, free], slope[free])
        share, first = 1.0, -1
        for rank, index in enumerate(free):
            room = up[index] - step[index] if move[rank] > 0.0 else step[index] - down[index]
            if room < share * abs(move[rank]):
                share, first = room / abs(move[rank]), rank
        step[free] += share * move
        if first >= 0:
            step[free[first]] = up[free[first]] if move[first] > 0.0 else down[free[first]]
            held[free[first]] = True
            continue
        slope = gradient + inner @ step
        inwards = np.where(held, np.where(step <= down, -slope, np.where(step >= up, slope, 0.0)), 0.0)
        if np.max(inwards) <= 0.0:
            break
        held[np.argmax(inwards)] = False
    step /= max(1.0, np.max(np.abs(step) / longest))
    step = np.minimum(np.maximum(step, down), up)
    return step, -float(step @ (2.0 * gradient + normal @ step))
