# SPDX-License-Identifier: Apache-2.0
"""Whether a set-point that nobody recorded was stepped: what is left of the pressure, then, is a staircase."""

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
    """Ask whether what a cylinder's fit leaves is a staircase where no set-point was recorded."""
    channel, experiments = fit.likelihood.channel, fit.likelihood.experiments
    noise = fit.likelihood.noise(fit.model).std
    if fit.spans_pressures:
        return  # it leaves strokes, which look like steps
    levels = channel.levels(experiments, fit.model)
    for one, simulated, level in zip(_unrecorded(channel, experiments, recordings), fit.simulated, levels):
        if one is not None:
            yield from _steps(channel, one, one.measured - simulated + level - level[0], float(level[0]), noise)


def steps_of_pressure(
    channel: Channel, experiments: Sequence[Experiment], recordings: Sequence[Recording], ambient_pressure: float
) -> Iterator[Notice]:
    """Ask the same of a pressure that nothing could be fitted to, since it does not follow the piston."""
    for one in _unrecorded(channel, experiments, recordings):
        if one is not None:
            noise = sample_noise(one.sample_times, one.measured)
            yield from _steps(channel, one, one.measured - ambient_pressure, 0.0, noise)


def with_steps(recording: Recording, experiment: Experiment, simulated: Array, channel: Channel) -> Experiment:
    """Return an experiment whose set-point, where none was recorded, has the steps of what is left, too."""
    if recording.cylinders[channel.name].setpoint is not None:
        return experiment
    begins, levels = _staircase(experiment.measured - simulated)
    held = np.searchsorted(experiment.samples[begins], np.arange(experiment.times.size), side='right') - 1
    setpoint = experiment.inputs['setpoint'] + levels[np.maximum(held, 0)]
    return replace(experiment, inputs={**experiment.inputs, 'setpoint': setpoint})


def _unrecorded(
    channel: Channel, experiments: Sequence[Experiment], recordings: Sequence[Recording]
) -> Iterator[Experiment | None]:
    """Yield each experiment whose recording has no set-point of the cylinder, None for others."""
    held = [one for one in recordings if channel.signal(one) is not None]
    for recording, one in zip(held, experiments):
        yield one if recording.cylinders[channel.name].setpoint is None else None


def _steps(channel: Channel, experiment: Experiment, left: Array, level: float, noise: float) -> Iterator[Notice]:
    """Say when a set-point steps, and about where to, if what is left of the pressure beside a level does."""
    begins, levels = _staircase(left)
    pieces = np.split(left, begins[1:])
    within = sum(float(np.var(piece)) * piece.size for piece in pieces)
    most = (1.0 - LEAST_EXPLAINED_SHARE) * float(np.var(left)) * left.size
    if within > most or np.ptp(levels) < LEAST_SETPOINT_STEP * noise:
        return
    if _beside_steps(pieces) < LEAST_STEEP_SHARE * float(np.sum(np.abs(np.diff(levels)))):
        return  # it drifts or swings: that is an effect
    first, *later = (f'{1e-3 * value:.3g} kPa' for value in levels + level)
    steps = [f'{name} from {experiment.sample_times[at]:.2f} s on' for name, at in zip(later, begins[1:])]
    more = ', and so on' if len(steps) > MOST_REPORTED_STEPS else ''
    yield warning(
        'setpoint_assumed',
        f'{channel.name}: the set-point of {experiment.recording} was not recorded, and it steps: about {first} above '
        f'ambient, {", ".join(steps[:MOST_REPORTED_STEPS])}{more}',
        'record the set-point, or cut the recording where it steps, leave out half a second on either side, and give '
        'all pieces: a set-point is found for each',
    )


def _beside_steps(pieces: Sequence[Array]) -> float:
    """Return how far values step altogether, by what lies right before and behind the steps."""
    total = 0.0
    for before, behind in pairwise(pieces):
        last, first = (max(FEWEST_LEVEL_SAMPLES, piece.size // LEVEL_PARTS) for piece in (before, behind))
        total += abs(float(np.mean(behind[:first]) - np.mean(before[-last:])))
    return total


def _staircase(values: Array) -> tuple[list[int], Array]:
    """Return where levels begin, from the largest step on down, and the levels: a step has to explain a share."""
    begins = [0, values.size]
    for _ in range(MOST_SETPOINT_STEPS):
        gains = [_best_cut(values[first:last]) for first, last in pairwise(begins)]
        place = int(np.argmax([gain for gain, _ in gains]))
        if gains[place][0] <= LEAST_STEP_SHARE * float(np.sum((values - np.mean(values)) ** 2)):
            break
        begins = sorted([*begins, begins[place] + gains[place][1]])
    return begins[:-1], np.array([np.mean(values[first:last]) for first, last in pairwise(begins)])


def _best_cut(values: Array) -> tuple[float, int]:
    """Return by how much a step lowers the sum of squares at most, and where it is."""
    if values.size < 2 * FEWEST_LEVEL_SAMPLES:
        return 0.0, 0
    sums = np.cumsum(values - np.mean(values))[FEWEST_LEVEL_SAMPLES - 1 : -FEWEST_LEVEL_SAMPLES]
    before = np.arange(FEWEST_LEVEL_SAMPLES, values.size - FEWEST_LEVEL_SAMPLES + 1)[: sums.size]
    gains = sums**2 * values.size / (before * (values.size - before))
    best = int(np.argmax(gains))
    return float(gains[best]), int(before[best])
