# SPDX-License-Identifier: Apache-2.0
"""Valve hysteresis: the valves follow the error with play."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import PLAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def error(value, moment, play, width):
    """Return the error [Pa] that reaches the valves; it becomes the play's state at the end of a step."""
    return min(max(play, value - width), value + width)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return plays as wide as the residual and wider."""
    return [(data['residual'],), (3.0 * data['residual'],)]


EFFECT = Effect(
    name='valve_hysteresis',
    description='the valves follow the error with play',
    parameters=(EffectParameter('width', 'Pa', 0.0, 1e5, 0.0, 'half width of the play'),),
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
