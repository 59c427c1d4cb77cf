# SPDX-License-Identifier: Apache-2.0
"""Schedules by their names, and schedules in files."""

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

_LARGEST = 2**27  # bytes; the longest schedule of the rig, at 1 kHz, has 100 MB
_LONGEST_LINE = 200  # characters of the first line of a file
_FAR = 1e12  # longer than any schedule may be, and countable in samples [s]

SUFFIX = '.csv'
"""Suffix of a file with a schedule."""

SCHEDULES: dict[str, Callable[..., Schedule]] = {
    builder.__name__: builder for builder in (paper_step, out_and_back, surface_following)
}
"""The schedules by name."""


def schedule_named(name: str, **options: float) -> Schedule:
    """
    Return a schedule by its name, or from a file that `plan_experiment` or `force_on_path` wrote.

    Raises
    ------
    InputError
        If the schedule or an option is not known.

    """
    builder = partial(written_schedule, Path(name)) if name.endswith(SUFFIX) else SCHEDULES.get(name)
    if builder is None:
        raise InputError(f'schedule {name!r} is not known: use one of {", ".join(SCHEDULES)}, or a file *{SUFFIX}')
    known = inspect.signature(builder).parameters
    for option in options:
        if option not in known:
            raise InputError(f'schedule {name!r} has no option {option!r}: its options are {", ".join(known)}')
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
        If the file is not a schedule.

    """
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    times, positions, velocities, level_a, level_b = _columns(path)
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):  # non-finite results are refused below
        course = CubicHermiteSpline(times, positions, velocities)
        speed = course.derivative()
    if not (np.isfinite(course.c).all() and np.isfinite(speed.c).all()):
        raise InputError(f'{path} is not a schedule: a piston cannot follow its displacements; check times and speeds')

    def motion(query_times: Array) -> tuple[Array, Array]:
        within = np.minimum(query_times, times[-1])
        return course(within), np.where(query_times < times[-1], speed(within), 0.0)

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
                raise InputError(f'is not a schedule: its first line must be {",".join(SCHEDULE_COLUMNS)}')
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # about a file without rows
                rows = np.loadtxt(stream, delimiter=',', comments=None, ndmin=2)
        if rows.shape[0] < 2:
            raise InputError(f'is not a schedule: it must have two rows or more of {count} numbers')
        if rows.shape[1] != count:
            raise ValueError('wrong number of columns')
        if not np.isfinite(rows).all() or rows[0, 0] != 0.0 or not np.all(np.diff(rows[:, 0]) > 0.0):
            raise InputError('is not a schedule: it must have finite numbers, and times that increase from 0 on')
    except InputError as error:
        raise InputError(f'{path} {error}; give a schedule written by plan_experiment or force_on_path') from error
    except ValueError as error:
        raise InputError(f'{path} is not a schedule: each row must have {count} numbers') from error
    return rows.T
