# SPDX-License-Identifier: Apache-2.0
"""
The likelihood of a channel's samples: weights, whitening of residuals, and criterion of a model.

Samples are normally distributed. The standard deviation of a sample grows with the residual of its recording and with
the jitter of its stamp. Every fit, search and comparison of a channel uses the same `Likelihood` or a part of it. To
change the likelihood, change this file.
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
from cfd_pneumatic.identification.data import PARTS, Effort, Experiment
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
    The unknowns of a search: logarithms, or values in units that make them of order 1.

    Parameters
    ----------
    channel, experiments, model
        Channel, its recordings, and the start of the search.
    frozen
        Cores and effects whose parameters stay as they are.
    passing
        Whether start values, which the signal forgets soon, are searched.

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
        self.table: list[Unknown] = [
            unknown for unknown in unknowns if unknown.slot not in stay and (passing or not unknown.passing)
        ]
        self.count = len(unknowns)
        self.parts = tuple(model.parts)
        self.slots = np.array([unknown.slot for unknown in self.table], dtype=np.intp)
        self._channel = channel
        self._assumed = model.assumed_parameters
        self._row = channel.row(model)
        for name in channel.held(experiments, model):
            effect, _, parameter = name.partition('.')
            if effect in model.effects and parameter:
                names = [entry.name for entry in channel.effects[effect].parameters]
                rank = names.index(parameter)
                self._row[channel.slots_of(effect)[rank]] = channel.effects[effect].null[rank]
        self._logarithmic = np.array([unknown.logarithmic for unknown in self.table], dtype=np.bool_)
        self._units = np.array([1.0 if unknown.logarithmic else unknown.scale for unknown in self.table])
        self.lower, self.upper = (
            self._inward(np.array([getattr(unknown, side) for unknown in self.table])) for side in ('lower', 'upper')
        )
        self._expected = np.array([unknown.expected for unknown in self.table]) / self._units
        self.precision = (self._units / np.array([unknown.spread for unknown in self.table])) ** 2
        self._concerning = {
            experiment.index: self._indices_and_slots(channel.recording_slots(experiment.index), channel.shared)
            for experiment in experiments
        }
        self.start = np.clip(self._inward(self._row[self.slots]), self.lower, self.upper)

    def _indices_and_slots(self, recording_slots: range, shared: int) -> tuple[Indices, Indices]:
        indices = np.flatnonzero((self.slots < shared) | np.isin(self.slots, recording_slots))
        slots = self.slots[indices]
        return indices, np.where(slots < shared, slots, slots - recording_slots.start + shared)

    def concerning(self, experiment: Experiment) -> tuple[Indices, Indices]:
        """Return the indices of an experiment's unknowns, and their slots in its row, each of shape (k,)."""
        return self._concerning[experiment.index]

    @property
    def longest_step(self) -> Array:
        """Largest step of the search, shape (k,): a factor of seven for logarithms."""
        return np.where(self._logarithmic, LARGEST_LOG_STEP, np.inf)

    def deviation(self, point: Array) -> Array:
        """Return the deviation of each unknown from its prior expectation, 0 without a prior, shape (k,)."""
        return np.where(self.precision > 0.0, point - self._expected, 0.0)

    def _inward(self, values: Array) -> Array:
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.where(self._logarithmic, np.log(np.maximum(values, 0.0)), values / self._units)

    def row(self, point: Array) -> Array:
        """Return the row of the model at a point."""
        row = self._row.copy()
        row[self.slots] = np.where(
            self._logarithmic, np.exp(np.where(self._logarithmic, point, 0.0)), point * self._units
        )
        return row

    def scales(self, point: Array) -> Array:
        """Return the derivative of each value by its unknown, shape (k,)."""
        return np.where(self._logarithmic, self.row(point)[self.slots], self._units)

    def model(self, point: Array) -> Model:
        """Return the model at a point."""
        return replace(self._channel.model(self.row(point), self.parts, self.count), assumed_parameters=self._assumed)


