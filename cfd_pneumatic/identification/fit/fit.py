# SPDX-License-Identifier: Apache-2.0
"""Fits of a channel's model, with or without effects, and what they tell of each parameter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from cfd_pneumatic.arrays import Array
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
from cfd_pneumatic.identification.fit.uncertainty import Information, information
from cfd_pneumatic.runtime import map_in_threads


@dataclass(frozen=True)
class Fit:
    """
    A channel's model, fitted.

    Attributes
    ----------
    model
        Its values.
    estimates
        Parameters, then those of core and effects (`EFFECT.PARAMETER`), with standard errors or why they have none.
    stds
        Standard errors of what each experiment has for itself, shape (experiments, own); 0 where it was held [SI].
    simulated
        What it makes of each experiment, shape (m,) [SI].
    likelihood
        By which it was fitted.

    """

    model: Model
    estimates: tuple[Estimate, ...]
    stds: Array
    simulated: tuple[Array, ...]
    likelihood: Likelihood

    @property
    def spans_pressures(self) -> bool:
        """Whether recordings begin at pressures so far apart that the gains of none of them hold for all."""
        levels = [float(one[0]) for one in self.likelihood.channel.levels(self.likelihood.experiments, self.model)]
        return bool(levels) and max(levels) > LARGEST_PRESSURE_RATIO * min(levels)


def fit_model(channel: Channel, experiments: Sequence[Experiment], initial: Model | None = None) -> Fit:
    """
    Fit a channel's model without effects jointly to several recordings.

    It is fitted twice: what the first fit leaves says what samples weigh in the second.

    Parameters
    ----------
    channel, experiments
        What was measured, and in which recordings.
    initial
        First guess; by default several are tried.

    Raises
    ------
    InputError
        If the recordings tell no parameter.

    """
    alike = Likelihood.alike(channel, experiments)
    if not alike.samples:
        raise InputError(
            f'no sample of the {channel.quantity.name} is left to fit: the first moments of a recording that begins '
            'while the piston moves are not used; begin at rest, or record longer'
        )
    starts = channel.starts(experiments) if initial is None else [initial]
    start = starts[0]
    if len(starts) > 1 or alike.excerpt(EXCERPT_STEPS) is not alike:
        part = alike.excerpt(EXCERPT_STEPS)
        # where a recording began is held: the sum has kinks in it, at which the gains would stay far off
        begun = map_in_threads(lambda one: find_optimum(part, one, *ROUGH_SEARCH, passing=False), starts)
        start = min(begun, key=lambda found: found.cost).model
    first = _begun_on_either_side(alike, find_optimum(alike, start, *WEIGHING_SEARCH).model)
    weighed = alike.weighed(alike.simulate(first))
    return summary(weighed, find_optimum(weighed, first, *FINE_SEARCH).model)


def _begun_on_either_side(likelihood: Likelihood, model: Model) -> Model:
    """
    Return a fitted model, its recordings begun above the set-point or below it, as each fits better.

    A pressure that begins under way charges or vents: either side has a minimum of its own.
    """
    channel, experiments = likelihood.channel, likelihood.experiments
    begun = [one.slot for one in channel.unknowns(experiments, model) if one.passing]
    if not begun:
        return model
    row = channel.row(model)
    row[begun] *= -1.0
    other = find_optimum(likelihood, channel.model(row, tuple(model.parts)), *WEIGHING_SEARCH).model
    left = [[float(run @ run) for run in likelihood.residuals(likelihood.simulate(one))] for one in (model, other)]
    is_better = np.array(left[1]) < np.array(left[0])
    own = model.own.copy()
    for one, better in zip(experiments, is_better):
        if better:
            own[one.index] = other.own[one.index]
    return find_optimum(likelihood, replace(other if is_better.all() else model, own=own), *WEIGHING_SEARCH).model


class Optimum(NamedTuple):
    """A model that a search ended with, and the sum of squares that it leaves; infinite if it ran away."""

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
) -> Optimum:
    """
    Return the best model that is found from a start with its effects; those that are frozen keep their parameters.

    Where recordings began is searched unless `passing` is False: it is soon forgotten.
    The search ends when the sum falls by less than a share `tolerance`, after so many evaluations, or when it is
    `enough`.
    """
    unknowns = Unknowns(likelihood.channel, likelihood.experiments, start, frozen, passing)
    if not unknowns.start.size:
        left = likelihood.residuals(likelihood.simulate(start))
        return Optimum(start, sum(float(run @ run) for run in left))
    point, cost = least_squares(
        lambda at: likelihood.evaluate(unknowns, at),
        unknowns.start,
        unknowns.lower,
        unknowns.upper,
        tolerance,
        evaluations,
        enough,
        unknowns.longest_step,
    )
    return Optimum(unknowns.model(point), cost.total)


def summary(likelihood: Likelihood, model: Model) -> Fit:
    """
    Return a fitted model with what the recordings tell of each parameter.

    What is not identifiable is held; the standard errors of the others follow from that.

    Raises
    ------
    InputError
        If there are too few samples, or they tell nothing.

    """
    channel, experiments = likelihood.channel, likelihood.experiments
    simulated = likelihood.simulate(model)
    unknowns = Unknowns(channel, experiments, model)
    fisher = information_of(likelihood, unknowns, simulated)
    degrees = fisher.size - len(unknowns.table)
    if degrees < 1:
        raise InputError(
            f'{fisher.size} {channel.quantity.name} samples are too few for {len(unknowns.table)} unknowns: '
            'record longer'
        )
    reasons = _unidentifiable(likelihood, unknowns, fisher)
    stds = _standard_errors(channel, unknowns, fisher, degrees, reasons)
    std_of = dict(zip(unknowns.slots.tolist(), stds.tolist()))
    quantile = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE))
    why = {unknowns.table[index].slot: reason for index, reason in reasons.items()}
    row = channel.row(model)
    held = channel.held(experiments, model)
    estimates = []
    for slot, name, unit in _reported(channel, model):
        reason = why.get(slot, held.get(name))
        if reason is not None:
            estimates.append(Estimate(name, unit, None, None, None, reason))
            continue
        value, std = float(row[slot]), std_of.get(slot, 0.0)
        estimates.append(Estimate(name, unit, value, std, (value - quantile * std, value + quantile * std), None))
    own = np.array([[std_of.get(slot, 0.0) for slot in channel.own_slots(index)] for index in range(len(model.own))])
    channel.check(experiments, simulated, model, estimates)
    return Fit(model, tuple(estimates), own, tuple(simulated), likelihood)


def information_of(likelihood: Likelihood, unknowns: Unknowns, simulated: Sequence[Array]) -> Information:
    """Return what the residuals tell about the unknowns, as they are searched."""

    def jacobians() -> Iterator[Array]:
        for rows, own in likelihood.rows(unknowns, unknowns.start):
            jacobian = np.zeros((rows.shape[1], len(unknowns.table)))
            jacobian[:, own] = rows[1:].T
            yield jacobian

    found = information(jacobians(), [run for run in likelihood.residuals(simulated) if run.size])
    return found.beside_prior(unknowns.precision)


def _unidentifiable(likelihood: Likelihood, unknowns: Unknowns, fisher: Information) -> dict[int, str]:
    """Return why the values of some unknowns mean nothing, before any statistics."""
    channel, reasons = likelihood.channel, {}
    size = np.sqrt(np.diag(fisher.normal))
    for index, (one, value) in enumerate(zip(unknowns.table, unknowns.start.tolist())):
        hint = f': {channel.hints[one.name]}' if one.name in channel.hints else ''
        effect = one.name.partition('.')[0]
        reason = channel.unidentifiable(likelihood.experiments, effect) if effect in channel.effects else None
        if size[index] == 0.0:
            reason = f'nothing in the recordings depends on it{hint}'
        elif one.name and value - unknowns.lower[index] < LEAST_BOUND_DISTANCE:
            reason = f'the fit ends at its lower bound {one.lower:g} {one.unit}{hint}'
        elif one.name and unknowns.upper[index] - value < LEAST_BOUND_DISTANCE:
            reason = f'the fit ends at its upper bound {one.upper:g} {one.unit}{hint}'
        if reason is not None:
            reasons[index] = reason
    free = np.array([index for index in range(size.size) if index not in reasons], dtype=np.intp)
    powers, directions = np.linalg.eigh(fisher.normal[np.ix_(free, free)] / np.outer(size[free], size[free]))
    blind = np.abs(directions[:, powers < LEAST_SINGULAR_VALUE**2 * np.max(powers, initial=0.0)]) > LARGEST_RELATIVE_STD
    for index in free[np.any(blind, axis=1)].tolist():
        reasons[index] = 'it can not be told from other unknowns: let the piston reverse, or change the set-point'
    return reasons


def _standard_errors(
    channel: Channel, unknowns: Unknowns, fisher: Information, degrees: int, reasons: dict[int, str]
) -> Array:
    """
    Return the standard errors of what is identifiable [unknown's unit], and add to the reasons why the rest is not.

    A parameter of the model itself is identifiable if zero lies three standard errors away, or it is held; an effect's
    if zero lies one away.
    """
    stds = np.zeros(len(unknowns.table))
    own = [index for index, one in enumerate(unknowns.table) if one.logarithmic and one.name in channel.parameters]
    while True:
        free = np.array([index for index in range(stds.size) if index not in reasons], dtype=np.intp)
        stds[free] = np.sqrt(np.diag(fisher.covariance(degrees, free)))
        worst = max((index for index in own if index not in reasons), key=stds.__getitem__, default=None)
        if worst is None or stds[worst] <= LARGEST_RELATIVE_STD:
            break
        hint = channel.hints[unknowns.table[worst].name]
        reasons[worst] = f'its standard error would be {100.0 * stds[worst]:.0f} % of its value: {hint}'
    errors = stds * unknowns.scales(unknowns.start)
    values = unknowns.row(unknowns.start)[unknowns.slots]
    for index, one in enumerate(unknowns.table):
        if stds[index] > LARGEST_SPREAD_RATIO * one.spread / (1.0 if one.logarithmic else one.scale):
            reasons.setdefault(index, NOT_ESTIMATED)
        elif '.' in one.name and errors[index] > abs(values[index]):
            reasons.setdefault(index, 'these recordings tell the effect, but not this parameter')
    return errors


def _reported(channel: Channel, model: Model) -> Iterator[tuple[int, str, str]]:
    """Yield slot, name and unit of the model's parameters, and of its core's and effects'."""
    for slot, (name, unit) in enumerate(channel.parameters.items()):
        yield slot, name, unit
    for effect in model.parts:
        if channel.effects[effect].generic:  # a curve is told with its band
            continue
        for slot, parameter in zip(channel.slots_of(effect), channel.effects[effect].parameters):
            yield slot, f'{effect}.{parameter.name}', parameter.unit
