# SPDX-License-Identifier: Apache-2.0
"""Distance of the true surface from the taught path, and displacement of the piston over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.errors import InputError

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
