# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit and their bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.identification.data import Experiment, shortest_period
from cfd_pneumatic.model import EffectParameter

_SHORTEST_LAG = 0.15  # of a sample: a shorter lag is not distinguishable from none, and needs short steps
_NYQUIST = 0.5  # periods in a sample: a faster oscillation is aliased, and needs short steps
_FEWEST_PERIODS = 0.5  # in the longest experiment: with fewer, a period is not distinguishable from a drift

_AT_AN_END = 0.1  # of the stroke: a place closer to an end is visited from a single side
_SHORT = 0.5  # of the stroke: nothing opens and shuts over a longer distance
_LEAST_SUPPLY = 1.05  # of the highest recorded pressure: with a lower supply a valve would hardly pass air


@dataclass(frozen=True)
class Unknown:
    """
    A value that a fit searches.

    Attributes
    ----------
    name, unit
        `k_x`, `leakage.flow`; empty for a value of a recording.
    slot
        Index in a row, see `Channel.row`.
    lower, upper
        Bounds [unit].
    scale
        Scale in which the value is of order 1 [unit]; not used for logarithms.
    logarithmic
        Whether the logarithm is searched.
    passing
        Whether the signal forgets the value soon, such as the start of a recording.
    expected, spread
        Mean and standard deviation of the prior [unit; or of the logarithm if that is searched].

    """

    name: str
    unit: str
    slot: int
    lower: float
    upper: float
    scale: float
    logarithmic: bool = False
    passing: bool = False
    expected: float = 0.0
    spread: float = math.inf


def search_bounds(parameter: EffectParameter, experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Return the bounds of a parameter that the experiments can determine [its unit]."""
    lower, upper = parameter.lower if parameter.least is None else parameter.least, parameter.upper
    if parameter.unit == 's' and parameter.logarithmic:
        lower = max(lower, _SHORTEST_LAG * shortest_period(experiments))
    elif parameter.unit == 'Hz':
        upper = min(upper, _NYQUIST / shortest_period(experiments))
        if parameter.logarithmic:
            lower = max(
                lower, _FEWEST_PERIODS / max(float(np.ptp(experiment.sample_times)) for experiment in experiments)
            )
    if parameter.is_supply:
        lower = max(lower, _LEAST_SUPPLY * max(float(np.max(experiment.measured)) for experiment in experiments))
    if parameter.on_stroke:
        low = min(float(np.min(experiment.inputs['displacement'])) for experiment in experiments)
        stroke = max(float(np.max(experiment.inputs['displacement'])) for experiment in experiments) - low
        if parameter.on_stroke == 'place':
            lower, upper = low + _AT_AN_END * stroke, low + (1.0 - _AT_AN_END) * stroke
        else:
            upper = _SHORT * stroke
    return min(lower, upper), upper
