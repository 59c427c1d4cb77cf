# SPDX-License-Identifier: Apache-2.0
"""Motions of a piston and sequences of set-points, at 1 kHz."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE = 1000
"""Rate of motions, set-points and controllers [Hz]."""


class Plan(NamedTuple):
    """
    Form of a recording.

    Attributes
    ----------
    seconds
        Duration [s].
    steps
        Number of set-point changes.
    last_step
        Share of the duration that contains the set-point changes [-].
    stroke
        Largest distance of the piston from its centre [m].
    wider_from
        Share of the duration from which strokes are twice as large [-].
    period
        Time between logged samples [ms].
    cylinders
        Number of cylinders.

    """

    seconds: float = 60.0
    steps: int = 7
    last_step: float = 0.92
    stroke: float = 3e-3
    wider_from: float = 1.0
    period: int = 2
    cylinders: int = 1


def motion(random: np.random.Generator, plan: Plan, speed: float) -> tuple[Array, Array]:
    """Return position [m] and velocity [m/s] of strokes with pauses, with peak speeds about `speed` [m/s]."""
    count = round(plan.seconds * RATE)
    position = np.zeros(count)
    velocity = np.zeros(count)
    here, at = 0.0, int(random.integers(RATE // 2, RATE))
    while at < count:
        factor = 2.0 if at >= plan.wider_from * count else 1.0
        there = factor * plan.stroke * random.uniform(-1.0, 1.0)
        seconds = 1.875 * abs(there - here) / (factor * speed * random.uniform(0.4, 1.3))
        length = max(round(seconds * RATE), 40)
        share = np.arange(1, length + 1) / length
        end = min(at + length, count)
        shape = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        slope = 30.0 * share**2 * (1.0 - share) ** 2 * RATE / length
        position[at:end] = here + (there - here) * shape[: end - at]
        velocity[at:end] = (there - here) * slope[: end - at]
        pause = int(random.integers(30, 600))
        position[end : end + pause] = there
        here, at = there, end + pause
    return position, velocity


def setpoints(random: np.random.Generator, plan: Plan) -> Array:
    """Return gauge set-points [Pa] that change by at least 20 kPa at irregular times."""
    count = round(plan.seconds * RATE)
    levels = [float(random.integers(12, 21))]
    while len(levels) <= plan.steps:
        level = float(random.integers(12, 21))
        if abs(level - levels[-1]) >= 2.0:
            levels.append(level)
    spacing = plan.last_step * count / plan.steps
    times = (np.arange(1, plan.steps + 1) - random.uniform(0.05, 0.35, plan.steps)) * spacing
    return 1e4 * np.array(levels)[np.searchsorted(times, np.arange(count), side='right')]
