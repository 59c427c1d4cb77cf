# SPDX-License-Identifier: Apache-2.0
"""
The likelihood of a channel's samples: what they weigh, how their residual is whitened, what a model has to gain.

Samples are normal, each with a standard deviation in proportion to that of its recording's residual and to what the
jitter of its stamp adds. Every fit, search and comparison of one channel asks one object of this kind, or one that is
cut from it. Whoever wants another likelihood changes this file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from cfd_pneumatic.arrays import Array, Indices, Mask
from cfd_pneumatic.identification.channels import Channel, Model, Unknown
from cfd_pneumatic.identification.data import PARTS, Experiment
from cfd_pneumatic.identification.fit.levenberg import Quadratic
from cfd_pneumatic.identification.fit.thresholds import (
    DIFFERENCE_STEP,
    FEWEST_EXCERPT_STEPS,
    FULL_EXCERPTS,
    LARGEST_LOG_STEP,
    LEAST_RMS,
    LEAST_SUM_OF_SQUARES,
    SHORT_STRETCH_LEAD,
    SHORT_STRETCHES,
    STRETCH_LEAD,
    STRETCH_SAMPLES,
    STRETCHES,
)
from cfd_pneumatic.identification.residual import Noise, Test, independent_share, residual_tests, whitened
from cfd_pneumatic.model import kernel


class Unknowns:
    """
    What is searched of a model, and how: in logarithms, or in units that make numbers about one.

    Parameters
    ----------
    channel, experiments, model
        Whose, and where the search begins.
    frozen
        Cores and effects whose parameters stay as they are.
    passing
        Whether what is forgotten soon is searched.

    """

    def __init__(
        self,
        channel: Channel,
        experiments: Sequence[Experiment],
        model: Model,
        frozen: Iterable[str] = (),
        passing: bool = True,
    ) -> None:
        unknowns = channel.unknowns(experiments, model)
        stay = [slot for name in frozen for slot in channel.slots_of(name)]
        self.table: list[Unknown] = [one for one in unknowns if one.slot not in stay and (passing or not one.passing)]
        self.count = len(unknowns)
        self.parts = tuple(model.parts)
        self.slots = np.array([one.slot for one in self.table], dtype=np.intp)
        self._channel = channel
        self._untold = model.untold
        self._row = channel.row(model)
        for name in channel.held(experiments, model):
            effect, _, parameter = name.partition('.')
            if effect in model.effects and parameter:
                names = [one.name for one in channel.effects[effect].parameters]
                rank = names.index(parameter)
                self._row[channel.slots_of(effect)[rank]] = channel.effects[effect].null[rank]
        self._logarithmic = np.array([one.logarithmic for one in self.table], dtype=np.bool_)
        self._units = np.array([1.0 if one.logarithmic else one.scale for one in self.table])
        self.lower, self.upper = (
            self._inward(np.array([getattr(one, side) for one in self.table])) for side in ('lower', 'upper')
        )
        self._expected = np.array([one.expected for one in self.table]) / self._units
        self.precision = (self._units / np.array([one.spread for one in self.table])) ** 2
        self._of = {one.index: self._concerning(channel.own_slots(one.index), channel.shared) for one in experiments}
        self.start = np.clip(self._inward(self._row[self.slots]), self.lower, self.upper)

    def _concerning(self, mine: range, shared: int) -> tuple[Indices, Indices]:
        own = np.flatnonzero((self.slots < shared) | np.isin(self.slots, mine))
        slots = self.slots[own]
        return own, np.where(slots < shared, slots, slots - mine.start + shared)

    def of(self, experiment: Experiment) -> tuple[Indices, Indices]:
        """Return which of them concern an experiment, and where these stand in its own row, each of shape (k,)."""
        return self._of[experiment.index]

    @property
    def longest_step(self) -> Array:
        """Farthest that a search may go at once: a factor of seven where it searches a logarithm, shape (k,)."""
        return np.where(self._logarithmic, LARGEST_LOG_STEP, np.inf)

    def away(self, point: Array) -> Array:
        """Return how far each is from what is expected of it, where something is, shape (k,)."""
        return np.where(self.precision > 0.0, point - self._expected, 0.0)

    def _inward(self, values: Array) -> Array:
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.where(self._logarithmic, np.log(np.maximum(values, 0.0)), values / self._units)

    def row(self, point: Array) -> Array:
        """Return all numbers of the model at a point."""
        row = self._row.copy()
        row[self.slots] = np.where(
            self._logarithmic, np.exp(np.where(self._logarithmic, point, 0.0)), point * self._units
        )
        return row

    def scales(self, point: Array) -> Array:
        """Return by how much each number moves with what is searched, shape (k,)."""
        return np.where(self._logarithmic, self.row(point)[self.slots], self._units)

    def model(self, point: Array) -> Model:
        """Return the model at a point."""
        return replace(self._channel.model(self.row(point), self.parts, self.count), untold=self._untold)


@dataclass(frozen=True)
class Likelihood:
    """
    The likelihood of some experiments of a channel.

    Attributes
    ----------
    channel
        What was measured.
    experiments
        In which recordings.
    weights
        Of each experiment's samples, shape (m,).

    """

    channel: Channel
    experiments: tuple[Experiment, ...]
    weights: tuple[Array, ...]
    _simulated: WeakKeyDictionary[Model, list[Array]] = field(default_factory=WeakKeyDictionary, init=False, repr=False)

    @classmethod
    def alike(cls, channel: Channel, experiments: Sequence[Experiment]) -> Likelihood:
        """Return one in which all samples weigh alike."""
        return cls(channel, tuple(experiments), tuple(np.ones(one.part.size) for one in experiments))

    def weighed(self, simulated: Sequence[Array]) -> Likelihood:
        """Return it with the weights that follow from a simulation and what that leaves; itself where it has them."""
        precisions = self.precisions(simulated)
        left = [
            (one.measured - values)[one.counts] * own[one.counts]
            for one, values, own in zip(self.experiments, simulated, precisions)
        ]
        rms = np.array([math.sqrt(float(run @ run) / run.size) if run.size else math.nan for run in left])
        scales = np.nan_to_num(np.nanmean(rms) / np.maximum(rms, LEAST_RMS), nan=1.0)
        weights = tuple(own * scale for own, scale in zip(precisions, scales.tolist()))
        return self if all(map(np.array_equal, weights, self.weights)) else replace(self, weights=weights)

    def precisions(self, simulated: Sequence[Array]) -> list[Array]:
        """Return what samples weigh within their recordings, in fits and in tests, each of shape (m,)."""
        return [self.channel.precision(*one) for one in zip(self.experiments, simulated)]

    def until(self, part: str) -> Likelihood:
        """Return what lies up to a part, of which only that part's and earlier samples count."""
        cut = [one.until(part) for one in self.experiments]
        weights = [weight[: one.part.size] for one, weight in zip(cut, self.weights)]
        return replace(self, experiments=tuple(cut), weights=tuple(weights))

    def excerpt(self, steps: int) -> Likelihood:
        """
        Return the liveliest part of each experiment; itself where none has more grid steps.

        Of many experiments each gives less, so that together they hardly take longer than a few.
        """
        steps = min(steps, max(FULL_EXCERPTS * steps // len(self.experiments), FEWEST_EXCERPT_STEPS))
        if max(one.times.size for one in self.experiments) <= steps:
            return self
        return self._cut([(rank, one.liveliest(steps)) for rank, one in enumerate(self.experiments)])

    def representative(self) -> Likelihood:
        """
        Return stretches spread evenly over the train and validation parts; itself where they are hardly more.

        Which they are depends on the number of samples only, so that they favour no effect.
        """
        count = sum(int(np.count_nonzero(one.fitted)) for one in self.experiments)
        if count <= 2 * STRETCHES * STRETCH_SAMPLES:
            return self
        places = []
        for rank, one in enumerate(self.experiments):
            for begin, end in pairwise(np.searchsorted(one.part, range(PARTS.index('test') + 1)).tolist()):
                number = math.ceil(STRETCHES * (end - begin) / count)
                length = min(STRETCH_SAMPLES, (end - begin) // max(number, 1))
                firsts = np.linspace(begin, end - length, number).astype(int).tolist()
                places += [(rank, slice(first, first + length)) for first in firsts]
        return self._cut(places)

    def spread(self, steps: int) -> Likelihood:
        """
        Return short stretches spread evenly over each experiment, so many grid steps in all; itself if it has no more.

        They see all that is done in a recording, as the liveliest part of it may not.
        """
        share = steps / self.steps
        if share >= 1.0:
            return self
        number = math.ceil(SHORT_STRETCHES / len(self.experiments))
        places = []
        for rank, one in enumerate(self.experiments):
            length = max(int(share * one.part.size / number), 1)
            firsts = np.linspace(0, one.part.size - length, number).astype(int).tolist()
            places += [(rank, slice(first, first + length)) for first in firsts]
        return self._cut(places, SHORT_STRETCH_LEAD)

    def _cut(self, places: Sequence[tuple[int, slice]], lead: float = STRETCH_LEAD) -> Likelihood:
        """
        Return some stretches of some experiments.

        One from the middle starts as measured; this share of it does not count.
        """
        experiments = [self.experiments[rank].stretch(samples) for rank, samples in places]
        for rank, one in enumerate(experiments):
            if not one.starts_with_recording:
                late = np.arange(one.part.size) >= int(lead * one.part.size)
                experiments[rank] = replace(one, chosen=one.counts & late)
        weights = [self.weights[rank][samples] for rank, samples in places]
        return replace(self, experiments=tuple(experiments), weights=tuple(weights))

    @property
    def steps(self) -> int:
        """How many grid steps there are."""
        return sum(one.times.size for one in self.experiments)

    @property
    def samples(self) -> int:
        """How many samples count."""
        return sum(int(np.count_nonzero(one.counts)) for one in self.experiments)

    def simulate(self, model: Model) -> list[Array]:
        """Return what a model makes of each experiment, shape (m,) [SI]; it is kept as long as the model is."""
        if model not in self._simulated:
            self._simulated[model] = self.channel.simulated(self.experiments, model)
        return self._simulated[model]

    def counted(self, signals: Sequence[Array]) -> list[Array]:
        """Return signals of each experiment at the samples that count, weighted, each of shape (n,)."""
        return [(one * weight)[own.counts] for one, weight, own in zip(signals, self.weights, self.experiments)]

    def residuals(self, simulated: Sequence[Array]) -> list[Array]:
        """Return measured less simulated at the samples that count, weighted."""
        return self.counted([one.measured - values for one, values in zip(self.experiments, simulated)])

    def noise(self, model: Model) -> Noise:
        """Return the noise that a model leaves, from what represents all samples."""
        telling = self.representative()
        return self.channel.noise(telling.experiments, telling.simulate(model), model)

    def tests(self, model: Model, noise: Noise) -> list[Test]:
        """Return the tests of what a model leaves, from what represents all samples."""
        telling = self.representative()
        return list(telling.tested(telling.simulate(model), noise, bool(model.parts)))

    def tested(self, simulated: Sequence[Array], noise: Noise, refined: bool = False) -> Iterator[Test]:
        """
        Return the tests of what simulations leave, at the samples that count, which follow each other.

        `refined` says whether the model has a core or effects.
        """
        residuals, regressors = [], []
        for one, values, weight in zip(self.experiments, simulated, self.precisions(simulated)):
            if np.any(one.counts):
                residuals.append(((one.measured - values) * weight)[one.counts])
                regressors.append(self.channel.regressors(one, values, weight))
        return residual_tests(residuals, regressors, noise, refined)

    # a fit

    def evaluate(self, unknowns: Unknowns, point: Array) -> Quadratic:
        """Return what the sum of squared residuals is like near a point."""
        total = 0.0
        gradient, normal = np.zeros(point.size), np.zeros((point.size, point.size))
        for rows, own in self.rows(unknowns, point):
            here = Quadratic.of(rows)
            total += here.total
            gradient[own] += here.gradient
            normal[np.ix_(own, own)] += here.normal
        here = Quadratic(total, gradient, normal)
        return here.beside_prior(unknowns.away(point), unknowns.precision, max(self.samples, 1))

    def rows(self, unknowns: Unknowns, point: Array) -> Iterator[tuple[Array, Indices]]:
        """
        Yield the residuals piece by piece, simulated less measured, and below them their derivatives.

        Yields
        ------
        rows, own
            Shape (1 + k, n) [SI], and by which unknowns, shape (k,).

        """
        row, scales = unknowns.row(point), unknowns.scales(point)
        steps = np.where(point + DIFFERENCE_STEP <= unknowns.upper, DIFFERENCE_STEP, -DIFFERENCE_STEP) * scales
        for experiment, weight in zip(self.experiments, self.weights):
            counts = experiment.counts
            own, slots = unknowns.of(experiment)
            numbers = self.channel.of_one(row[None], experiment)[0]
            last = int(np.max(np.flatnonzero(counts), initial=-1)) + 1
            walk = self.channel.linearised(experiment, unknowns.parts, numbers, slots, steps[own], last)
            for samples, simulated, jacobian in walk:
                here = slice(samples.start, samples.stop)
                rows = np.empty((1 + own.size, np.count_nonzero(counts[here])))
                _fill(
                    rows,
                    np.ascontiguousarray(simulated),  # of one layout: for each another function is compiled
                    experiment.measured[here],
                    weight[here],
                    counts[here],
                    np.ascontiguousarray(jacobian.T),
                    scales[own],
                )
                yield rows, own

    # what a model is worth

    def criterion(self, residuals: Sequence[Array], unknowns: int, coefficients: Array) -> float:
        """Return the Bayesian information criterion of what a model leaves, whitened by an autoregression."""
        squares = sum(float(np.sum(whitened(residual, coefficients) ** 2)) for residual in residuals)
        return self.samples * math.log(max(squares, LEAST_SUM_OF_SQUARES)) + unknowns * math.log(self.samples)

    def evidence(self, before: float, after: float, unknowns: int, coefficients: Array) -> float:
        """
        Return by how much sums of squares lower the criterion where autoregressive noise counts for less.

        A slow effect, a sine for one, suits slow noise too, and whitening alone doesn't see that.
        """
        samples = self.samples * independent_share(coefficients)
        return samples * math.log(before / max(after, LEAST_SUM_OF_SQUARES)) - unknowns * math.log(self.samples)


@kernel
def _fill(
    rows: Array, simulated: Array, measured: Array, weight: Array, counts: Mask, slopes: Array, scales: Array
) -> None:
    """Fill in the weighted residuals of the samples that count, and below them their derivatives."""
    kept = 0
    for sample in range(measured.size):
        if counts[sample]:
            rows[0, kept] = (simulated[sample] - measured[sample]) * weight[sample]
            for rank in range(scales.size):
                rows[1 + rank, kept] = slopes[rank, sample] * scales[rank] * weight[sample]
            kept += 1
