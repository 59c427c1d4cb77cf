# SPDX-License-Identifier: Apache-2.0
"""Motion of the piston along a path: given over time, or as the error of a surface that is passed at a feed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.path.thresholds import PERIOD, REST

MOST_POINTS = 2_000_000
"""Number of points of a path: more than half an hour at 1 kHz."""


@dataclass(frozen=True)
class Surface:
    """
    Distance of the true surface from the taught path, over the position along the path.

    Attributes
    ----------
    along : (n,) array
        Position along the path [m]; begins at 0 and increases strictly.
    error : (n,) array
        Distance of the surface from the path [m]; where it is positive, the piston moves along +x, which grows
        cylinder A.
    notes : tuple of str
        Messages to the user on defects of the input.

    Raises
    ------
    InputError
        If there are fewer than two points, or the numbers are not as described.

    """

    along: Array
    error: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the arrays."""
        _check_series('the position along the path', self.along, {'the error of the surface': self.error})

    def at_feed(self, feed: float) -> PathMotion:
        """
        Return the piston's motion if the tool passes the surface at a feed [m/s].

        Raises
        ------
        InputError
                If the feed is not a positive number.

        """
        if not (np.isfinite(feed) and feed > 0.0):
            raise InputError(f'the feed must be a positive speed, is {feed:g} m/s')
        return PathMotion(self.along / feed, self.error, self.along, self.notes)


@dataclass(frozen=True)
class PathMotion:
    """
    Displacement of the piston over time.

    Attributes
    ----------
    times : (n,) array
        Time [s]; begins at 0 and increases strictly.
    displacement : (n,) array
        Displacement of the piston [m]; +x grows cylinder A.
    along : (n,) array or None
        Position along the path [m]; None if it is not known.
    notes : tuple of str
        Messages to the user on defects of the input.

    Raises
    ------
    InputError
        If there are fewer than two points, or the numbers are not as described.

    """

    times: Array
    displacement: Array
    along: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the arrays."""
        along = {} if self.along is None else {'the position along the path': self.along}
        _check_series('the time', self.times, {'the displacement': self.displacement, **along})

    @property
    def duration(self) -> float:
        """Duration of the path [s]."""
        return float(self.times[-1])

    @lazy_property
    def grid(self) -> Array:
        """Even times of a simulation, with a rest before time 0 and after the path, shape (m,) [s]."""
        before, after = (int(np.ceil(span / PERIOD)) for span in (REST, self.duration + REST))
        return np.asarray(PERIOD * np.arange(-before, after + 1))

    @lazy_property
    def is_on_path(self) -> Mask:
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
        return PathMotion(self.times, self.displacement + displacement, self.along, self.notes)

    @lazy_property
    def _course(self) -> PchipInterpolator:
        """Interpolation of the displacement, which does not overshoot the given values."""
        return PchipInterpolator(self.times, self.displacement)


def _check_series(name: str, base: Array, values: dict[str, Array]) -> None:
    """Refuse values over a base that does not begin at 0 and increase, other lengths, and numbers not finite."""
    if base.ndim != 1 or any(array.shape != base.shape for array in values.values()):
        raise InputError(f'{", ".join([name, *values])} must have one number for each point')
    if len(base) < 2:
        raise InputError('has fewer than 2 points: a path needs at least 2')
    for quantity, array in {name: base, **values}.items():
        if not np.isfinite(array).all():
            raise InputError(f'{quantity} is not finite at point {_first(~np.isfinite(array))}: remove the point')
    if base[0] != 0.0:
        raise InputError(f'{name} begins at {base[0]:g}: it must begin at 0')
    steps = np.diff(base) > 0.0
    if not steps.all():
        raise InputError(
            f'{name} does not increase from point {_first(~steps)} to the next: sort the points, remove repeated ones'
        )


def _first(flags: Mask) -> int:
    """Return the number of the first point that is flagged, from 1 on."""
    return int(np.argmax(flags)) + 1
