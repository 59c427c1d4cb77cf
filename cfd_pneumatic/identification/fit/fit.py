# SPDX-License-Identifier: Apache-2.0
"""Fit a channel's model, with or without effects, and estimate each parameter's uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from cfd_pneumatic.arrays import Array, Indices
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.channels import NOT_ESTIMATED, Channel, Estimate, Model
from cfd_pneumatic.identification.data import Experiment
from cfd_pneumatic.identification.fit.levenberg import least_squares
from cfd_pneumatic.identification.fit.likelihood import Likelihood, Unknowns
from cfd_pneumatic.identification.fit.thresholds import (
    CONFIDENCE,
    EXCERPT_STEPS,
    FINE_SEARCH,
    LARGEST_PRESSURE_RATIO,
    LARGEST_RELATIVE_STD,
    LARGEST_SPREAD_RATIO,
    LEAST_BOUND_DISTANCE,
    LEAST_SINGULAR_VALUE,
    ROUGH_SEARCH,
    WEIGHING_SEARCH,
)
from cfd_pneumatic.identification.fit.uncertainty import Covariance, Information, information
from cfd_pneumatic.runtime import map_in_threads

AT_BOUND = 'the fit ends at its'
"""Begin of the reason why a parameter is not identifiable that ends at a bound."""

SETPOINT_OFFSET = 'setpoint_offset'
"""Name of the mean offset of the set-points in a covariance, as in a parameter file."""

_OFFSET = 'offset'


@dataclass(frozen=True)
class Fit:
    """
    A fitted model of a channel.

    Attributes
    ----------
    model
        Values of the model.
    estimates
        Parameters of the model, its core and its effects (`EFFECT.PARAMETER`), each with a standard error or a reason.
    stds
        Standard errors of the recordings' values, shape of `Model.recording_values`; 0 if held [SI].
    simulated
        Simulated signal of each experiment, shape (m,) [SI].
    likelihood
        Likelihood of the fit.
    covariance
        Covariance of the parameters that were not held, and of the mean offset of the set-points.

    """

    model: Model
    estimates: tuple[Estimate, ...]
    stds: Array
    simulated: tuple[Array, ...]
    likelihood: Likelihood
    covariance: Covariance

    @property
    def spans_pressures(self) -> bool:
        """Whether the recordings' pressures differ so much that no set of gains holds for all."""
        levels = [float(level[0]) for level in self.likelihood.channel.levels(self.likelihood.experiments, self.model)]
        return bool(levels) and max(levels) > LARGEST_PRESSURE_RATIO * min(levels)


def fit_model(channel: Channel, experiments: Sequence[Experiment], initial: Model | None = None) -> Fit:
    """
    Fit a channel's model without effects jointly to several recordings.

    The residuals of a first fit determine the weights of the samples in the second fit.

    Parameters
    ----------
    channel, experiments
        Channel, and its recordings.
    initial
        First guess; by default the channel's starts are compared.

    Raises
    ------
    InputError
        If the recordings determine no parameter.

    """
    unweighted = Likelihood.alike(channel, experiments)
    if not unweighted.samples:
        raise InputError(
            f'the {channel.quantity.name} has no sample to fit. A fit does not use the first moments of a recording '
            'that begins while the piston moves. Begin at rest, or record longer'
        )
    starts = channel.starts(experiments) if initial is None else [initial]
    start = starts[0]
    if len(starts) > 1 or unweighted.excerpt(EXCERPT_STEPS) is not unweighted:
        excerpt = unweighted.excerpt(EXCERPT_STEPS)
        # start pressures are held: the cost has kinks there, at which the search would stop far from the optimum
        candidates = map_in_threads(lambda model: find_optimum(excerpt, model, *ROUGH_SEARCH, passing=False), starts)
        start = min(candidates, key=lambda candidate: candidate.cost).model
    weighing_model = _with_best_start_side(unweighted, find_optimum(unweighted, start, *WEIGHING_SEARCH).model)
    weighed = unweighted.weighed(unweighted.simulate(weighing_model))
    return summary(weighed, find_optimum(weighed, weighing_model, *FINE_SEARCH).model)


