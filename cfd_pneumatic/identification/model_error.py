# SPDX-License-Identifier: Apache-2.0
"""Estimate by how much a model errs beyond the sensor's noise: at rest, in motion, and after steps of a set-point."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array, Indices, Mask
from cfd_pneumatic.identification.channels import Channel
from cfd_pneumatic.identification.data import Experiment
from cfd_pneumatic.identification.residual import variance_of_mean
from cfd_pneumatic.identification.result import ChannelResult
from cfd_pneumatic.identification.thresholds import LEAST_SHARE_BETWEEN_STEPS, SMOOTHING_TIME, STEP_SETTLING_TIME

_SETPOINTS = ('setpoint', 'level')  # inputs of a pressure and of the force


@dataclass(frozen=True)
class ModelError:
    """
    Root mean square of a model's error beyond the sensor's noise.

    Attributes
    ----------
    rest
        While piston and set-point rest [Pa or N]; None without such samples.
    motion
        While the piston moves, or a pressure settles afterwards [Pa or N]; None without such samples.
    per_step
        Shortly after a step of the set-point, relative to the step [-]; None without steps, and for the force.

    """

    rest: float | None
    motion: float | None
    per_step: float | None = None


def error_beyond_noise(result: ChannelResult) -> ModelError:
    """
    Return the error of the model of the parameter file on the part on which the report judges it.

    A moving mean over `SMOOTHING_TIME` removes most of the noise from the residual. The noise that remains after the
    mean is subtracted in squares. Samples shortly after a step of a set-point do not count.
    """
    which = int(bool(result.added))
    squares: dict[bool, list[Array]] = {True: [], False: []}
    for comparison, counts in zip(result.comparisons, _counted(result)):
        experiment, residual = comparison.experiment, comparison.residual(which)
        is_rest = _is_rest(result.channel, experiment)
        for samples, excess in _squares_beyond_noise(result, experiment, residual, counts):
            for rest in (True, False):
                squares[rest].append(excess[is_rest[samples] == rest])
    return ModelError(_root_of_mean(squares[True]), _root_of_mean(squares[False]), _error_per_step(result, which))


def _error_per_step(result: ChannelResult, which: int) -> float | None:
    """
    Return the error shortly after the steps of a cylinder's set-point, relative to the steps; None without steps.

    All parts of the recordings count, because a test part may have no steps.
    """
    errors, steps = [], []
    for comparison in result.comparisons:
        experiment, residual = comparison.experiment, comparison.residual(which)
        if _SETPOINTS[0] not in experiment.inputs:
            return None
        times, levels = experiment.sample_times, experiment.inputs[_SETPOINTS[0]]
        changes = np.flatnonzero(np.diff(levels))
        if not changes.size:
            continue
        last = np.searchsorted(experiment.times[changes], times) - 1
        follows = (last >= 0) & (times - experiment.times[changes][last] <= STEP_SETTLING_TIME)
        sizes = np.diff(levels)[changes][last]
        for samples, excess in _squares_beyond_noise(result, experiment, residual, follows & experiment.settled):
            errors.append(excess)
            steps.append(sizes[samples] ** 2)
    error, step = _root_of_mean(errors), _root_of_mean(steps)
    return None if error is None or not step else error / step


def _squares_beyond_noise(
    result: ChannelResult, experiment: Experiment, residual: Array, counts: Mask
) -> Iterator[tuple[Indices, Array]]:
    """
    Yield the samples and the squares of the smoothed residual, minus the noise that remains in them.

    A run of samples that count gives a square for each whole moving mean over `SMOOTHING_TIME`.
    """
    count = max(round(SMOOTHING_TIME / experiment.period), 1)
    remaining_noise = result.noise.std**2 * variance_of_mean(result.noise.coefficients, count)
    for run in _runs(counts):
        if run.stop - run.start >= count:
            mean = np.convolve(residual[run], np.full(count, 1.0 / count), 'valid')
            yield run.start + count // 2 + np.arange(mean.size), mean**2 - remaining_noise


def _counted(result: ChannelResult) -> list[Mask]:
    """Return the samples of each recording that count, shape (m,)."""
    experiments = result.experiments
    judged = [
        result.judged(comparison) & experiment.settled
        for comparison, experiment in zip(result.comparisons, experiments)
    ]
    between_steps = [mask & ~_follows_step(experiment) for mask, experiment in zip(judged, experiments)]
    share = sum(map(np.count_nonzero, between_steps)) / max(sum(map(np.count_nonzero, judged)), 1)
    return between_steps if share >= LEAST_SHARE_BETWEEN_STEPS else judged


def _follows_step(experiment: Experiment) -> Mask:
    """Return whether each sample is shortly after a step of a set-point, shape (m,)."""
    times = experiment.sample_times
    follows = np.zeros(times.size, np.bool_)
    for name in _SETPOINTS:
        if name in experiment.inputs:
            steps = np.append(-np.inf, experiment.times[np.flatnonzero(np.diff(experiment.inputs[name]))])
            last_step = steps[np.searchsorted(steps, times) - 1]
            follows |= times - last_step <= STEP_SETTLING_TIME
    return follows


def _is_rest(channel: Channel, experiment: Experiment) -> Mask:
    """Return whether piston and set-point rest at each sample, shape (m,)."""
    is_rest = np.zeros(experiment.measured.size, np.bool_)
    for indices in channel.rests(experiment, np.arange(is_rest.size, dtype=np.float64)):
        is_rest[indices.astype(np.intp)] = True
    return is_rest


def _runs(mask: Mask) -> Iterator[slice]:
    """Yield the runs of adjacent samples in a mask."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    for begin, end in zip(edges[::2], edges[1::2]):
        yield slice(begin, end)


def _root_of_mean(squares: Sequence[Array]) -> float | None:
    """Return the root of the mean of squares, 0 if the mean is negative, None if there are no squares."""
    values = np.concatenate(squares) if squares else np.empty(0)
    return math.sqrt(max(float(np.mean(values)), 0.0)) if values.size else None
