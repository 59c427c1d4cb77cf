# SPDX-License-Identifier: Apache-2.0
"""Operating points: a separate fit for each set-point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.identification.fit import Fit, fit_model
from cfd_pneumatic.identification.result import OperatingPoint
from cfd_pneumatic.identification.thresholds import LARGEST_SETPOINT_GAP


def schedule_of(joint: Fit, options: Options) -> tuple[list[OperatingPoint], list[Array], list[str]]:
    """Return the operating points, the simulated signals, and notes about ignored set-points."""
    levels = joint.likelihood.channel.levels(joint.likelihood.experiments, joint.model)
    if options.per_setpoint and levels:
        return _fit_each_setpoint(joint, levels, options.ambient_pressure)
    schedule = [OperatingPoint(float(np.mean(np.concatenate(levels))), joint)] if levels else []
    return schedule, list(joint.simulated), []


def _fit_each_setpoint(
    joint: Fit, levels: Sequence[Array], ambient_pressure: float
) -> tuple[list[OperatingPoint], list[Array], list[str]]:
    """
    Fit each set-point separately; return the operating points, the simulated signals, and notes.

    A recording with several set-points is simulated for each set-point, and compared where that set-point acts.
    """
    channel, experiments = joint.likelihood.channel, joint.likelihood.experiments
    simulated = [values.copy() for values in joint.simulated]
    schedule, notes = [], []
    for low, high in _bands(np.concatenate(levels), ambient_pressure):
        applies = [(low <= level) & (level <= high) for level in levels]
        used = [index for index, mask in enumerate(applies) if np.any(mask & experiments[index].counts)]
        if not used:
            notes.append(f'set-point {low:.0f} Pa is not in the schedule: only the test part contains it')
            continue
        setpoint = float(np.mean(np.concatenate([levels[index][applies[index]] for index in used])))
        try:
            chosen = [replace(experiments[index], index=rank) for rank, index in enumerate(used)]
            chosen = [
                replace(experiment, chosen=experiment.counts & applies[index])
                for experiment, index in zip(chosen, used)
            ]
            fit = fit_model(channel, chosen)
        except InputError as error:
            notes.append(f'set-point {setpoint:.0f} Pa is not in the schedule: {error}')
            continue
        schedule.append(OperatingPoint(setpoint, fit))
        for rank, index in enumerate(used):
            simulated[index][applies[index]] = fit.simulated[rank][applies[index]]
    if not schedule:
        raise InputError('no set-point has enough data for a separate fit: identify without --per-setpoint')
    return schedule, simulated, notes


def _bands(levels: Array, ambient_pressure: float) -> list[tuple[float, float]]:
    """Return the lowest and highest level [Pa] of each group of adjacent set-points, ascending."""
    values = np.unique(levels)
    gaps = np.flatnonzero(np.diff(values) > LARGEST_SETPOINT_GAP * (values[:-1] + ambient_pressure)) + 1
    return [(float(group[0]), float(group[-1])) for group in np.split(values, gaps)]
