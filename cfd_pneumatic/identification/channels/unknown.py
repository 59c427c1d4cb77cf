# SPDX-License-Identifier: Apache-2.0
"""What a fit searches: a number, where it stands, and between which bounds."""

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
    One number that a fit searches.

    Attributes
    ----------
    name, unit
        `k_x`, `leakage.flow`; empty where it concerns one experiment only.
    slot
        Where it stands in a row, see `Channel.row`.
    lower, upper
        Bounds [unit].
    scale
        In which it is about one [unit]; not used where it is searched in its logarithm.
    logarithmic
        Whether it is.
    passing
        Whether it is forgotten soon: where a recording began.
    expected, spread
        What is known of it beforehand, mean and standard deviation [unit; of the logarithm where it is searched].

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


def bounds_of(parameter: EffectParameter, experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Return between which values a parameter is searched [its unit]: what experiments tell bounds it."""
    lower, upper = parameter.lower if parameter.least is None else parameter.least, parameter.upper
    if parameter.unit == 's' and parameter.logarithmic:
        lower = max(lower, LEAST_LAG_SHARE * shortest_period(experiments))
    elif parameter.unit == 'Hz':
        upper = min(upper, LARGEST_FREQUENCY / shortest_period(experiments))
        if parameter.logarithmic:
            lower = max(lower, FEWEST_PERIODS / max(float(np.ptp(one.sample_times)) for one in experiments))
    if parameter.is_supply:
        lower = max(lower, LEAST_SUPPLY_RATIO * max(float(np.max(one.measured)) for one in experiments))
    if parameter.on_stroke:
        low = min(float(np.min(one.inputs['displacement'])) for one in experiments)
        stroke = max(float(np.max(one.inputs['displacement'])) for one in experiments) - low
        if parameter.on_stroke == 'place':
            lower, upper = low + END_SHARE * stroke, low + (1.0 - END_SHARE) * stroke
        else:
            upper = LARGEST_WIDTH_SHARE * stroke
    return min(lower, upper), upper