def _with_best_start_side(likelihood: Likelihood, model: Model) -> Model:
    """
    Return a fitted model with each recording's start above or below the set-point, as fits better.

    A pressure that does not begin at rest charges or vents. The cost has a minimum on either side.
    """
    channel, experiments = likelihood.channel, likelihood.experiments
    start_slots = [unknown.slot for unknown in channel.unknowns(experiments, model) if unknown.passing]
    if not start_slots:
        return model
    row = channel.row(model)
    row[start_slots] *= -1.0
    mirrored = find_optimum(likelihood, channel.model(row, tuple(model.parts)), *WEIGHING_SEARCH).model
    costs = [
        [float(run @ run) for run in likelihood.residuals(likelihood.simulate(side))] for side in (model, mirrored)
    ]
    is_better = np.array(costs[1]) < np.array(costs[0])
    recording_values = model.recording_values.copy()
    for experiment, better in zip(experiments, is_better):
        if better:
            recording_values[experiment.index] = mirrored.recording_values[experiment.index]
    return find_optimum(
        likelihood, replace(mirrored if is_better.all() else model, recording_values=recording_values), *WEIGHING_SEARCH
    ).model


class Optimum(NamedTuple):
    """The best model of a search, and its sum of squared residuals; infinite if the model diverged."""

    model: Model
    cost: float


