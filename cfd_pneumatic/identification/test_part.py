# SPDX-License-Identifier: Apache-2.0
"""The one look at the test part, when all else is done: whether it contradicts what train and validation have shown."""

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
    """When strokes begin [s], in which part, of how many samples, and the sums of their squared residuals."""

    begins: Array
    parts: NDArray[np.int8]
    counts: NDArray[np.intp]
    squares: Array


def contradiction(experiments: Sequence[Experiment], residuals: Sequence[Array], noise: float) -> list[str]:
    """
    Return how the test part contradicts a model, a clause; empty where it doesn't, or there is no such part.

    It does where its RMSE is above the noise, and exceeds that of the train part by half or by more than the scatter
    from stroke to stroke allows, whichever is less.

    Parameters
    ----------
    experiments
        What was measured.
    residuals
        Measured less simulated at the samples of each, shape (m,) [Pa or N].
    noise
        Its standard deviation [Pa or N].

    """
    each = [_strokes(experiment, residual) for experiment, residual in zip(experiments, residuals)]
    together = _Strokes(*map(np.concatenate, zip(*each)))
    train, test = (_within(together, part) for part in ('train', 'test'))
    if not train.counts.size or not test.counts.size:
        return []
    error = _rmse(test)
    if error <= noise or (error <= LARGEST_TEST_RATIO * _rmse(train) and not _differ(train, test)):
        return []
    worst = int(np.argmax([_rmse(_within(one, 'test')) for one in each]))
    where = f'in {experiments[worst].recording} ' if len(experiments) > 1 else ''
    if not _within(each[worst], 'validation').counts.size:  # the whole recording was set aside
        factor = _rmse(test) / max(_rmse(train), _TINY)
        return [f'{where}the error is {factor:.2g} times that of the train part: the device or its work is another']
    begin, factor = _rise(each[worst])
    return [
        f'{where}from t = {begin:.4g} s on the error is {factor:.2g} times what it was: the device or its work changed'
    ]


def _strokes(experiment: Experiment, residual: Array) -> _Strokes:
    """Return the residuals by stroke; what rests before the first belongs to it, and after the last to that."""
    times, part = experiment.sample_times, experiment.part
    begins = stroke_times(experiment.times, experiment.inputs['displacement'], 0.0)[1:-1]
    first = np.unique(np.concatenate([[0], np.searchsorted(times, begins), np.flatnonzero(np.diff(part)) + 1]))
    first = first[first < times.size].astype(np.intp)
    return _Strokes(times[first], part[first], np.diff(first, append=times.size), np.add.reduceat(residual**2, first))


def _within(strokes: _Strokes, part: str) -> _Strokes:
    held = strokes.parts == PARTS.index(part)
    return _Strokes(*(column[held] for column in strokes))


def _rmse(strokes: _Strokes) -> float:
    return math.sqrt(float(strokes.squares.sum()) / max(int(strokes.counts.sum()), 1))


def _differ(train: _Strokes, test: _Strokes) -> bool:
    """Return whether the strokes of the test part err by more than those of the train part scatter: Student's t."""
    strokes = train.counts.size
    if strokes < 2:
        return False
    logs, others = (np.log(np.maximum(one.squares / one.counts, _TINY)) for one in (train, test))
    shares, other_shares = (one.counts / one.counts.sum() for one in (train, test))
    excess = float(other_shares @ others) - float(shares @ logs)
    scatter = float(np.average((logs - shares @ logs) ** 2, weights=train.counts)) * strokes / (strokes - 1)
    allowed = float(stdtrit(strokes - 1, 1.0 - SIGNIFICANCE)) * math.sqrt(
        scatter * (float(shares @ shares) + float(other_shares @ other_shares))
    )
    return excess > max(allowed, 2.0 * math.log(LEAST_TEST_RISE))


def _rise(strokes: _Strokes) -> tuple[float, float]:
    """Return since when the error is larger [s], and by which factor: the likeliest cut, of normal residuals."""
    counts, squares = (np.cumsum(column) for column in (strokes.counts, strokes.squares))
    before = np.maximum(squares[:-1] / counts[:-1], _TINY)
    after = np.maximum((squares[-1] - squares[:-1]) / (counts[-1] - counts[:-1]), _TINY)
    misfit = counts[:-1] * np.log(before) + (counts[-1] - counts[:-1]) * np.log(after)
    cut = int(np.argmin(np.where(after > before, misfit, np.inf)))
    return float(strokes.begins[cut + 1]), math.sqrt(after[cut] / before[cut])
