# SPDX-License-Identifier: Apache-2.0
"""What a schedule will tell of each parameter and effect."""

from __future__ import annotations

from dataclasses import dataclass

from cfd_pneumatic.identification import LARGEST_RELATIVE_STD
from cfd_pneumatic.planning.family import Segment
from cfd_pneumatic.planning.proposal import Proposal


@dataclass(frozen=True)
class ParameterPrediction:
    """
    How well a parameter will be identified.

    Attributes
    ----------
    channel
        Cylinder, or `force`.
    name, unit
        Of the parameter; `EFFECT.PARAMETER` for an effect's.
    value
        In the parameter file [unit].
    std
        Cramer-Rao bound of its standard error [unit]; None where nothing tells it.

    """

    channel: str
    name: str
    unit: str
    value: float
    std: float | None

    @property
    def identifiable(self) -> bool:
        """Whether `identify_bag` will give it a value."""
        return self.std is not None and self.std < LARGEST_RELATIVE_STD * abs(self.value)


@dataclass(frozen=True)
class EffectPrediction:
    """
    Whether an effect would show.

    Attributes
    ----------
    channel
        Cylinder, or `force`.
    effect
        Its name.
    shows
        Whether it would, in the form that shows least, at the strength at which a search for it begins.
    smallest
        Strength at which that form just shows, and what is chosen in it, by the names of the parameters [their units];
        none where any strength shows, as of what does not vanish with it; None where nothing shows.
    alternatives
        Effects that it could not be told from while it just shows.
    nearest
        The other effect that is most like it, and the share of what it leaves that remains beside that one; None where
        there is no other.

    """

    channel: str
    effect: str
    shows: bool
    smallest: dict[str, float] | None
    alternatives: tuple[str, ...]
    nearest: tuple[str, float] | None


@dataclass(frozen=True)
class Planned:
    """
    A schedule and what it will tell.

    Attributes
    ----------
    proposal
        The schedule.
    segments
        Of one round.
    rounds
        How often it is done.
    parameters, effects
        Predictions of what was wanted.

    """

    proposal: Proposal
    segments: tuple[Segment, ...]
    rounds: int
    parameters: tuple[ParameterPrediction, ...]
    effects: tuple[EffectPrediction, ...]