@dataclass(frozen=True)
class Likelihood:
    """
    The likelihood of some experiments of a channel.

    Attributes
    ----------
    channel
        Measured channel.
    experiments
        Recordings of the channel.
    weights
        Weights of each experiment's samples, shape (m,).
    effort
        Counts the simulated steps; parts of a likelihood share it.

    """

    channel: Channel
    experiments: tuple[Experiment, ...]
    weights: tuple[Array, ...]
    effort: Effort = field(default_factory=Effort, repr=False, compare=False)
    _simulated: WeakKeyDictionary[Model, list[Array]] = field(default_factory=WeakKeyDictionary, init=False, repr=False)

    @classmethod
    def alike(cls, channel: Channel, experiments: Sequence[Experiment]) -> Likelihood:
        """Return the likelihood with equal weights of all samples."""
        return cls(channel, tuple(experiments), tuple(np.ones(experiment.part.size) for experiment in experiments))

    def weighed(self, simulated: Sequence[Array]) -> Likelihood:
        """Return the likelihood with weights from a simulation and its residuals; itself if the weights are equal."""
        precisions = self.precisions(simulated)
        residuals = [
            (experiment.measured - values)[experiment.counts] * precision[experiment.counts]
            for experiment, values, precision in zip(self.experiments, simulated, precisions)
        ]
        rms = np.array([math.sqrt(float(run @ run) / run.size) if run.size else math.nan for run in residuals])
        scales = np.nan_to_num(np.nanmean(rms) / np.maximum(rms, LEAST_RMS), nan=1.0)
        weights = tuple(precision * scale for precision, scale in zip(precisions, scales.tolist()))
        return self if all(map(np.array_equal, weights, self.weights)) else replace(self, weights=weights)

    def precisions(self, simulated: Sequence[Array]) -> list[Array]:
        """Return the relative precision of samples within each recording, for fits and tests, each of shape (m,)."""
        return [self.channel.precision(*pair) for pair in zip(self.experiments, simulated)]

    def until(self, part: str) -> Likelihood:
        """Return the likelihood of the samples up to the end of a part."""
        cut = [experiment.until(part) for experiment in self.experiments]
        weights = [weight[: experiment.part.size] for experiment, weight in zip(cut, self.weights)]
        return replace(self, experiments=tuple(cut), weights=tuple(weights))

    def excerpt(self, steps: int) -> Likelihood:
        """
        Return the likelihood of the liveliest part of each experiment; itself if none has more grid steps.

        The parts of many experiments are shorter, so that many experiments hardly take longer than a few.
        """
        steps = min(steps, max(FULL_EXCERPTS * steps // len(self.experiments), FEWEST_EXCERPT_STEPS))
        if max(experiment.times.size for experiment in self.experiments) <= steps:
            return self
        return self._cut([(rank, experiment.liveliest(steps)) for rank, experiment in enumerate(self.experiments)])

    def representative(self) -> Likelihood:
        """
        Return the likelihood of stretches spread evenly over train and validation parts; itself if hardly longer.

        The choice of stretches depends on the number of samples only, so that the stretches favour no effect.
        """
        count = sum(int(np.count_nonzero(experiment.fitted)) for experiment in self.experiments)
        if count <= 2 * STRETCHES * STRETCH_SAMPLES:
            return self
        places = []
        for rank, experiment in enumerate(self.experiments):
            for begin, end in pairwise(np.searchsorted(experiment.part, range(PARTS.index('test') + 1)).tolist()):
                number = math.ceil(STRETCHES * (end - begin) / count)
                length = min(STRETCH_SAMPLES, (end - begin) // max(number, 1))
                firsts = np.linspace(begin, end - length, number).astype(int).tolist()
                places += [(rank, slice(first, first + length)) for first in firsts]
        return self._cut(places)

    def spread(self, steps: int) -> Likelihood:
        """
        Return the likelihood of short stretches over each experiment, `steps` grid steps in all; itself if shorter.

        The stretches represent all motion of a recording. The liveliest part may not.
        """
        share = steps / self.steps
        if share >= 1.0:
            return self
        number = math.ceil(SHORT_STRETCHES / len(self.experiments))
        places = []
        for rank, experiment in enumerate(self.experiments):
            length = max(int(share * experiment.part.size / number), 1)
            firsts = np.linspace(0, experiment.part.size - length, number).astype(int).tolist()
            places += [(rank, slice(first, first + length)) for first in firsts]
        return self._cut(places, SHORT_STRETCH_LEAD)

    def _cut(self, places: Sequence[tuple[int, slice]], lead: float = STRETCH_LEAD) -> Likelihood:
        """
        Return the likelihood of some stretches of experiments.

        A stretch from the middle starts as measured; a share `lead` at its beginning does not count.
        """
        experiments = [self.experiments[rank].stretch(samples) for rank, samples in places]
        for rank, stretch in enumerate(experiments):
            if not stretch.starts_with_recording:
                is_late = np.arange(stretch.part.size) >= int(lead * stretch.part.size)
                experiments[rank] = replace(stretch, chosen=stretch.counts & is_late)
        weights = [self.weights[rank][samples] for rank, samples in places]
        return replace(self, experiments=tuple(experiments), weights=tuple(weights))

    @property
    def steps(self) -> int:
        """Number of grid steps."""
        return sum(experiment.times.size for experiment in self.experiments)

    @property
    def samples(self) -> int:
        """Number of samples that count."""
        return sum(int(np.count_nonzero(experiment.counts)) for experiment in self.experiments)

    def simulate(self, model: Model) -> list[Array]:
        """Return a model's simulation of each experiment, shape (m,) [SI]; cached as long as the model exists."""
        if model not in self._simulated:
            self.effort.add(self.effort_of(model, 1))
            self._simulated[model] = self.channel.simulated(self.experiments, model)
        return self._simulated[model]

    def counted(self, signals: Sequence[Array]) -> list[Array]:
        """Return signals of each experiment at the samples that count, weighted, each of shape (n,)."""
        return [
            (signal * weight)[experiment.counts]
            for signal, weight, experiment in zip(signals, self.weights, self.experiments)
        ]

    def residuals(self, simulated: Sequence[Array]) -> list[Array]:
        """Return measured less simulated at the samples that count, weighted."""
        return self.counted([experiment.measured - values for experiment, values in zip(self.experiments, simulated)])

    def noise(self, model: Model) -> Noise:
        """Return the noise of a model's residuals on the representative stretches."""
        stretches = self.representative()
        return self.channel.noise(stretches.experiments, stretches.simulate(model), model)

    def tests(self, model: Model, noise: Noise) -> list[Test]:
        """Return the tests of a model's residuals on the representative stretches."""
        stretches = self.representative()
        return list(stretches.tested(stretches.simulate(model), noise, bool(model.parts)))

    def tested(self, simulated: Sequence[Array], noise: Noise, refined: bool = False) -> Iterator[Test]:
        """
        Return the tests of the residuals of simulations, at the samples that count, which are adjacent.

        `refined` is True if the model has a core or effects.
        """
        residuals, regressors = [], []
        for experiment, values, weight in zip(self.experiments, simulated, self.precisions(simulated)):
            if np.any(experiment.counts):
                residuals.append(((experiment.measured - values) * weight)[experiment.counts])
                regressors.append(self.channel.regressors(experiment, values, weight))
        return residual_tests(residuals, regressors, noise, refined)

    # a fit

    def evaluate(self, unknowns: Unknowns, point: Array) -> Quadratic:
        """Return the quadratic model of the sum of squared residuals near a point."""
        total = 0.0
        gradient, normal = np.zeros(point.size), np.zeros((point.size, point.size))
        for rows, indices in self.rows(unknowns, point):
            quadratic = Quadratic.from_rows(rows)
            total += quadratic.total
            gradient[indices] += quadratic.gradient
            normal[np.ix_(indices, indices)] += quadratic.normal
        quadratic = Quadratic(total, gradient, normal)
        return quadratic.with_prior(unknowns.deviation(point), unknowns.precision, max(self.samples, 1))

    def rows(self, unknowns: Unknowns, point: Array) -> Iterator[tuple[Array, Indices]]:
        """
        Yield residuals, simulated less measured, and their derivatives in pieces.

        Yields
        ------
        rows, indices
            Residuals above derivatives, shape (1 + k, n) [SI], and the unknowns of the derivatives, shape (k,).

        """
        row, scales = unknowns.row(point), unknowns.scales(point)
        self.effort.add(self._effort(unknowns, row))
        steps = np.where(point + DIFFERENCE_STEP <= unknowns.upper, DIFFERENCE_STEP, -DIFFERENCE_STEP) * scales
        for experiment, weight in zip(self.experiments, self.weights):
            counts = experiment.counts
            indices, slots = unknowns.concerning(experiment)
            experiment_row = self.channel.rows_of_experiment(row[None], experiment)[0]
            last = int(np.max(np.flatnonzero(counts), initial=-1)) + 1
            pieces = self.channel.linearised(experiment, unknowns.parts, experiment_row, slots, steps[indices], last)
            for samples, simulated, jacobian in pieces:
                piece = slice(samples.start, samples.stop)
                rows = np.empty((1 + indices.size, np.count_nonzero(counts[piece])))
                _fill(
                    rows,
                    np.ascontiguousarray(simulated),  # each memory layout compiles another function
                    experiment.measured[piece],
                    weight[piece],
                    counts[piece],
                    np.ascontiguousarray(jacobian.T),
                    scales[indices],
                )
                yield rows, indices

    def effort_of(self, model: Model, models: int | None = None) -> float:
        """Return the effort of several models like `model`, by default of its derivatives [simulated steps]."""
        unknowns = Unknowns(self.channel, self.experiments, model)
        return self._effort(unknowns, unknowns.row(unknowns.start), models)

    def _effort(self, unknowns: Unknowns, row: Array, models: int | None = None) -> float:
        return sum(
            self.channel.effort(
                experiment,
                unknowns.parts,
                self.channel.rows_of_experiment(row[None], experiment)[0],
                1 + unknowns.concerning(experiment)[0].size if models is None else models,
                experiment.part.size,
            )
            for experiment in self.experiments
        )

    # comparison of models

    def criterion(self, residuals: Sequence[Array], unknowns: int, coefficients: Array) -> float:
        """Return the Bayesian information criterion of residuals that are whitened by an autoregression."""
        squares = sum(float(np.sum(whitened(residual, coefficients) ** 2)) for residual in residuals)
        return self.samples * math.log(max(squares, LEAST_SUM_OF_SQUARES)) + unknowns * math.log(self.samples)

    def criterion_drop_for_coloured_noise(
        self, before: float, after: float, unknowns: int, coefficients: Array
    ) -> float:
        """
        Return the decrease of the criterion between two sums of squares, with fewer independent samples.

        A slow effect such as a sine also fits slow noise, which whitening alone does not show.
        """
        samples = self.samples * independent_share(coefficients)
        return samples * math.log(before / max(after, LEAST_SUM_OF_SQUARES)) - unknowns * math.log(self.samples)


@kernel
def _fill(
    rows: Array, simulated: Array, measured: Array, weight: Array, counts: Mask, slopes: Array, scales: Array
) -> None:
    """Write the weighted residuals of the samples that count, and their derivatives below."""
    kept = 0
    for sample in range(measured.size):
        if counts[sample]:
            rows[0, kept] = (simulated[sample] - measured[sample]) * weight[sample]
            for rank in range(scales.size):
                rows[1 + rank, kept] = slopes[rank, sample] * scales[rank] * weight[sample]
            kept += 1
