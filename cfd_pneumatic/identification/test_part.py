# SPDX-License-Identifier: Apache-2.0
"""Test whether the test part contradicts the model of the other parts, and state what the test part does not test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.identification.data import PARTS, Experiment, stroke_times
from cfd_pneumatic.identification.residual import SIGNIFICANCE
from cfd_pneumatic.identification.thresholds import FEWEST_TEST_STROKES, LARGEST_TEST_RATIO, LEAST_TEST_RISE

_TINY = float(np.finfo(np.float64).tiny)


def not_tested(experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Return clauses about what the test part does not test; empty without a test part."""
    tests = [experiment.part == PARTS.index('test') for experiment in experiments]
    if not any(map(np.any, tests)):
        return ()
    clauses = []
    if all('setpoint' in experiment.inputs for experiment in experiments):
        steps = [np.diff(experiment.at_samples('setpoint'), prepend=np.nan) != 0.0 for experiment in experiments]
        in_test = sum(int(np.count_nonzero(step[1:] & test[1:])) for step, test in zip(steps, tests))
        if not in_test and any(np.any(step[1:]) for step in steps):
            clauses.append('the test part has no set-point step: the response to set-points was not tested')
    strokes = sum(_strokes_of_test(experiment, test) for experiment, test in zip(experiments, tests))
    if strokes < FEWEST_TEST_STROKES:
        count = 'a single stroke' if strokes == 1 else 'no stroke'
        clauses.append(f'the test part has {count}: whether strokes repeat was not tested')
    return tuple(clauses)


def _strokes_of_test(experiment: Experiment, is_test: Mask) -> int:
    """Return the number of strokes that begin in the test part."""
    if not np.any(is_test):
        return 0
    begins = stroke_times(experiment.times, experiment.inputs['displacement'], experiment.motion.noise)[:-1]
    times = experiment.sample_times[is_test]
    tolerance = experiment.period  # a part begins at a turning point of the displacement
    return int(np.count_nonzero((begins >= times[0] - tolerance) & (begins <= times[-1])))


class _Strokes(NamedTuple):
    """Part, number of samples and sum of squared residuals of each stroke."""

    parts: NDArray[np.int8]
    counts: NDArray[np.intp]
    squares: Array


def contradiction(
    experiments: Sequence[Experiment], residuals: Sequence[Array], noise: float, outside: Sequence[Mask] | None = None
) -> list[str]:
    """
    Return a clause about how the test part contradicts a model; empty without a contradiction or a test part.

    The test part contradicts the model if its RMSE is above the noise and clearly above the RMSE of the train part: by
    half, or by more than the scatter from stroke to stroke allows, whichever is less. The package
    `changes` tests whether the device changed.

    Parameters
    ----------
    experiments
        Experiments of a channel.
    residuals
        Measured minus simulated at the samples of each experiment, shape (m,) [Pa or N].
    noise
        Standard deviation of the noise [Pa or N].
    outside
        Samples that the model was not estimated for, and that do not count, shape (m,); by default none.

    """
    counted = [np.ones(experiment.part.size) for experiment in experiments]
    if outside is not None:
        counted = [(~mask).astype(np.float64) for mask in outside]
    recordings = [_strokes(*recorded) for recorded in zip(experiments, residuals, counted)]
    together = _Strokes(*map(np.concatenate, zip(*recordings)))
    train, test = (_strokes_in(together, part) for part in ('train', 'test'))
    if not train.counts.size or not test.counts.size:
        return []
    error = _rmse(test)
    if error <= noise or (error <= LARGEST_TEST_RATIO * _rmse(train) and not _is_test_worse(train, test)):
        return []
    worst = int(np.argmax([_rmse(_strokes_in(strokes, 'test')) for strokes in recordings]))
    where = f'in {experiments[worst].recording} ' if len(experiments) > 1 else ''
    factor = error / max(_rmse(train), _TINY)
    return [f'{where}the error of the test part is {factor:.2g} times that of the train part']


def _strokes(experiment: Experiment, residual: Array, counted: Array) -> _Strokes:
    """Return the residuals by stroke; the first and the last stroke include the samples at rest before and after."""
    times, part = experiment.sample_times, experiment.part
    begins = stroke_times(experiment.times, experiment.inputs['displacement'], 0.0)[1:-1]
    first = np.unique(np.concatenate([[0], np.searchsorted(times, begins), np.flatnonzero(np.diff(part)) + 1]))
    first = first[first < times.size].astype(np.intp)
    counts, squares = (np.add.reduceat(values, first) for values in (counted, counted * residual**2))
    has_samples = counts > 0
    return _Strokes(part[first][has_samples], counts[has_samples].astype(np.intp), squares[has_samples])


def _strokes_in(strokes: _Strokes, part: str) -> _Strokes:
    is_inside = strokes.parts == PARTS.index(part)
    return _Strokes(*(column[is_inside] for column in strokes))


def _rmse(strokes: _Strokes) -> float:
    return math.sqrt(float(strokes.squares.sum()) / max(int(strokes.counts.sum()), 1))


def _is_test_worse(train: _Strokes, test: _Strokes) -> bool:
    """Return whether the errors of the test strokes exceed the scatter of the train strokes, by Student's t."""
    strokes = train.counts.size
    if strokes < 2:
        return False
    logs, test_logs = (np.log(np.maximum(part.squares / part.counts, _TINY)) for part in (train, test))
    shares, test_shares = (part.counts / part.counts.sum() for part in (train, test))
    excess = float(test_shares @ test_logs) - float(shares @ logs)
    scatter = float(np.average((logs - shares @ logs) ** 2, weights=train.counts)) * strokes / (strokes - 1)
    allowed = float(stdtrit(strokes - 1, 1.0 - SIGNIFICANCE)) * math.sqrt(
        scatter * (float(shares @ shares) + float(test_shares @ test_shares))
    )
    return excess > max(allowed, 2.0 * math.log(LEAST_TEST_RISE))
