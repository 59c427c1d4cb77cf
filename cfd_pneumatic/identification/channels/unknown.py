# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit and their bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.identification.channels.thresholds import (
    END_SHARE,
    FEWEST_PERIODS,
    LARGEST_FREQUENCY,
    LARGEST_WIDTH_SHARE,
    LEAST_LAG_SHARE,
    LEAST_SUPPLY_RATIO,
)
from cfd_pneumatic.identification.data import Experiment, shortest_period
from cfd_pneumatic.model import EffectParameter


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
        lower = max(lower, LEAST_LAG_SHARE * shortest_period(experiments))
    elif parameter.unit == 'Hz':
        upper = min(upper, LARGEST_FREQUENCY / shortest_period(experiments))
        if parameter.logarithmic:
            lower = max(
                lower, FEWEST_PERIODS / max(float(np.ptp(experiment.sample_times)) for experiment in experiments)
            )
    if parameter.is_supply:
        lower = max(lower, LEAST_SUPPLY_RATIO * max(float(np.max(experiment.measured)) for experiment in experiments))
    if parameter.on_stroke:
        low = min(float(np.min(experiment.inputs['displacement'])) for experiment in experiments)
        stroke = max(float(np.max(experiment.inputs['displacement'])) for experiment in experiments) - low
        if parameter.on_stroke == 'place':
            lower, upper = low + END_SHARE * stroke, low + (1.0 - END_SHARE) * stroke
        else:
            upper = LARGEST_WIDTH_SHARE * stroke
    return min(lower, upper), upper
