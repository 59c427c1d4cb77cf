# SPDX-License-Identifier: Apache-2.0
"""Compose a schedule from segments: each step adds the segment with the most information per time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.planning.evidence import Evidence
from cfd_pneumatic.planning.family import Move, Segment
from cfd_pneumatic.planning.proposal import Drawing
from cfd_pneumatic.planning.signatures import Signatures

PRECISION = 0.01
"""Target for the standard error of a parameter, as a share of its value."""

ROUNDS = 5
"""Least number of rounds, so that each part of a 60/20/20 split contains a whole round."""

LONGEST_ROUND = 24.0
"""Longest round [s]; it has time for all useful segments, and a longer schedule repeats the round."""


@dataclass(frozen=True)
class Menu:
    """
    Candidate segments and their information.

    Attributes
    ----------
    segments
        Candidates.
    lengths
        Number of samples of each segment.
    signatures
        Signatures of each channel, over all segments in succession.
    products
        Scalar products of the signatures for each channel, over each segment, shape (segments, k, k).

    """

    segments: tuple[Segment, ...]
    lengths: tuple[int, ...]
    signatures: tuple[Signatures, ...]
    products: tuple[Array, ...]

    @classmethod
    def from_signatures(cls, segments: Sequence[Segment], drawing: Drawing, signatures: Sequence[Signatures]) -> Menu:
        """Return the candidate segments of an experiment plan, each with the information that it would give."""
        lengths = tuple(drawing.duration(segment) for segment in segments)
        end = len(signatures[0].columns)
        begins = end - np.cumsum(lengths[::-1])[::-1]
        parts = [slice(begin, begin + length) for begin, length in zip(begins.tolist(), lengths)]
        products = tuple(np.stack([channel.products(part) for part in parts]) for channel in signatures)
        return cls(tuple(segments), lengths, tuple(signatures), products)


def compose(menu: Menu, samples: int, rounds: int, wanted: Collection[str]) -> tuple[Segment, ...]:
    """
    Return the segments of a round; empty if no segment with a stroke fits.

    Parameters
    ----------
    menu
        Candidate segments.
    samples
        Largest number of samples of a round.
    rounds
        Number of rounds.
    wanted
        Names of the parameters and effects of interest.

    """
    total = [np.zeros_like(products[0]) for products in menu.products]
    chosen: list[Segment] = []
    remaining = samples
    lacking = float('inf')
    while True:
        fitting = [
            index
            for index, segment in enumerate(menu.segments)
            if menu.lengths[index] <= remaining and (chosen or _moves(segment))
        ]
        if not fitting:
            return tuple(chosen)
        lacks = {}
        for index in fitting:
            products = [rounds * (channel + added[index]) for channel, added in zip(total, menu.products)]
            evidence = [
                Evidence(signatures, channel, rounds * samples)
                for signatures, channel in zip(menu.signatures, products)
            ]
            lacks[index] = missing_information(evidence, wanted)
        if not chosen:  # the first segment has no reference
            lacking = max(lacks.values())
        best = max(fitting, key=lambda index: (lacking - lacks[index]) / menu.lengths[index])
        chosen.append(menu.segments[best])
        total = [channel + added[best] for channel, added in zip(total, menu.products)]
        remaining -= menu.lengths[best]
        lacking = lacks[best]


def _moves(segment: Segment) -> bool:
    return any(isinstance(step, Move) and step.to > 0.1 for step in segment.steps)


def missing_information(evidence: Sequence[Evidence], wanted: Collection[str]) -> float:
    """
    Return how much information about the wanted parameters and effects is missing [1].

    The terms are the precision of each parameter, the visibility of each effect and its distinctness from all other
    effects. A term is 1 without information, 0.5 with just enough, and almost 0 with much information, so that large
    gaps have the largest weight.
    """
    total = 0.0
    for channel in evidence:
        for name, std in zip(channel.signatures.fitted, channel.stds.tolist()):
            if name in wanted:
                total += 1.0 - 1.0 / (1.0 + (std / PRECISION) ** 2)
        for effect in channel.effects:
            if effect in wanted and not EFFECTS[effect].of_time:
                total += float(np.mean(1.0 / (1.0 + channel.visibility[effect] ** 2)))
                distinctness = channel.distinctness(effect).items()
                rivals = [values for rival, values in distinctness if not EFFECTS[rival].of_time]
                if rivals:
                    total += float(np.mean(1.0 / (1.0 + np.maximum(np.concatenate(rivals), 0.0))))
    return total
