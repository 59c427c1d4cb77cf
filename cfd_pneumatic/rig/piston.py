# SPDX-License-Identifier: Apache-2.0
"""Motion of the piston: by commands, or by a tool through a linkage with or without a gap."""

from __future__ import annotations

import math

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.compilation import compiled


class CommandedPiston:
    """
    A motion towards a commanded position, limited in speed and acceleration.

    Parameters
    ----------
    position
        Position at the start [m].
    travel
        Largest displacement to either side, which limits the commands [m].
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
        """Set the commanded position [m]."""
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
        Return the velocity after a period [m/s].

        The velocity is the highest velocity that still allows a stop at the target, within the limits of speed and
        acceleration. Close to the target it is the velocity that reaches the target in the next period.
        """
        largest_change = self._acceleration * period
        distance = self._target - (self.position + 0.5 * self.velocity * period)
        landing = distance / period
        if abs(landing) <= min(self._speed, largest_change) and abs(landing - self.velocity) <= largest_change:
            return landing
        stopping = math.sqrt(0.25 * largest_change**2 + 2.0 * self._acceleration * abs(distance)) - 0.5 * largest_change
        wanted = math.copysign(min(self._speed, stopping), distance)
        return self.velocity + min(max(wanted - self.velocity, -largest_change), largest_change)


@compiled
def follow_with_gap(last: float, half_gap: float, leading: Array, following: Array) -> None:
    """Write the positions of a part that the edges of a gap move, from its last position [m]."""
    for index in range(leading.shape[0]):
        last = min(max(last, leading[index] - half_gap), leading[index] + half_gap)
        following[index] = last


class Linkage:
    """
    A linkage between a tool and the piston.

    Parameters
    ----------
    position
        Position of tool and piston at rest [m].
    gap
        Lost motion between the edges of the gap [m].

    """

    def __init__(self, position: float, gap: float) -> None:
        self._gap = gap
        self._position = position
        self._velocity = 0.0

    def drive(self, positions: Array, velocities: Array) -> tuple[Array, Array]:
        """
        Return the piston's positions [m] and velocities [m/s]: the present ones, then those at the tool's knots.

        The piston has the tool's velocity at an edge of the gap, and rests between the edges.
        """
        x = np.concatenate([[self._position], positions])
        v = np.concatenate([[self._velocity], velocities])
        if self._gap:
            follow_with_gap(self._position, 0.5 * self._gap, positions, x[1:])
            v[1:] = np.where(np.diff(x) == 0.0, 0.0, velocities)
        self._position, self._velocity = float(x[-1]), float(v[-1])
        return x, v
