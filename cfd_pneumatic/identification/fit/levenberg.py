# SPDX-License-Identifier: Apache-2.0
"""
Least squares within bounds, by Levenberg and Marquardt.

A step needs only the normal matrix, which is small and may be summed from blocks of residuals. Memory and time are
spent on the simulations.
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
    LARGEST_LOOSENING,
    LARGEST_SHORTENING,
    LEAST_DAMPING_FACTOR,
    LEAST_PIVOT,
    LEAST_SCALE,
    LEAST_SHORTENING,
    LEAST_SUM_OF_SQUARES,
    MOST_ACTIVE_SET_CHANGES,
)
from cfd_pneumatic.identification.residual import gram


@dataclass(frozen=True)
class Quadratic:
    """
    Quadratic model of a sum of squared residuals near a point.

    Attributes
    ----------
    total
        Sum of squares, r'r.
    gradient
        Half of the gradient, J'r, shape (k,).
    normal
        J'J, shape (k, k).

    """

    total: float
    gradient: Array
    normal: Array

    @classmethod
    def from_rows(cls, rows: Array) -> Quadratic:
        """Return the quadratic for residuals in the first row and their derivatives below, shape (1 + k, n)."""
        products = gram(rows)
        return cls(float(products[0, 0]), products[0, 1:], products[1:, 1:])

    def with_prior(self, deviation: Array, precision: Array, count: int) -> Quadratic:
        """
        Return the quadratic with a prior: deviation of the point from the expectation, and precision, shape (k,).

        The sum is multiplied by 1 + q / n with q = sum(precision deviation^2). To first order this minimises
        n log(sum) + q, because the residuals' variance is not known.
        """
        if not self.is_finite:
            return self
        slope, variance = precision * deviation, self.total / count
        factor = 1.0 + float(deviation @ slope) / count
        return Quadratic(
            factor * self.total,
            factor * self.gradient + variance * slope,
            factor * self.normal + variance * np.diag(precision),
        )

    @property
    def is_finite(self) -> bool:
        """Whether the model has not diverged."""
        return math.isfinite(self.total) and bool(np.isfinite(self.normal).all())

    def size(self, step: Array) -> float:
        """Return the size of a step, shape (k,): each unknown counts by the change that its step alone makes."""
        return math.sqrt(float(np.diag(self.normal) @ step**2))


Evaluate = Callable[[Array], Quadratic]
"""Returns the quadratic at a point, shape (k,)."""


def least_squares(
    evaluate: Evaluate,
    start: Array,
    lower: Array,
    upper: Array,
    tolerance: float,
    evaluations: int,
    enough: float = 0.0,
    longest: Array | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
    noise: float = math.inf,
) -> tuple[Array, Quadratic]:
    """
    Return the point with the least sum of squared residuals near a start, and the quadratic there.

    The diagonal of the normal matrix damps the steps (Marquardt, 1963). The damping depends on how well the last step
    was predicted (Nielsen, 1999). A step that raised the sum is shortened to the minimum of a parabola through both
    sums. The factor is between a tenth and a half (More, 1978). An unknown at a bound stays there while the sum falls
    outwards. An unknown is held back if it changes the residuals less than a millionth as much as another unknown.

    Parameters
    ----------
    evaluate
        Returns the quadratic at a point.
    start, lower, upper
        Shape (k,).
    tolerance
        The search ends when a step, taken or predicted, lowers the sum by less than this share. Far above the noise the
        share is larger, because thousandths of a large sum decide nothing.
    evaluations
        Most calls of `evaluate`.
    enough
        Sum at which the search ends.
    longest
        Largest step of each unknown, shape (k,); by default unlimited.
    is_stopped
        Returns whether the user has ended the search, which then ends at the best point so far.
    noise
        Sum of squares of the noise alone; by default the share `tolerance` holds for every sum.

    """

    def least_fall(total: float) -> float:
        return tolerance * total * min(max(total / max(noise, LEAST_SUM_OF_SQUARES), 1.0), LARGEST_LOOSENING)

    longest = np.full(start.size, np.inf) if longest is None else longest
    point = np.clip(start, lower, upper)
    current = evaluate(point)
    if not current.is_finite:
        return point, replace(current, total=math.inf)
    damping = FIRST_DAMPING
    for _ in range(evaluations - 1):
        if current.total <= enough or is_stopped():
            break
        step, predicted = _step(current, damping, lower - point, upper - point, longest)
        if predicted <= least_fall(current.total):
            break
        trial = np.clip(point + step, lower, upper)  # rounding may take the point past a bound
        trial_value = evaluate(trial)
        decrease = current.total - trial_value.total
        if not (decrease > 0.0 and trial_value.is_finite):
            shorter = _shortening(current, step, trial_value.total) * current.size(step)
            while current.size(step) > shorter and damping < LARGEST_DAMPING:
                damping *= 2.0
                step, _ = _step(current, damping, lower - point, upper - point, longest)
            if damping >= LARGEST_DAMPING:
                break
            continue
        damping *= max(LEAST_DAMPING_FACTOR, 1.0 - (2.0 * decrease / predicted - 1.0) ** 3)
        point, current = trial, trial_value
        if decrease <= least_fall(current.total):
            break
    return point, current


def _shortening(current: Quadratic, step: Array, trial_cost: float) -> float:
    """Return the factor that shortens a step that raised the sum, to the minimum of a parabola through both sums."""
    if not math.isfinite(trial_cost):
        return LEAST_SHORTENING
    slope = -2.0 * float(current.gradient @ step)
    return min(max(0.5 * slope / (trial_cost - current.total + slope), LEAST_SHORTENING), LARGEST_SHORTENING)


def _step(current: Quadratic, damping: float, lowest: Array, highest: Array, longest: Array) -> tuple[Array, float]:
    """
    Return the damped step within `lowest` and `highest` with the largest predicted decrease, and this decrease.

    An active set holds unknowns at bounds that they meet, and releases unknowns if the sum falls inwards. A clipped
    free step might not lower the sum at all.
    """
    normal, gradient = current.normal, current.gradient
    size = gradient.size
    scale = np.diag(normal)
    inner = normal + damping * np.diag(np.maximum(scale, LEAST_SCALE * max(np.max(scale), LEAST_PIVOT)))
    step = np.zeros(size)
    is_held = ((lowest >= 0.0) & (gradient > 0.0)) | ((highest <= 0.0) & (gradient < 0.0))
    for _ in range(MOST_ACTIVE_SET_CHANGES * size):
        free = np.flatnonzero(~is_held)
        slope = gradient + inner @ step
        move = -np.linalg.solve(inner[free][:, free], slope[free])
        share, blocking = 1.0, -1
        for rank, index in enumerate(free):
            room = highest[index] - step[index] if move[rank] > 0.0 else step[index] - lowest[index]
            if room < share * abs(move[rank]):
                share, blocking = room / abs(move[rank]), rank
        step[free] += share * move
        if blocking >= 0:
            step[free[blocking]] = highest[free[blocking]] if move[blocking] > 0.0 else lowest[free[blocking]]
            is_held[free[blocking]] = True
            continue
        slope = gradient + inner @ step
        inward_slope = np.where(is_held, np.where(step <= lowest, -slope, np.where(step >= highest, slope, 0.0)), 0.0)
        if np.max(inward_slope) <= 0.0:
            break
        is_held[np.argmax(inward_slope)] = False
    step /= max(1.0, np.max(np.abs(step) / longest))
    step = np.minimum(np.maximum(step, lowest), highest)
    return step, -float(step @ (2.0 * gradient + normal @ step))
