# SPDX-License-Identifier: Apache-2.0
"""Texts of a plan for people, for the terminal and the page."""

from __future__ import annotations

from itertools import groupby

from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.planning.prediction import EffectPrediction, Planned


def segment_texts(plan: Planned) -> list[str]:
    """Return the names of the segments of a round, with a count for equal adjacent segments."""
    groups = groupby(plan.segments, key=lambda segment: segment.name)
    counted = [(name, len(list(segments))) for name, segments in groups]
    return [name if count == 1 else f'{count} times {name}' for name, count in counted]


def smallest_strength_text(prediction: EffectPrediction) -> str:
    """Return the strength from which an effect is detectable, as text."""
    if not prediction.smallest:
        return '' if prediction.smallest is None else 'any strength'
    units = {parameter.name: parameter.unit for parameter in EFFECTS[prediction.effect].parameters}
    return ', '.join(f'{name} {value:.2g} {units[name]}' for name, value in prediction.smallest.items())
