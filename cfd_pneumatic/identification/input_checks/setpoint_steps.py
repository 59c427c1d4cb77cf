# SPDX-License-Identifier: Apache-2.0
"""Detect steps of a set-point that was not recorded: the residual of the pressure is then a staircase."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Channel
from cfd_pneumatic.identification.data import Experiment
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.input_checks.thresholds import (
    FEWEST_LEVEL_SAMPLES,
    LEAST_EXPLAINED_SHARE,
    LEAST_SETPOINT_STEP,
    LEAST_STEEP_SHARE,
    LEAST_STEP_SHARE,
    LEVEL_PARTS,
    MOST_REPORTED_STEPS,
    MOST_SETPOINT_STEPS,
)
from cfd_pneumatic.identification.residual import sample_noise
from cfd_pneumatic.notices import Notice, warning
from cfd_pneumatic.recording import Recording


def steps_of_fit(fit: Fit, recordings: Sequence[Recording]) -> Iterator[Notice]:
    """Warn if the residual of a cylinder's fit is a staircase and no set-point was recorded."""
    channel, experiments = fit.likelihood.channel, fit.likelihood.experiments
    noise = fit.likelihood.noise(fit.model).std
    if fit.spans_pressures:
        return  # the residual contains strokes, which look like steps
    levels = channel.levels(experiments, fit.model)
    unrecorded = _without_setpoint(channel, experiments, recordings)
    for experiment, simulated, level in zip(unrecorded, fit.simulated, levels):
        if experiment is not None:
            residual = experiment.measured - simulated + level - level[0]
            yield from _check_steps(channel, experiment, residual, float(level[0]), noise)


def steps_of_pressure(
    channel: Channel, experiments: Sequence[Experiment], recordings: Sequence[Recording], ambient_pressure: float
) -> Iterator[Notice]:
    """Warn if a pressure that does not follow the piston is a staircase and no set-point was recorded."""
    for experiment in _without_setpoint(channel, experiments, recordings):
        if experiment is not None:
            noise = sample_noise(experiment.sample_times, experiment.measured)
            yield from _check_steps(channel, experiment, experiment.measured - ambient_pressure, 0.0, noise)


def with_steps(recording: Recording, experiment: Experiment, simulated: Array, channel: Channel) -> Experiment:
    """Return an experiment with the residual's steps added to its set-point, unless the set-point was recorded."""
    if recording.cylinders[channel.name].setpoint is not None:
        return experiment
    begins, levels = _fit_staircase(experiment.measured - simulated)
    index = np.searchsorted(experiment.samples[begins], np.arange(experiment.times.size), side='right') - 1
    setpoint = experiment.inputs['setpoint'] + levels[np.maximum(index, 0)]
    return replace(experiment, inputs={**experiment.inputs, 'setpoint': setpoint})


def _without_setpoint(
    channel: Channel, experiments: Sequence[Experiment], recordings: Sequence[Recording]
) -> Iterator[Experiment | None]:
    """Yield each experiment without a recorded set-point of the cylinder, and None for the others."""
    recordings = [recording for recording in recordings if channel.signal(recording) is not None]
    for recording, experiment in zip(recordings, experiments):
        yield experiment if recording.cylinders[channel.name].setpoint is None else None


def _check_steps(
    channel: Channel, experiment: Experiment, residual: Array, level: float, noise: float
) -> Iterator[Notice]:
    """Warn if a residual is a staircase, with the times and levels of the steps; `level` is the gauge level [Pa]."""
    begins, levels = _fit_staircase(residual)
    pieces = np.split(residual, begins[1:])
    unexplained = sum(float(np.var(piece)) * piece.size for piece in pieces)
    most = (1.0 - LEAST_EXPLAINED_SHARE) * float(np.var(residual)) * residual.size
    if unexplained > most or np.ptp(levels) < LEAST_SETPOINT_STEP * noise:
        return
    if _steep_height(pieces) < LEAST_STEEP_SHARE * float(np.sum(np.abs(np.diff(levels)))):
        return  # a drift or an oscillation is an effect
    first, *later = (f'{1e-3 * value:.3g} kPa' for value in levels + level)
    steps = [f'{text} from {experiment.sample_times[begin]:.2f} s on' for text, begin in zip(later, begins[1:])]
    more = ', and so on' if len(steps) > MOST_REPORTED_STEPS else ''
    yield warning(
        'setpoint_assumed',
        f'{channel.name}: the set-point of {experiment.recording} was not recorded, and it steps: about {first} above '
        f'ambient, {", ".join(steps[:MOST_REPORTED_STEPS])}{more}',
        'record the set-point. Otherwise cut the recording at the steps, without half a second on either side, and '
        'give all pieces: each piece gets its set-point',
    )


def _steep_height(pieces: Sequence[Array]) -> float:
    """Return the total height of the steps, from the samples next to each step."""
    total = 0.0
    for before, behind in pairwise(pieces):
        last, first = (max(FEWEST_LEVEL_SAMPLES, piece.size // LEVEL_PARTS) for piece in (before, behind))
        total += abs(float(np.mean(behind[:first]) - np.mean(before[-last:])))
    return total


def _fit_staircase(values: Array) -> tuple[list[int], Array]:
    """Return the first index of each level, and the levels; steps are added while they explain enough."""
    begins = [0, values.size]
    for _ in range(MOST_SETPOINT_STEPS):
        gains = [_best_cut(values[first:last]) for first, last in pairwise(begins)]
        index = int(np.argmax([gain for gain, _ in gains]))
        if gains[index][0] <= LEAST_STEP_SHARE * float(np.sum((values - np.mean(values)) ** 2)):
            break
        begins = sorted([*begins, begins[index] + gains[index][1]])
    return begins[:-1], np.array([np.mean(values[first:last]) for first, last in pairwise(begins)])


def _best_cut(values: Array) -> tuple[float, int]:
    """Return the largest reduction of the sum of squares by a step, and the index of that step."""
    if values.size < 2 * FEWEST_LEVEL_SAMPLES:
        return 0.0, 0
    sums = np.cumsum(values - np.mean(values))[FEWEST_LEVEL_SAMPLES - 1 : -FEWEST_LEVEL_SAMPLES]
    before = np.arange(FEWEST_LEVEL_SAMPLES, values.size - FEWEST_LEVEL_SAMPLES + 1)[: sums.size]
    gains = sums**2 * values.size / (before * (values.size - before))
    best = int(np.argmax(gains))
    return float(gains[best]), int(before[best])
