# SPDX-License-Identifier: Apache-2.0
"""The linkage between the tool, whose displacement is measured, and the piston: it may have a gap."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.compilation import compiled


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
