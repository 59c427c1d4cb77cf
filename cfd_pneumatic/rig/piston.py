# SPDX-License-Identifier: Apache-2.0
"""How a piston is moved: by commands, or by a tool that it hangs on, with or without a gap."""

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


@compiled
def follow(held: float, half_gap: float, leading: Array, following: Array) -> None:
    """Fill in where the follower in a gap goes; it is moved by either edge, and stays where it was in between [m]."""
    for index in range(leading.shape[0]):
        held = min(max(held, leading[index] - half_gap), leading[index] + half_gap)
        following[index] = held


class Linkage:
    """
    A piston that hangs on a tool.

    Parameters
    ----------
    position
        Position of both at rest [m].
    gap
        Lost motion on the way from one edge of the gap to the other [m].

    """

    def __init__(self, position: float, gap: float) -> None:
        self._gap = gap
        self._position = position
        self._velocity = 0.0

    def drive(self, positions: Array, velocities: Array) -> tuple[Array, Array]:
        """
        Return the piston's positions [m] and velocities [m/s] at knots of the tool's, the present one put first.

        The piston has the tool's velocity where it touches an edge, and none in between.
        """
        x = np.concatenate([[self._position], positions])
        v = np.concatenate([[self._velocity], velocities])
        if self._gap:
            follow(self._position, 0.5 * self._gap, positions, x[1:])
            v[1:] = np.where(np.diff(x) == 0.0, 0.0, velocities)
        self._position, self._velocity = float(x[-1]), float(v[-1])
        return x, v
