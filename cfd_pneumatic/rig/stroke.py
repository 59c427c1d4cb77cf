# SPDX-License-Identifier: Apache-2.0
"""One quick movement from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.units import INCH


@dataclass(frozen=True)
class Stroke:
    """
    A piston let go, which gathers speed, flies on, and is caught by a mechanical stop.

    The speed rises and falls as half a cosine, so that the acceleration is continuous.
    """

    time: float
    """When it begins [s]."""

    start: float
    """Position before [m]."""

    end: float
    """Position after [m]."""

    duration: float
    """How long it takes [s]."""

    release: float
    """Time until full speed [s]."""

    impact: float
    """Time from full speed to rest at the stop [s]."""

    @classmethod
    def flight(cls, time: float, start: float, end: float) -> Stroke:
        """
        Return the stroke from `start` [m] to `end` [m] that an air cylinder's push gives, beginning at `time` [s].

        A constant push makes the duration grow with the root of the distance: 10 ms for 60 mil.
        """
        duration = 10e-3 * math.sqrt(max(abs(end - start), 1e-6) / (60e-3 * INCH))
        return cls(time, start, end, duration, release=0.3 * duration, impact=0.08 * duration)

    def __call__(self, times: Array) -> tuple[Array, Array]:
        """Return the positions [m] and velocities [m/s] at some times [s]."""
        speed = (self.end - self.start) / (self.duration - 0.5 * (self.release + self.impact))
        since = np.clip(times - self.time, 0.0, self.duration)
        left = self.duration - since
        gathered, gathering = _ramp(since, self.release)
        caught, catching = _ramp(left, self.impact)
        leaving = since < self.release
        stopping = left < self.impact
        flown = since - 0.5 * self.release
        free = self.start + speed * np.where(leaving, gathered, flown)
        positions = np.where(stopping, self.end - speed * caught, free)
        velocities = speed * np.where(leaving, gathering, np.where(stopping, catching, 1.0))
        return positions, velocities


def _ramp(times: Array, duration: float) -> tuple[Array, Array]:
    """Return the distance [s] and speed [1] after some times [s] of speeding up from 0 to 1 in a duration [s]."""
    phase = np.pi * times / duration
    return 0.5 * (times - duration / np.pi * np.sin(phase)), 0.5 * (1.0 - np.cos(phase))
