# SPDX-License-Identifier: Apache-2.0
"""Motion of the piston along a path: given over time, or as the error of a surface that is passed at a feed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.path.thresholds import LONGEST_PATH, PERIOD, REST


@dataclass(frozen=True)
class Surface:
    """
    Error of a surface: its distance from the taught path.

    Attributes
    ----------
    along
        Positions along the path, increasing from 0, shape (n,) [m].
    error
        Distance of the surface from the taught path, shape (n,) [m]; the piston moves along +x if it grows.

    """

    along: Array
    error: Array

    def at_feed(self, feed: float) -> PathMotion:
        """
        Return the piston's motion if the tool passes the surface at a feed [m/s].

        Raises
        ------
        InputError
            If the feed is not a positive number, or the path takes too long at this feed.

        """
        if not (np.isfinite(feed) and feed > 0.0):
            raise InputError(f'--feed must be a positive speed, is {feed:g} m/s')
        return PathMotion(self.along / feed, self.error, self.along)


@dataclass(frozen=True)
class PathMotion:
    """
    Displacement of the piston over time along a path.

    Attributes
    ----------
    times
        Times, increasing from 0, shape (n,) [s].
    displacement
        Displacement of the piston, shape (n,) [m]; +x grows cylinder A.
    along
        Positions along the path, shape (n,) [m]; None if they are not known.

    Raises
    ------
    InputError
        If the path takes longer than `LONGEST_PATH`.

    """

    times: Array
    displacement: Array
    along: Array | None = None

    def __post_init__(self) -> None:
        """Check the duration."""
        if self.duration > LONGEST_PATH:
            raise InputError(
                f'the path takes {self.duration:.0f} s, but {LONGEST_PATH:.0f} s are the longest that is simulated. '
                'Split the path, or choose a faster feed'
            )

    @property
    def duration(self) -> float:
        """Duration of the path [s]."""
        return float(self.times[-1])

    @lazy_property
    def grid(self) -> Array:
        """Even times of a simulation, with a rest before time 0 and after the path, shape (m,) [s]."""
        before, after = (int(np.ceil(span / PERIOD)) for span in (REST, self.duration + REST))
        return PERIOD * np.arange(-before, after + 1)

    @lazy_property
    def is_on_path(self) -> np.ndarray:
        """Whether each time of the grid is on the path, shape (m,)."""
        return (self.grid >= 0.0) & (self.grid <= self.duration)

    def displacement_at(self, times: Array) -> Array:
        """Return the displacement at some times [m]; the piston rests before and after the path."""
        return np.asarray(self._course(np.clip(times, 0.0, self.duration)))

    def speed_at(self, times: Array) -> Array:
        """Return the speed of the piston at some times [m/s]; zero before and after the path."""
        within = (times >= 0.0) & (times <= self.duration)
        return np.where(within, self._course.derivative()(np.clip(times, 0.0, self.duration)), 0.0)

    def along_at(self, times: Array) -> Array | None:
        """Return the position along the path at some times [m]; None if it is not known."""
        return None if self.along is None else np.interp(times, self.times, self.along)

    def shifted(self, displacement: float) -> PathMotion:
        """Return the motion with a constant added to the displacement [m]."""
        return PathMotion(self.times, self.displacement + displacement, self.along)

    @lazy_property
    def _course(self) -> PchipInterpolator:
        """Interpolation of the displacement, which does not overshoot the given values."""
        return PchipInterpolator(self.times, self.displacement)
