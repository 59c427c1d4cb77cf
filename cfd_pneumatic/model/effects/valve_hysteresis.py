# SPDX-License-Identifier: Apache-2.0
"""Valve hysteresis: the valves follow the error with backlash."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import PLAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def error(value, moment, followed, width):
    """Return the error that moves the valves [Pa], which becomes the state of the backlash at the end of a step."""
    return min(max(followed, value - width), value + width)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return backlashes of one and three times the residual's size."""
    return [(data['residual'],), (3.0 * data['residual'],)]


EFFECT = Effect(
    name='valve_hysteresis',
    description='the valves follow the error with backlash',
    inspect='the valves of the regulator: stiction and dirt',
    parameters=(EffectParameter('width', 'Pa', 0.0, 1e5, 0.0, 'half width of the backlash'),),
    equations=(r"e' \leftarrow \min(\max(e', e - width), e + width)",),
    starts=starts,
    shown_by='many small strokes with reversals',
    seen_against='valve error',
    families=(PLAYS,),
    states=1,
    follows='error',
    rests_anywhere=True,
    rank=40,
)
