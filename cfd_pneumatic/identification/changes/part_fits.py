# SPDX-License-Identifier: Apache-2.0
"""Fit the linear model separately to groups of samples, and compare the errors of groupings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.identification.changes.thresholds import (
    COMPARED_STARTS_SEARCH,
    DRIFT_ROUNDS,
    EXCERPT_STEPS,
    LARGEST_DRIFT_DEGREE,
    LEAST_VARIANCE,
    MOST_COMPARED_STEPS,
    PART_SEARCH,
    SETTLING_TIME,
    SHORTEST_DRIFT,
)
from cfd_pneumatic.identification.channels import Channel, Model
from cfd_pneumatic.identification.data import Experiment
from cfd_pneumatic.identification.fit import Likelihood, find_optimum
from cfd_pneumatic.runtime import map_in_threads


class Grouping(NamedTuple):
    """
    Separate models of groups of samples.

    Attributes
    ----------
    cost
        Mean logarithm of the squared error of a sample's group [1].
    models
        Model of each group.
    stds
        Root mean square of each group's residual [Pa].

    """

    cost: float
    models: tuple[Model, ...]
    stds: tuple[float, ...]


class PartFits:
    """
    Fits of a channel's linear model to groups of a recording's samples.

    A slow drift, a polynomial of the time, is part of every model. So no drift makes a grouping better.

    Parameters
    ----------
    channel, experiment
        Channel, and the recording.
    degree
        Degree of the polynomial; by default as its duration allows.

    Attributes
    ----------
    times
        Times of the samples, shape (n,) [s].
    counts
        Whether the samples count, shape (n,).
    experiments
        The recording, or stretches of a long recording, without drift.
    whole
        The recording without drift.
    joint
        A single model of all samples.

    """

    def __init__(self, channel: Channel, experiment: Experiment, degree: int | None = None) -> None:
        self._channel = channel
        late = experiment.sample_times >= experiment.begin + SETTLING_TIME
        whole = replace(experiment, index=0, chosen=late)
        self.likelihood = Likelihood.alike(channel, [whole]).spread(MOST_COMPARED_STEPS)
        self.experiments = self.likelihood.experiments
        self.times = np.concatenate([stretch.sample_times for stretch in self.experiments])
        self.counts = np.concatenate([stretch.counts for stretch in self.experiments])
        self._starts = [*channel.starts([whole])]
        begin, end = experiment.begin, float(experiment.times[-1])
        largest = min(max(int((end - begin) / SHORTEST_DRIFT), 1), LARGEST_DRIFT_DEGREE)
        self._begin, self._end, self._degree = begin, end, largest if degree is None else min(degree, largest)
        self._drifts = self._polynomials(self.times)
        self._coefficients = np.zeros(self._degree + 1)
        self.whole = replace(experiment, index=0, chosen=None)
        self._single: tuple[Model, ...] = ()
        for _ in range(DRIFT_ROUNDS):
            self._remove_drift()
        self.joint = self.grouped(np.zeros(self.times.size, np.intp))
        self._single = self.joint.models

    @property
    def has_bent_drift(self) -> bool:
        """Whether the drift may be more than a straight line of the time."""
        return self._degree > 1

    def drift(self, times: Array) -> Array:
        """Return the drift of the single model at times, zero on average, shape (n,) [Pa]."""
        within = np.clip(times, self._begin, self._end)
        return np.asarray(self._polynomials(within) @ self._coefficients)

    def _polynomials(self, times: Array) -> Array:
        """Return polynomials of the time over the recording, shape (n, degree + 1)."""
        place = 2.0 * (times - self._begin) / (self._end - self._begin) - 1.0
        return np.asarray(np.polynomial.legendre.legvander(place, self._degree))

    def _remove_drift(self) -> None:
        """Remove the drift of the joint model's residual from the measured signal."""
        residual = self.residual(self.fit(self.counts))
        coefficients = np.linalg.lstsq(self._drifts[self.counts], residual[self.counts], rcond=None)[0]
        coefficients[0] = 0.0  # the offset of the models
        self._coefficients += coefficients

        def without_drift(stretch: Experiment) -> Experiment:
            drift = self._polynomials(stretch.sample_times) @ coefficients
            return replace(stretch, measured=stretch.measured - drift)

        self.whole = without_drift(self.whole)
        self.experiments = tuple(map(without_drift, self.experiments))
        self.likelihood = replace(self.likelihood, experiments=self.experiments)

    def fit(self, mask: Mask, starts: Sequence[Model] = ()) -> Model:
        """
        Return the model that fits the samples of a mask best.

        The fits begin at some starts, by default at those of the channel and at the single model.
        """
        ends = np.cumsum([stretch.part.size for stretch in self.experiments])[:-1]
        chosen = np.split(mask & self.counts, ends)
        experiments = tuple(replace(stretch, chosen=part) for stretch, part in zip(self.experiments, chosen))
        likelihood = replace(self.likelihood, experiments=experiments)
        if not starts:
            excerpt = likelihood.excerpt(EXCERPT_STEPS)
            rough = [find_optimum(excerpt, start, *COMPARED_STARTS_SEARCH, passing=False) for start in self._starts]
            starts = [min(rough, key=lambda optimum: optimum.cost).model, *self._single]
        return min((find_optimum(likelihood, start, *PART_SEARCH) for start in starts), key=lambda fit: fit.cost).model

    def residual(self, model: Model) -> Array:
        """Return measured minus simulated at all samples, shape (n,) [Pa]."""
        simulated = self._channel.simulated(self.experiments, model)
        return np.concatenate([stretch.measured - values for stretch, values in zip(self.experiments, simulated)])

    def whole_residual(self, model: Model) -> Array:
        """Return measured minus simulated at every sample of the recording, shape (m,) [Pa]."""
        (simulated,) = self._channel.simulated([self.whole], model)
        return self.whole.measured - simulated

    def grouped(self, groups: NDArray[np.intp], starts: Sequence[Model] = ()) -> Grouping:
        """Fit a model to each group, from 0 on, and return the cost of all together."""
        numbers = range(int(groups.max()) + 1)
        models = map_in_threads(partial(self._fit_group, groups, starts), numbers)
        residual = np.zeros(self.times.size)
        for number, model in zip(numbers, models):
            residual[groups == number] = self.residual(model)[groups == number]
        drifts = self._drifts[self.counts]
        residual -= self._drifts @ np.linalg.lstsq(drifts, residual[self.counts], rcond=None)[0]
        squares = [float(np.mean(residual[self.counts & (groups == number)] ** 2)) for number in numbers]
        shares = [
            np.count_nonzero(self.counts & (groups == number)) / np.count_nonzero(self.counts) for number in numbers
        ]
        cost = sum(share * math.log(max(square, LEAST_VARIANCE)) for share, square in zip(shares, squares))
        return Grouping(cost, tuple(models), tuple(math.sqrt(square) for square in squares))

    def _fit_group(self, groups: NDArray[np.intp], starts: Sequence[Model], number: int) -> Model:
        return self.fit(groups == number, starts)
