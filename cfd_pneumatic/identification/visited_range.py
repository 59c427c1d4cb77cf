# SPDX-License-Identifier: Apache-2.0
"""Range of each variable in which a model was estimated, and the samples of the test part that are outside."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.identification.channels import VARIABLES, Channel, Model
from cfd_pneumatic.identification.data import PARTS, Experiment
from cfd_pneumatic.identification.thresholds import LEAST_OUTSIDE_SHARE, RANGE_MARGIN

_RANGED = ('x', 'speed', 'p', 'force')


class Outside(NamedTuple):
    """
    Samples of the test part that are outside of the range of a variable in train and validation part.

    Attributes
    ----------
    variable
        Key of `VARIABLES`.
    low, high
        Range in train and validation part [unit of the variable].
    reached
        Value of the test part that is farthest outside [unit of the variable].
    share
        Share of the samples of the test part that are outside [-].
    inside_rmse, outside_rmse
        Errors of the samples of the test part inside and outside [Pa or N]; NaN without samples inside.

    """

    variable: str
    low: float
    high: float
    reached: float
    share: float
    inside_rmse: float
    outside_rmse: float

    @property
    def clause(self) -> str:
        """Return that the model was not tested outside, and the experiment that widens the range."""
        variable, is_above = VARIABLES[self.variable], self.reached > self.high
        limit = self.high if is_above else self.low
        side, unit = 'above' if is_above else 'below', variable.unit
        return (
            f'the test part has a {variable.axis} of {self.reached:.3g} {unit}, and the model was not estimated {side} '
            f'{limit:.3g} {unit}. Record several strokes up to there'
        )


def outside_masks(
    channel: Channel, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model
) -> list[Mask]:
    """Return for each experiment the samples of the test part that are outside of any variable's range, shape (m,)."""
    masks = [np.zeros(experiment.part.size, dtype=np.bool_) for experiment in experiments]
    for _, _, outside in _ranges(channel, experiments, simulated, model):
        masks = [mask | more for mask, more in zip(masks, outside)]
    return masks


def outside_ranges(
    channel: Channel, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model
) -> tuple[Outside, ...]:
    """Return the variables whose range the test part leaves in a share of its samples that matters."""
    is_test = np.concatenate([_is_test(experiment) for experiment in experiments])
    errors = np.concatenate([experiment.measured - values for experiment, values in zip(experiments, simulated)])
    found = []
    for name, (low, high, values), masks in _ranges(channel, experiments, simulated, model):
        outside = np.concatenate(masks)
        share = float(np.count_nonzero(outside)) / max(int(np.count_nonzero(is_test)), 1)
        if share >= LEAST_OUTSIDE_SHARE:
            excess = np.maximum(values - high, low - values)[outside]
            reached = float(values[outside][np.argmax(excess)])
            inside = is_test & ~outside
            found.append(Outside(name, low, high, reached, share, _rms(errors[inside]), _rms(errors[outside])))
    return tuple(found)


def _ranges(
    channel: Channel, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model
) -> Iterator[tuple[str, tuple[float, float, Array], list[Mask]]]:
    """Yield each variable with its range and its values, and the samples of the test part outside of the range."""
    if not any(np.any(_is_test(experiment)) for experiment in experiments):
        return
    all_values: list[Mapping[str, Array]] = [
        channel.variables(experiment, values, model) for experiment, values in zip(experiments, simulated)
    ]
    fitted = np.concatenate([experiment.fitted for experiment in experiments])
    for name in _RANGED:
        if name not in all_values[0]:
            continue
        values = np.concatenate([variables[name] for variables in all_values])
        if not np.any(fitted):
            continue
        low, high = float(np.min(values[fitted])), float(np.max(values[fitted]))
        margin = RANGE_MARGIN * (high - low)
        masks = [
            _is_test(experiment) & ((variables[name] < low - margin) | (variables[name] > high + margin))
            for experiment, variables in zip(experiments, all_values)
        ]
        yield name, (low, high, values), masks


def _is_test(experiment: Experiment) -> Mask:
    return np.asarray(experiment.part == PARTS.index('test'))


def _rms(errors: Array) -> float:
    return math.sqrt(float(np.mean(errors**2))) if errors.size else math.nan
