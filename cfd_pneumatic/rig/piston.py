# SPDX-License-Identifier: Apache-2.0
"""A piston that is told where to go."""

from __future__ import annotations

import math

import numpy as np

from cfd_pneumatic.arrays import Array


class CommandedPiston:
    """
    A motion towards a commanded position, limited in speed and acceleration.

    Parameters
    ----------
    position
        Where it stands [m].
    travel
        Largest displacement to either side [m]; commands beyond stop there.
    speed
        Highest speed [m/s].
    acceleration
        Highest acceleration [m/s^2].

    """

    def __init__(self, position: float, travel: float, speed: float, acceleration: float) -> None:
        self.position = position
        self.velocity = 0.0
        self._travel = travel
        self._speed = speed
        self._acceleration = acceleration
        self._target = position

    def command(self, target: float) -> None:
        """Head for a position [m]."""
        self._target = min(max(target, -self._travel), self._travel)

    def move(self, knots: int, period: float) -> tuple[Array, Array]:
        """Return the positions [m] and velocities [m/s] at the next knots, one period [s] apart."""
        positions, velocities = np.empty(knots), np.empty(knots)
        for knot in range(knots):
            before = self.velocity
            self.velocity = self._next_velocity(period)
            reached = self.position + 0.5 * (before + self.velocity) * period
            self.position = min(max(reached, -self._travel), self._travel)
            positions[knot], velocities[knot] = self.position, self.velocity
        return positions, velocities

    def _next_velocity(self, period: float) -> float:
        """
        Return the velocity [m/s] one period [s] on.

        The fastest from which the rest of the way is still enough to stop, as far as the limits let it change. Close
        by, the one from which the next change, to rest, ends at the target.
        """
        most = self._acceleration * period
        left = self._target - (self.position + 0.5 * self.velocity * period)
        landing = left / period
        if abs(landing) <= min(self._speed, most) and abs(landing - self.velocity) <= most:
            return landing
        stopping = math.sqrt(0.25 * most**2 + 2.0 * self._acceleration * abs(left)) - 0.5 * most
        wanted = math.copysign(min(self._speed, stopping), left)
        return self.velocity + min(max(wanted - self.velocity, -most), most)
