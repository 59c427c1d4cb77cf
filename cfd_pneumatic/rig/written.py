# SPDX-License-Identifier: Apache-2.0
"""Schedules that stand in a file, as `plan_experiment` writes them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.schedule import SAMPLING_PERIOD, Schedule, SetPoints, lay_out

_FAR = 1e12  # longer than any schedule may be, and no more than can be counted in samples [s]

SUFFIX = '.csv'
"""What the name of such a file ends with."""


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
    try:
        head, *rows = path.read_text(encoding='utf-8').splitlines()
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or 'it is empty or no text'
        raise InputError(f'cannot read the schedule {path}: {reason}; give one that plan_experiment wrote') from error
    if tuple(head.split(',')) != SCHEDULE_COLUMNS:
        raise InputError(f'{path} is no schedule: its first line is to be {",".join(SCHEDULE_COLUMNS)}')
    if len(rows) < 2:
        raise InputError(f'{path}: a schedule is to have two rows or more of {len(SCHEDULE_COLUMNS)} numbers')
    try:
        values = np.array([_numbers(row) for row in rows])
    except ValueError as error:
        raise InputError(f'{path}: each row of a schedule is to have {len(SCHEDULE_COLUMNS)} numbers') from error
    if not np.all(np.isfinite(values)) or values[0, 0] != 0.0 or not np.all(np.diff(values[:, 0]) > 0.0):
        raise InputError(f'{path}: a schedule is to have finite numbers, and times that increase from 0 on')
    return values.T


def _numbers(row: str) -> list[float]:
    numbers = [float(cell) for cell in row.split(',')]
    if len(numbers) != len(SCHEDULE_COLUMNS):
        raise ValueError(f'{len(numbers)} numbers')
    return numbers
