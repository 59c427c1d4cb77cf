# SPDX-License-Identifier: Apache-2.0
"""Schedules by what people call them: a name, or a file that holds one."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable
from functools import partial
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import open_input
from cfd_pneumatic.rig.schedule import (
    SAMPLING_PERIOD,
    Schedule,
    SetPoints,
    lay_out,
    out_and_back,
    paper_step,
    surface_following,
)

_LARGEST = 2**27  # bytes; the longest that the rig plays, at 1 kHz, has 100 MB
_LONGEST_LINE = 200  # characters of its first line
_FAR = 1e12  # longer than any schedule may be, and no more than can be counted in samples [s]

SUFFIX = '.csv'
"""What the name of a file with a schedule ends with."""

SCHEDULES: dict[str, Callable[..., Schedule]] = {
    builder.__name__: builder for builder in (paper_step, out_and_back, surface_following)
}
"""The schedules by name."""


def schedule_named(name: str, **options: float) -> Schedule:
    """
    Return a schedule by its name, or from a file that `plan_experiment` wrote.

    Raises
    ------
    InputError
        If there is no such schedule, or it has no such option.

    """
    builder = partial(written_schedule, Path(name)) if name.endswith(SUFFIX) else SCHEDULES.get(name)
    if builder is None:
        raise InputError(f'schedule {name!r} is not known: use one of {", ".join(SCHEDULES)}, or a file *{SUFFIX}')
    known = inspect.signature(builder).parameters
    for option in options:
        if option not in known:
            raise InputError(f'schedule {name!r} has no option {option!r}: it takes {", ".join(known)}')
    return builder(**options)


def written_schedule(path: Path, *, sampling_period: float = SAMPLING_PERIOD) -> Schedule:
    """
    Return the schedule in a file, cubic between its rows.

    Parameters
    ----------
    path
        A table with the columns `SCHEDULE_COLUMNS`, times from 0 on.
    sampling_period
        Time between samples [s].

    Raises
    ------
    InputError
        If it is no such table.

    """
    from scipy.interpolate import CubicHermiteSpline  # which takes long to import

    times, positions, velocities, level_a, level_b = _columns(path)
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):  # what comes of it is looked at
        course = CubicHermiteSpline(times, positions, velocities)
        speed = course.derivative()
    if not (np.isfinite(course.c).all() and np.isfinite(speed.c).all()):
        raise InputError(f'{path}: a schedule is to have displacements and times that a piston can follow')

    def motion(at: Array) -> tuple[Array, Array]:
        within = np.minimum(at, times[-1])
        return course(within), np.where(at < times[-1], speed(within), 0.0)

    changes = np.flatnonzero((np.diff(level_a) != 0.0) | (np.diff(level_b) != 0.0)) + 1
    setpoints = [
        SetPoints(float(times[row]), float(level_a[row]), float(level_b[row])) for row in (0, *changes.tolist())
    ]
    samples = math.floor(min(float(times[-1]), _FAR) / sampling_period + 1e-6) + 1
    return lay_out(path.stem, motion, setpoints, samples, sampling_period)


def _columns(path: Path) -> Array:
    """Return the columns of a file, shape (5, n)."""
    count = len(SCHEDULE_COLUMNS)
    try:
        with TextIOWrapper(open_input(path, _LARGEST), 'utf-8') as stream:
            if stream.readline(_LONGEST_LINE).rstrip() != ','.join(SCHEDULE_COLUMNS):
                raise InputError(f'is no schedule: its first line must be {",".join(SCHEDULE_COLUMNS)}')
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # of a file without rows
                rows = np.loadtxt(stream, delimiter=',', comments=None, ndmin=2)
        if rows.shape[0] < 2:
            raise InputError(f'is no schedule: it must have two rows or more of {count} numbers')
        if rows.shape[1] != count:
            raise ValueError('is another table')
        if not np.isfinite(rows).all() or rows[0, 0] != 0.0 or not np.all(np.diff(rows[:, 0]) > 0.0):
            raise InputError('is no schedule: it must have finite numbers, and times that increase from 0 on')
    except InputError as error:
        raise InputError(f'{path} {error}; give one that plan_experiment wrote') from error
    except ValueError as error:
        raise InputError(f'{path} is no schedule: each row must have {count} numbers') from error
    return rows.T
