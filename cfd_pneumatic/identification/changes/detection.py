# SPDX-License-Identifier: Apache-2.0
"""
Test whether the device changed during a recording, and estimate when.

The test compares three explanations of the error of a single model:

1. the device changed: the samples before and after a time have separate gains and offsets;
2. the model has an error: samples of a low and a high excitation have separate gains and offsets;
3. the sensor or the set-point drifts slowly: this drift is part of every explanation.

The device changed if the first explanation is clearly better than the others. So few set-point steps, a wider range of
motion or a slow drift are no change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.changes.excitation import groups_by_excitation
from cfd_pneumatic.identification.changes.part_fits import Grouping, PartFits
from cfd_pneumatic.identification.changes.thresholds import (
    DEGREES_OF_INNOVATIONS,
    EVENT_POINTS,
    FIRST_CUTS,
    INTERVAL_MARGIN,
    LARGEST_COST_RISE,
    LEAST_DROP,
    LEAST_EVENT_SHARE,
    LEAST_RMS_OVER_NOISE,
    LEAST_SIDE,
    LEAST_VARIANCE,
    MOST_CUT_REVISIONS,
    NORMAL_PER_MEDIAN,
    UNKNOWNS_OF_PART,
)
from cfd_pneumatic.identification.channels import Channel, Model
from cfd_pneumatic.identification.data import Experiment, stroke_times
from cfd_pneumatic.identification.residual import autoregression, sample_noise, whitened


class Cut(NamedTuple):
    """
    Time at which a device changed.

    Attributes
    ----------
    time, low, high
        Estimate and its 95 % interval [s].
    drop
        Fall of the mean logarithm of the squared error, compared with the best explanation without a change [1].

    """

    time: float
    low: float
    high: float
    drop: float


def find_cut(channel: Channel, experiment: Experiment) -> Cut | None:
    """Return when the device changed in a recording of a channel; None if it did not change noticeably."""
    strokes = stroke_times(experiment.times, experiment.inputs['displacement'], experiment.motion.noise).size - 1
    steps = np.count_nonzero(np.diff(experiment.inputs['setpoint']))
    if experiment.drifts or strokes < UNKNOWNS_OF_PART:
        return None  # steps of a set-point that was not recorded look like a change
    least_drop = LEAST_DROP + UNKNOWNS_OF_PART / (strokes + steps)
    fits = PartFits(channel, experiment)
    noise = sample_noise(experiment.sample_times, experiment.measured)
    if fits.joint.stds[0] < LEAST_RMS_OVER_NOISE * noise:
        return None
    joint = fits.joint.models
    time, parts = min((search_time(fits, share, joint) for share in FIRST_CUTS), key=lambda found: found[1].cost)
    if fits.joint.cost - parts.cost < least_drop:
        return None
    time, parts = search_time(fits, float(np.mean(fits.times < time)))
    drop = fits.joint.cost - parts.cost
    for groups in groups_by_excitation(fits.experiments, fits.counts):
        if drop < least_drop:
            return None
        drop = min(drop, fits.grouped(groups).cost - parts.cost)
    return Cut(*_refine(fits, time, parts), drop) if drop >= least_drop else None


def cut_of_curve(times: Array, values: Array) -> Cut | None:
    """
    Return the change at which most of a curve of the time varies at once; None if the curve varies slowly.

    A search finds such a curve if the error of the model hides the change from `find_cut`.

    Parameters
    ----------
    times, values
        Points of the curve, each of shape (n,) [s] and [unit of the curve].

    """
    variations = np.abs(values[EVENT_POINTS:] - values[:-EVENT_POINTS])
    largest = int(np.argmax(variations))
    share = float(variations[largest]) / max(float(np.ptp(values)), LEAST_VARIANCE)
    if share < LEAST_EVENT_SHARE:
        return None
    low, high = float(times[largest]), float(times[largest + EVENT_POINTS])
    return Cut(0.5 * (low + high), low, high, share)


def search_time(fits: PartFits, share: float, starts: Sequence[Model] = ()) -> tuple[float, Grouping]:
    """
    Return the time of a change and the models before and after, searched from a share of the recording.

    The fits begin at some starts, see `PartFits.fit`.
    """
    index = int(share * fits.times.size)
    best: tuple[float, Grouping] | None = None
    for _ in range(MOST_CUT_REVISIONS):
        time = float(fits.times[index])
        parts = fits.grouped((fits.times >= time).astype(np.intp), starts)
        if best is None or parts.cost < best[1].cost:
            best = time, parts
        squares = [np.where(fits.counts, fits.residual(model) ** 2, 0.0) for model in parts.models]
        revised = int(np.argmin(_costs(squares[0], squares[1], fits.counts.astype(np.float64))))
        if fits.times[revised] == time:
            break
        index = revised
    assert best is not None
    return best


def _refine(fits: PartFits, time: float, parts: Grouping) -> tuple[float, float, float]:
    """
    Return the likeliest time of a change and its 95 % interval [s], from the innovations of both models.

    The innovations have Student's distribution: they are large after steps of the set-point, where a model errs most.
    """
    times = fits.whole.sample_times
    residuals = [fits.whole_residual(model) for model in parts.models]
    is_before = times < time
    sides = [residual[mask] for residual, mask in zip(residuals, (is_before, ~is_before))]
    coefficients = autoregression(sides)
    scale = NORMAL_PER_MEDIAN * float(
        np.median(np.abs(np.concatenate([whitened(side, coefficients) for side in sides])))
    )
    before, after = (
        0.5
        * (DEGREES_OF_INNOVATIONS + 1.0)
        * np.log1p((whitened(run, coefficients) / scale) ** 2 / DEGREES_OF_INNOVATIONS)
        for run in residuals
    )
    costs = np.cumsum(before - after) - (before - after)
    inner = slice(*_inner(times.size))
    best = int(np.argmin(costs[inner])) + inner.start
    inside = np.flatnonzero(costs[inner] - costs[best] <= LARGEST_COST_RISE) + inner.start
    return float(times[best]), float(times[inside[0]]) - INTERVAL_MARGIN, float(times[inside[-1]]) + INTERVAL_MARGIN


def _inner(size: int) -> tuple[int, int]:
    """Return the first index of a change that may be found, and the end of these indices."""
    return int(LEAST_SIDE * size) + 1, int((1.0 - LEAST_SIDE) * size)


def _costs(before: Array, after: Array, counts: Array) -> Array:
    """
    Return the cost of a change just before each sample, shape (n,); infinite near the ends.

    The cost is the mean logarithm of the squared error of a sample's side.
    """
    size = counts.size
    number_before = np.cumsum(counts) - counts
    number_after = counts.sum() - number_before
    squares_before = np.cumsum(before) - before
    squares_after = np.cumsum(after[::-1])[::-1]
    costs = np.full(size, np.inf)
    inner: NDArray[np.intp] = np.arange(*_inner(size))
    for number, total in ((number_before, squares_before), (number_after, squares_after)):
        variance = np.maximum(total[inner] / np.maximum(number[inner], 1.0), LEAST_VARIANCE)
        share = number[inner] / counts.sum() * np.log(variance)
        costs[inner] = share if number is number_before else costs[inner] + share
    return costs
