# SPDX-License-Identifier: Apache-2.0
"""A quick movement from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.units import INCH


@dataclass(frozen=True)
class Stroke:
    """
    The movement of a released piston, which accelerates, moves on, and is caught by a mechanical stop.

    The speed rises and falls as half a cosine, so that the acceleration is continuous.
    """

    time: float
    """Time at which the stroke begins [s]."""

    start: float
    """Position before the stroke [m]."""

    end: float
    """Position after the stroke [m]."""

    duration: float
    """Duration of the stroke [s]."""

    release: float
    """Time until full speed [s]."""

    impact: float
    """Time from full speed to rest at the stop [s]."""

    @classmethod
    def flight(cls, time: float, start: float, end: float) -> Stroke:
        """
        Return the stroke from `start` [m] to `end` [m] by the force of an air cylinder, beginning at `time` [s].

        A constant force makes the duration proportional to the root of the distance: 10 ms for 60 mil.
        """
        duration = 10e-3 * math.sqrt(max(abs(end - start), 1e-6) / (60e-3 * INCH))
        return cls(time, start, end, duration, release=0.3 * duration, impact=0.08 * duration)

    def __call__(self, times: Array) -> tuple[Array, Array]:
        """Return the positions [m] and velocities [m/s] at times [s]."""
        speed = (self.end - self.start) / (self.duration - 0.5 * (self.release + self.impact))
        elapsed = np.clip(times - self.time, 0.0, self.duration)
        remaining = self.duration - elapsed
        release_distance, release_speed = _ramp(elapsed, self.release)
        impact_distance, impact_speed = _ramp(remaining, self.impact)
        is_release = elapsed < self.release
        is_impact = remaining < self.impact
        free_distance = elapsed - 0.5 * self.release
        before_impact = self.start + speed * np.where(is_release, release_distance, free_distance)
        positions = np.where(is_impact, self.end - speed * impact_distance, before_impact)
        velocities = speed * np.where(is_release, release_speed, np.where(is_impact, impact_speed, 1.0))
        return positions, velocities


def _ramp(times: Array, duration: float) -> tuple[Array, Array]:
    """Return distance [s] and speed [-] at times [s] of an acceleration from speed 0 to 1 in a duration [s]."""
    phase = np.pi * times / duration
    return 0.5 * (times - duration / np.pi * np.sin(phase)), 0.5 * (1.0 - np.cos(phase))
