# SPDX-License-Identifier: Apache-2.0
"""Test whether the test part contradicts the model of the train and validation parts; the last step of a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data import PARTS, Experiment, stroke_times
from cfd_pneumatic.identification.residual import SIGNIFICANCE
from cfd_pneumatic.identification.thresholds import LARGEST_TEST_RATIO, LEAST_TEST_RISE

_TINY = float(np.finfo(np.float64).tiny)


class _Strokes(NamedTuple):
    """Part, number of samples and sum of squared residuals of each stroke."""

    parts: NDArray[np.int8]
    counts: NDArray[np.intp]
    squares: Array


def contradiction(experiments: Sequence[Experiment], residuals: Sequence[Array], noise: float) -> list[str]:
    """
    Return a clause about how the test part contradicts a model; empty without a contradiction or a test part.

    The test part contradicts the model if its RMSE is above the noise and clearly above the RMSE of the train part: by
    half, or by more than the scatter from stroke to stroke allows, whichever is less. The contradiction does not say
    why: `changes` tests whether the device changed.

    Parameters
    ----------
    experiments
        Experiments of a channel.
    residuals
        Measured minus simulated at the samples of each experiment, shape (m,) [Pa or N].
    noise
        Standard deviation of the noise [Pa or N].

    """
    recordings = [_strokes(experiment, residual) for experiment, residual in zip(experiments, residuals)]
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


def _strokes(experiment: Experiment, residual: Array) -> _Strokes:
    """Return the residuals by stroke; the first and the last stroke include the samples at rest before and after."""
    times, part = experiment.sample_times, experiment.part
    begins = stroke_times(experiment.times, experiment.inputs['displacement'], 0.0)[1:-1]
    first = np.unique(np.concatenate([[0], np.searchsorted(times, begins), np.flatnonzero(np.diff(part)) + 1]))
    first = first[first < times.size].astype(np.intp)
    return _Strokes(part[first], np.diff(first, append=times.size), np.add.reduceat(residual**2, first))


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
