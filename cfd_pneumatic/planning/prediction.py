# SPDX-License-Identifier: Apache-2.0
"""Define the predicted results of a schedule for each parameter and effect."""

from __future__ import annotations

from dataclasses import dataclass

from cfd_pneumatic.identification import LARGEST_RELATIVE_STD
from cfd_pneumatic.planning.family import Segment
from cfd_pneumatic.planning.proposal import Proposal


@dataclass(frozen=True)
class ParameterPrediction:
    """
    Predicted precision of a parameter.

    Attributes
    ----------
    channel
        Cylinder, or `force`.
    name, unit
        Name and unit of the parameter; `EFFECT.PARAMETER` for a parameter of an effect.
    value
        Value in the parameter file [unit].
    std
        Cramer-Rao bound of the standard error [unit]; None if the schedule does not determine the parameter.

    """

    channel: str
    name: str
    unit: str
    value: float
    std: float | None

    @property
    def identifiable(self) -> bool:
        """Whether `identify_bag` will report a value of the parameter."""
        return self.std is not None and self.std < LARGEST_RELATIVE_STD * abs(self.value)


@dataclass(frozen=True)
class EffectPrediction:
    """
    Predicted detectability of an effect.

    Attributes
    ----------
    channel
        Cylinder, or `force`.
    effect
        Name of the effect.
    shows
        Whether the least visible form is detectable at the strength from which a search starts.
    smallest
        Strength at which that form is just detectable, and its choices, by name of the parameter [its unit]. Empty if
        every strength is detectable; None if no strength is.
    alternatives
        Effects that are not distinguishable from the just detectable effect.
    nearest
        Most similar effect, and the share of the signature that the similar effect cannot compensate; None without
        other effects.

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
    A schedule and its predicted results.

    Attributes
    ----------
    proposal
        The schedule.
    segments
        Segments of a round.
    rounds
        Number of rounds.
    parameters, effects
        Predictions for the wanted parameters and effects.

    """

    proposal: Proposal
    segments: tuple[Segment, ...]
    rounds: int
    parameters: tuple[ParameterPrediction, ...]
    effects: tuple[EffectPrediction, ...]
