# SPDX-License-Identifier: Apache-2.0
"""Places of a curve in the model, variables of the curve, and positions of its knots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import PLACES, Curve, Model
from cfd_pneumatic.identification.search.candidates import Candidate, Candidates
from cfd_pneumatic.identification.search.thresholds import KNOT_SPACINGS, LEAST_VISITED_RANGE, OUTLIER_SHARE
from cfd_pneumatic.model import KNOTS


@dataclass(frozen=True)
class CurvePlace:
    """
    Place, variable and knots of a curve.

    Attributes
    ----------
    enters, against
        Place in the model and variable, keys of `curve`.
    memory
        Memory of the flow [s] or of the friction [m], if the curve depends on it.
    low, high
        Range of the variable.
    middle, crowd
        Value about which knots are dense, and their spacing there (`KNOT_SPACINGS`).
    unit
        A small height of the curve at this place.
    curve
        Effect that has the curve.

    """

    enters: str
    against: str
    memory: float
    low: float
    high: float
    middle: float
    crowd: float
    unit: float
    curve: Curve

    def parameters(self, heights: Sequence[float] | Array) -> tuple[float, ...]:
        """Return the effect's parameters for a curve with some heights, shape (knots,)."""
        indices = float(self.curve.enters.index(self.enters)), float(self.curve.against.index(self.against))
        return (*indices, self.memory, self.low, self.high, self.middle, self.crowd, *map(float, heights))

    def heights(self, model: Model) -> Array:
        """Return the heights of a model's curve, shape (knots,)."""
        return np.array(model.effects[self.curve.name][-KNOTS:])

    def add_curve(self, model: Model, heights: Array) -> Model:
        """Return a model with a curve at this place that has some heights, shape (knots,)."""
        return replace(model, effects={**model.effects, self.curve.name: self.parameters(heights)})

    def replace_heights(self, model: Model, heights: Array) -> Model:
        """Return a model with different heights of its curve, shape (knots,)."""
        parameters = *model.effects[self.curve.name][:-KNOTS], *heights.tolist()
        return replace(model, effects={**model.effects, self.curve.name: parameters})

    @property
    def name(self) -> tuple[str, str]:
        """Return place and variable."""
        return self.enters, self.against

    def with_memory_of(self, model: Model) -> CurvePlace:
        """Return the place with the memory of a model's curve."""
        return replace(self, memory=model.effects[self.curve.name][2])

    def with_range(self, low: float, high: float) -> CurvePlace:
        """Return the place with knots over a different range."""
        share = (self.middle - self.low) / (self.high - self.low)
        return replace(self, low=low, high=high, middle=low + share * (high - low))

    @property
    def absorbed(self) -> Array:
        """Return the heights that the model's own parameters absorb: constants, shape (knots, k)."""
        if PLACES[self.enters].keeps_constant:
            return np.zeros((KNOTS, 0))
        if self.name == ('flow', 'error'):  # the gains of charging and discharging absorb a constant each
            charging = np.heaviside(self.knots, 0.5)
            return np.column_stack([charging, 1.0 - charging])
        return np.ones((KNOTS, 1))

    def with_moved_knots(self, heights: Array) -> list[CurvePlace]:
        """
        Return variants of the place with different knots.

        Knots are dense where the curve bends most, or near zero if the variable has both signs.
        """
        middle = self.middle
        if self.against not in self.curve.both_ways:
            bends = np.abs(np.diff(np.diff(heights) / np.diff(self.knots)))
            middle = float(self.knots[1 + int(np.argmax(bends))])
        places = [replace(self, middle=middle, crowd=crowd) for crowd in KNOT_SPACINGS]
        return [place for place in places if place != self]

    @property
    def knots(self) -> Array:
        """Return the values of the variable at the knots, shape (knots,)."""
        position = np.linspace(-1.0, 1.0, KNOTS)
        share = position * self.crowd / (1.0 + self.crowd - np.abs(position))
        return np.asarray(self.middle + share * np.where(share > 0.0, self.high - self.middle, self.middle - self.low))

    def interpolation(self, values: Array) -> Array:
        """Return the matrix that interpolates heights linearly at values of the variable, shape (values, knots)."""
        values = np.clip(values, self.low, self.high)
        share = (values - self.middle) / np.where(values > self.middle, self.high - self.middle, self.middle - self.low)
        position = 0.5 * (KNOTS - 1) * (1.0 + share * (1.0 + self.crowd) / (np.abs(share) + self.crowd))
        return np.asarray(np.maximum(1.0 - np.abs(position[:, None] - np.arange(KNOTS)), 0.0))


def curve_places(candidates: Candidates, base: Candidate) -> list[CurvePlace]:
    """Return all places for a curve that is added to a model, over the ranges that the recordings visited."""
    ranges, curve = visited_ranges(candidates, base), candidates.channel.curve
    noise = math.sqrt(base.rss / candidates.train.samples)
    largest = {name: max(map(abs, ends)) for name, ends in ranges.items()}
    units = candidates.channel.characteristic_units(candidates.train.experiments, base.model, noise, largest)
    all_places = []
    for against, places in curve.asked.items():
        low, high = ranges[against]
        if high - low <= LEAST_VISITED_RANGE:
            continue
        for enters in filter(units.__contains__, places):
            memories = curve.memories.get((enters, against), (curve.memory,))
            both_ways = KNOT_SPACINGS[:1] if len(memories) > 1 else KNOT_SPACINGS
            crowds = both_ways if against in curve.both_ways else curve.crowds
            all_places += [
                CurvePlace(enters, against, memory, low, high, 0.5 * (low + high), crowd, units[enters], curve)
                for memory, crowd in product(memories, crowds)
            ]
    return all_places


def visited_ranges(
    candidates: Candidates, base: Candidate, share: float = OUTLIER_SHARE
) -> dict[str, tuple[float, float]]:
    """
    Return the range of each variable that the train and validation parts visited.

    Ranges of variables with both signs are symmetrical. A `share` of the samples at either end does not count, unless
    the variable has no outliers.
    """
    curve = candidates.channel.curve
    extremes: dict[str, list[Array]] = {name: [] for name in curve.against}
    for experiment, simulated in zip(candidates.train_validation.experiments, base.simulated):
        for name, values in candidates.channel.variables(experiment, simulated, base.model).items():
            end = 0.0 if name in curve.whole else share
            extremes[name].append(np.quantile(values, (end, 1.0 - end)))
    ranges = {name: (float(np.min(ends)), float(np.max(ends))) for name, ends in extremes.items()}
    for name in curve.both_ways:
        largest = max(map(abs, ranges[name]))
        ranges[name] = -largest, largest
    return ranges