def find_optimum(
    likelihood: Likelihood,
    start: Model,
    tolerance: float,
    evaluations: int,
    enough: float = 0.0,
    frozen: Iterable[str] = (),
    passing: bool = True,
    noise: float = math.inf,
) -> Optimum:
    """
    Search the best model from a start; cores and effects that are `frozen` keep their parameters.

    Start values, which the signal forgets soon, are searched unless `passing` is False. The search ends when the
    cost falls by less than a share `tolerance`, after `evaluations`, or when the cost is at most `enough`. The share is
    larger far above the `noise`, a standard deviation [SI].
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, start, frozen, passing)
    if not unknowns.start.size:
        residuals = likelihood.residuals(likelihood.simulate(start))
        return Optimum(start, sum(float(run @ run) for run in residuals))
    point, cost = least_squares(
        lambda at: likelihood.evaluate(unknowns, at),
        unknowns.start,
        unknowns.lower,
        unknowns.upper,
        tolerance,
        evaluations,
        enough,
        unknowns.longest_step,
        likelihood.effort.is_stopped,
        likelihood.samples * noise**2,
    )
    return Optimum(unknowns.model(point), cost.total)


def summary(likelihood: Likelihood, model: Model) -> Fit:
    """
    Estimate the standard error of each parameter of a fitted model, or why the parameter is not identifiable.

    Parameters that are not identifiable are held. The standard errors of the other parameters depend on that.

    Raises
    ------
    InputError
        If there are too few samples, or the samples determine nothing.

    """
    channel, experiments = likelihood.channel, likelihood.experiments
    simulated = likelihood.simulate(model)
    unknowns = Unknowns(channel, experiments, model)
    fisher = search_information(likelihood, unknowns, simulated)
    degrees = fisher.size - len(unknowns.table)
    if degrees < 1:
        raise InputError(
            f'{fisher.size} {channel.quantity.name} samples are too few for {len(unknowns.table)} unknowns. '
            'Record longer'
        )
    reasons = _unidentifiable(likelihood, unknowns, fisher)
    matrix, free = _search_covariance(channel, unknowns, fisher, degrees, reasons)
    stds = _standard_errors(unknowns, matrix, free, reasons)
    std_of = dict(zip(unknowns.slots.tolist(), stds.tolist()))
    quantile = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE))
    why = {unknowns.table[index].slot: reason for index, reason in reasons.items()}
    row = channel.row(model)
    held_reasons = channel.held(experiments, model)
    estimates = []
    for slot, name, unit in _reported_parameters(channel, model):
        reason = why.get(slot, held_reasons.get(name))
        if reason is not None:
            estimates.append(Estimate(name, unit, None, None, None, reason))
            continue
        value, std = float(row[slot]), std_of.get(slot, 0.0)
        estimates.append(Estimate(name, unit, value, std, (value - quantile * std, value + quantile * std), None))
    recording_stds = np.array(
        [
            [std_of.get(slot, 0.0) for slot in channel.recording_slots(index)]
            for index in range(len(model.recording_values))
        ]
    )
    channel.check(experiments, simulated, model, estimates)
    covariance = _parameter_covariance(likelihood, unknowns, matrix, free)
    return Fit(model, tuple(estimates), recording_stds, tuple(simulated), likelihood, covariance)


def search_information(likelihood: Likelihood, unknowns: Unknowns, simulated: Sequence[Array]) -> Information:
    """Return the information of the residuals about the unknowns, in the units of the search."""

    def jacobians() -> Iterator[Array]:
        for rows, columns in likelihood.rows(unknowns, unknowns.start):
            jacobian = np.zeros((rows.shape[1], len(unknowns.table)))
            jacobian[:, columns] = rows[1:].T
            yield jacobian

    measured = information(jacobians(), [run for run in likelihood.residuals(simulated) if run.size])
    return measured.with_prior(unknowns.precision)


def _unidentifiable(likelihood: Likelihood, unknowns: Unknowns, fisher: Information) -> dict[int, str]:
    """Return the reasons why some unknowns are not identifiable, by index; before any statistics."""
    channel, reasons = likelihood.channel, {}
    size = np.sqrt(np.diag(fisher.normal))
    for index, (unknown, value) in enumerate(zip(unknowns.table, unknowns.start.tolist())):
        hint = f': {channel.hints[unknown.name]}' if unknown.name in channel.hints else ''
        effect = unknown.name.partition('.')[0]
        reason = channel.unidentifiable(likelihood.experiments, effect) if effect in channel.effects else None
        if size[index] == 0.0:
            reason = f'nothing in the recordings depends on it{hint}'
        elif unknown.name and value - unknowns.lower[index] < LEAST_BOUND_DISTANCE:
            reason = f'{AT_BOUND} lower bound {unknown.lower:g} {unknown.unit}{hint}'
        elif unknown.name and unknowns.upper[index] - value < LEAST_BOUND_DISTANCE:
            reason = f'{AT_BOUND} upper bound {unknown.upper:g} {unknown.unit}{hint}'
        if reason is not None:
            reasons[index] = reason
    free = np.array([index for index in range(size.size) if index not in reasons], dtype=np.intp)
    powers, directions = np.linalg.eigh(fisher.normal[np.ix_(free, free)] / np.outer(size[free], size[free]))
    blind = np.abs(directions[:, powers < LEAST_SINGULAR_VALUE**2 * np.max(powers, initial=0.0)]) > LARGEST_RELATIVE_STD
    for index in free[np.any(blind, axis=1)].tolist():
        reasons[index] = 'not distinguishable from other unknowns. Let the piston reverse, or change the set-point'
    return reasons


def _search_covariance(
    channel: Channel, unknowns: Unknowns, fisher: Information, degrees: int, reasons: dict[int, str]
) -> tuple[Array, Indices]:
    """
    Return the covariance of the unknowns that are not held, and their indices, shape (k, k) and (k,).

    The covariance is in the units of the search. A parameter of the model without effects is held unless zero is at
    least three standard errors away; the function adds the reason to `reasons`.
    """
    model_indices = [
        index
        for index, unknown in enumerate(unknowns.table)
        if unknown.logarithmic and unknown.name in channel.parameters
    ]
    while True:
        free = np.array([index for index in range(len(unknowns.table)) if index not in reasons], dtype=np.intp)
        covariance = fisher.covariance(degrees, free)
        stds = dict(zip(free.tolist(), np.sqrt(np.diag(covariance)).tolist()))
        worst = max((index for index in model_indices if index in stds), key=stds.__getitem__, default=None)
        if worst is None or stds[worst] <= LARGEST_RELATIVE_STD:
            return covariance, free
        hint = channel.hints[unknowns.table[worst].name]
        reasons[worst] = f'its standard error would be {100.0 * stds[worst]:.0f} % of its value: {hint}'


def _standard_errors(unknowns: Unknowns, covariance: Array, free: Indices, reasons: dict[int, str]) -> Array:
    """
    Return the standard errors of the unknowns, 0 if held [unknown's unit]; add to `reasons` the undetermined ones.

    A parameter of an effect is identifiable if zero is at least one standard error away. See `_search_covariance` for
    covariance and free.
    """
    stds = np.zeros(len(unknowns.table))
    stds[free] = np.sqrt(np.diag(covariance))
    errors = stds * unknowns.scales(unknowns.start)
    values = unknowns.row(unknowns.start)[unknowns.slots]
    for index, unknown in enumerate(unknowns.table):
        if stds[index] > LARGEST_SPREAD_RATIO * unknown.spread / (1.0 if unknown.logarithmic else unknown.scale):
            reasons.setdefault(index, NOT_ESTIMATED)
        elif '.' in unknown.name and errors[index] > abs(values[index]):
            reasons.setdefault(index, 'these recordings determine the effect, but not this parameter')
    return errors


def _parameter_covariance(likelihood: Likelihood, unknowns: Unknowns, covariance: Array, free: Indices) -> Covariance:
    """
    Return the covariance of the parameters that are not held, and of the mean offset of the set-points [SI].

    All parameters that the fit searched have rows, also those that are not reported and the heights of curves: what one
    of them changes, others compensate. Without a part of them the band of a prediction would be too wide. See
    `_search_covariance` for covariance and free.
    """
    slots = unknowns.slots[free]
    rows = {unknowns.table[index].name: slots == slot for index, slot in zip(free.tolist(), slots.tolist())}
    rows.pop('', None)
    offsets = _offset_slots(likelihood)
    is_offset = np.isin(slots, offsets)
    if np.any(is_offset):
        rows[SETPOINT_OFFSET] = is_offset / len(offsets)
    derivatives = np.array([*rows.values()]).reshape(len(rows), free.size) * unknowns.scales(unknowns.start)[free]
    return Covariance(tuple(rows), derivatives @ covariance @ derivatives.T)


def _offset_slots(likelihood: Likelihood) -> list[int]:
    """
    Return the slots of the offsets of recordings with a recorded set-point, or of all recordings if there are none.

    The offset of a set-point that was not recorded is that of its estimate. A channel may have no offsets.
    """
    channel = likelihood.channel
    if _OFFSET not in channel.recording_parameters:
        return []
    rank = channel.recording_parameters.index(_OFFSET)
    recorded = {experiment.index for experiment in likelihood.experiments if not experiment.drifts}
    indices = recorded or {experiment.index for experiment in likelihood.experiments}
    return [channel.recording_slots(index)[rank] for index in sorted(indices)]


def _reported_parameters(channel: Channel, model: Model) -> Iterator[tuple[int, str, str]]:
    """Yield slot, name and unit of the parameters of the model, its core and its effects."""
    for slot, (name, unit) in enumerate(channel.parameters.items()):
        yield slot, name, unit
    for effect in model.parts:
        if channel.effects[effect].generic:  # a curve is reported with its band
            continue
        for slot, parameter in zip(channel.slots_of(effect), channel.effects[effect].parameters):
            yield slot, f'{effect}.{parameter.name}', parameter.unit
