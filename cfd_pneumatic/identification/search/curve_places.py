# SPDX-License-Identifier: Apache-2.0
"""Places for a curve: where a law may enter, on what it may depend, and where its knots are."""

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
    A place for a curve.

    Attributes
    ----------
    enters, against
        Where, and what it depends on: of those of `curve`.
    memory
        Of the flow, where it depends on that [s], or of friction [m].
    low, high, middle, crowd
        Its range, and how its knots crowd about what middle.
    unit
        A height that is small beside what it acts on.
    curve
        What draws it.

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
        """Return the parameters of a curve with some heights, shape (knots,)."""
        where = float(self.curve.enters.index(self.enters)), float(self.curve.against.index(self.against))
        return (*where, self.memory, self.low, self.high, self.middle, self.crowd, *map(float, heights))

    def heights(self, model: Model) -> Array:
        """Return the heights that a model's curve has, shape (knots,)."""
        return np.array(model.effects[self.curve.name][-KNOTS:])

    def on(self, model: Model, heights: Array) -> Model:
        """Return a model with a curve here that has some heights, shape (knots,)."""
        return replace(model, effects={**model.effects, self.curve.name: self.parameters(heights)})

    def drawn(self, model: Model, heights: Array) -> Model:
        """Return a model that has a curve with other heights, shape (knots,)."""
        own = *model.effects[self.curve.name][:-KNOTS], *heights.tolist()
        return replace(model, effects={**model.effects, self.curve.name: own})

    @property
    def name(self) -> tuple[str, str]:
        """Where it enters, and against what."""
        return self.enters, self.against

    def remembering(self, model: Model) -> CurvePlace:
        """Return it with the memory that a model's curve has."""
        return replace(self, memory=model.effects[self.curve.name][2])

    def over(self, low: float, high: float) -> CurvePlace:
        """Return it with its knots over another range."""
        share = (self.middle - self.low) / (self.high - self.low)
        return replace(self, low=low, high=high, middle=low + share * (high - low))

    @property
    def absorbed(self) -> Array:
        """Heights that the model's own numbers make up for, shape (knots, k): what is even, on either side of zero."""
        if PLACES[self.enters].keeps_constant:
            return np.zeros((KNOTS, 0))
        if self.name == ('flow', 'error'):
            charging = np.heaviside(self.knots, 0.5)
            return np.column_stack([charging, 1.0 - charging])
        return np.ones((KNOTS, 1))

    def elsewhere(self, heights: Array) -> list[CurvePlace]:
        """Return it with its knots where a curve bends most, or of what goes both ways nearer to nothing moving."""
        middle = self.middle
        if self.against not in self.curve.both_ways:
            bends = np.abs(np.diff(np.diff(heights) / np.diff(self.knots)))
            middle = float(self.knots[1 + int(np.argmax(bends))])
        others = [replace(self, middle=middle, crowd=crowd) for crowd in KNOT_SPACINGS]
        return [one for one in others if one != self]

    @property
    def knots(self) -> Array:
        """Where its knots are, shape (knots,)."""
        place = np.linspace(-1.0, 1.0, KNOTS)
        share = place * self.crowd / (1.0 + self.crowd - np.abs(place))
        return np.asarray(self.middle + share * np.where(share > 0.0, self.high - self.middle, self.middle - self.low))

    def along(self, at: Array) -> Array:
        """Return what each knot's height adds to the curve's at some points of its range, shape (points, knots)."""
        at = np.clip(at, self.low, self.high)
        share = (at - self.middle) / np.where(at > self.middle, self.high - self.middle, self.middle - self.low)
        place = 0.5 * (KNOTS - 1) * (1.0 + share * (1.0 + self.crowd) / (np.abs(share) + self.crowd))
        return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(KNOTS)), 0.0))


def slots(candidates: Candidates, begin: Candidate) -> list[CurvePlace]:
    """Return all places for a curve beside a model, over what the recordings have visited."""
    ranges, curve = ranges_of(candidates, begin), candidates.channel.curve
    noise = math.sqrt(begin.rss / candidates.train.samples)
    most = {name: max(map(abs, ends)) for name, ends in ranges.items()}
    units = candidates.channel.characteristic_units(candidates.train.experiments, begin.model, noise, most)
    found = []
    for against, places in curve.asked.items():
        low, high = ranges[against]
        if high - low <= LEAST_VISITED_RANGE:
            continue
        for enters in filter(units.__contains__, places):
            memories = curve.memories.get((enters, against), (curve.memory,))
            both_ways = KNOT_SPACINGS[:1] if len(memories) > 1 else KNOT_SPACINGS
            crowds = both_ways if against in curve.both_ways else curve.crowds
            found += [
                CurvePlace(enters, against, memory, low, high, 0.5 * (low + high), crowd, units[enters], curve)
                for memory, crowd in product(memories, crowds)
            ]
    return found


def ranges_of(candidates: Candidates, begin: Candidate, share: float = OUTLIER_SHARE) -> dict[str, tuple[float, float]]:
    """
    Return what the train and validation parts have visited of each variable; of speeds the same both ways.

    A `share` of the samples at either end does not count, but of variables without outliers.
    """
    curve = candidates.channel.curve
    seen: dict[str, list[Array]] = {name: [] for name in curve.against}
    for one, simulated in zip(candidates.learn.experiments, begin.simulated):
        for name, values in candidates.channel.variables(one, simulated, begin.model).items():
            end = 0.0 if name in curve.whole else share
            seen[name].append(np.quantile(values, (end, 1.0 - end)))
    ranges = {name: (float(np.min(ends)), float(np.max(ends))) for name, ends in seen.items()}
    for name in curve.both_ways:
        most = max(map(abs, ranges[name]))
        ranges[name] = -most, most
    return ranges
