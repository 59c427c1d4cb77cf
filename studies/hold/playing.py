# SPDX-License-Identifier: Apache-2.0
"""Play predicted schedules on the rig, which gives the true force on the grid of the prediction."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.files import write_text
from cfd_pneumatic.path import Prediction, Surface, schedule_text
from cfd_pneumatic.rig import RigParameters, RigRecord, Schedule, record, written_schedule
from studies.hold.surfaces import PathTask

PERIOD = 1e-3
"""Time between the samples of a schedule that is played [s]."""

WIDEST_FEED, FEED_STEP = 1.6, 0.01
"""Largest ratio of a searched feed and the predicted feed, and the resolution of the search, relative."""


def schedule_of(prediction: Prediction, late: float = 0.0) -> Schedule:
    """Return the schedule of a prediction as the rig reads it, with set-points that arrive late [s]."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'schedule.csv'
        write_text(file, schedule_text(prediction))
        schedule = written_schedule(file, sampling_period=PERIOD)
    shift = round(late / PERIOD)
    levels = schedule.setpoints
    return replace(schedule, setpoints=np.concatenate([np.repeat(levels[:1], shift, axis=0), levels])[: len(levels)])


def play(prediction: Prediction, rig: RigParameters, late: float = 0.0, seed: int = 0) -> RigRecord:
    """Return the record of a prediction's schedule on the rig."""
    return record(schedule_of(prediction, late), rig, seed=seed)


def on_path(prediction: Prediction, times: Array, values: Array) -> Array:
    """Return values at times since the begin of the schedule [s] on the path of a prediction."""
    path = prediction.path
    return np.interp(path.grid[path.is_on_path] - path.grid[0], times, values)


def true_error(prediction: Prediction, rig: RigParameters, late: float = 0.0) -> Array:
    """Return the true force minus the wanted force on the path, shape (n,) [N]."""
    truth = play(prediction, rig, late).truth
    return on_path(prediction, truth.times, truth.force) - prediction.target


def shift_of(prediction: Prediction, surface: Surface) -> float:
    """Return the displacement of the piston at which the error of the surface is 0 [m]."""
    return float(prediction.path.displacement[0] - surface.error[0])


def played_feed(constant: Prediction, task: PathTask, rig: RigParameters, predicted: float) -> float:
    """
    Return the fastest feed that keeps the tolerance on the rig, by bisection [m/s].

    The result is infinite or 0 if this feed is not within a factor of `WIDEST_FEED` of the predicted feed.
    """
    shift = shift_of(constant, task.surface)

    def keeps(feed: float) -> bool:
        path = task.surface.at_feed(feed).shifted(shift)
        return float(np.max(np.abs(true_error(replace(constant, path=path), rig)))) <= task.tolerance

    low, high = predicted / WIDEST_FEED, predicted * WIDEST_FEED
    if keeps(predicted):
        if keeps(high):
            return math.inf
        low = predicted
    else:
        if not keeps(low):
            return 0.0
        high = predicted
    while high / low > 1.0 + FEED_STEP:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return math.sqrt(low * high)
