# SPDX-License-Identifier: Apache-2.0
"""Which segments a schedule is put together from: always the one next that lets the most be told for its time."""

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
"""Standard error that is wanted of a parameter, as a share of its value."""

ROUNDS = 5
"""How often everything is done at least, so that each part of a 60/20/20 split holds all of it."""

LONGEST_ROUND = 24.0
"""Of what is composed [s]: it holds what is worth doing, and is done more often in a longer schedule."""


@dataclass(frozen=True)
class Menu:
    """
    What may be chosen, and what it tells.

    Attributes
    ----------
    segments
        To choose from.
    lengths
        How many samples each takes.
    signatures
        Of each channel, of all segments one after the other.
    products
        Their scalar products for each channel, over each segment, shape (segments, k, k).

    """

    segments: tuple[Segment, ...]
    lengths: tuple[int, ...]
    signatures: tuple[Signatures, ...]
    products: tuple[Array, ...]

    @classmethod
    def of(cls, segments: Sequence[Segment], drawing: Drawing, signatures: Sequence[Signatures]) -> Menu:
        """Return the menu from the signatures of all segments drawn in their order."""
        lengths = tuple(drawing.duration(one) for one in segments)
        end = len(signatures[0].columns)
        begins = end - np.cumsum(lengths[::-1])[::-1]
        parts = [slice(begin, begin + length) for begin, length in zip(begins.tolist(), lengths)]
        products = tuple(np.stack([one.products(part) for part in parts]) for one in signatures)
        return cls(tuple(segments), lengths, tuple(signatures), products)


def compose(menu: Menu, samples: int, rounds: int, wanted: Collection[str]) -> tuple[Segment, ...]:
    """
    Return segments for one round of some samples; none where not even one with a stroke fits.

    Parameters
    ----------
    menu
        What to choose from.
    samples
        That a round may take.
    rounds
        How often it will be done.
    wanted
        Names of parameters and effects.

    """
    total = [np.zeros_like(one[0]) for one in menu.products]
    chosen: list[Segment] = []
    left = samples
    lacking = float('inf')
    while True:
        fitting = [
            index
            for index, segment in enumerate(menu.segments)
            if menu.lengths[index] <= left and (chosen or _moves(segment))
        ]
        if not fitting:
            return tuple(chosen)
        lacks = {}
        for index in fitting:
            products = [rounds * (one + own[index]) for one, own in zip(total, menu.products)]
            evidence = [Evidence(one, own, rounds * samples) for one, own in zip(menu.signatures, products)]
            lacks[index] = lack(evidence, wanted)
        if not chosen:  # nothing is known before the first one
            lacking = max(lacks.values())
        best = max(fitting, key=lambda index: (lacking - lacks[index]) / menu.lengths[index])
        chosen.append(menu.segments[best])
        total = [one + own[best] for one, own in zip(total, menu.products)]
        left -= menu.lengths[best]
        lacking = lacks[best]


def _moves(segment: Segment) -> bool:
    return any(isinstance(step, Move) and step.to > 0.1 for step in segment.steps)


def lack(evidence: Sequence[Evidence], wanted: Collection[str]) -> float:
    """
    Return how much of what is wanted is not told.

    A parameter, an effect's showing and its being told from all others count one each while nothing is known, a half
    where just enough is, and next to nothing where much is: what lacks most is worth most.
    """
    total = 0.0
    for one in evidence:
        for name, std in zip(one.signatures.own, one.stds.tolist()):
            if name in wanted:
                total += 1.0 - 1.0 / (1.0 + (std / PRECISION) ** 2)
        for effect in one.effects:
            if effect in wanted and not EFFECTS[effect].of_time:
                total += float(np.mean(1.0 / (1.0 + one.visibility[effect] ** 2)))
                rivals = [own for other, own in one.distinctness(effect).items() if not EFFECTS[other].of_time]
                if rivals:
                    total += float(np.mean(1.0 / (1.0 + np.maximum(np.concatenate(rivals), 0.0))))
    return total
