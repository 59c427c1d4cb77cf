# SPDX-License-Identifier: Apache-2.0
"""Valve dead band: neither valve opens until the error leaves a band."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import PLAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def error(value, moment, band):
    """Return the error outside the band, which opens a valve [Pa]."""
    return value - min(max(value, -band), band)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return bands of one and three times the residual's size."""
    return [(data['residual'],), (3.0 * data['residual'],)]


EFFECT = Effect(
    name='valve_dead_band',
    description='no flow while the error is within a band',
    inspect='the dead band of the regulator: its data sheet and dirt in its valves',
    parameters=(EffectParameter('band', 'Pa', 0.0, 1e5, 0.0, 'half width of the band'),),
    equations=(r"e' = e - \min(\max(e, -band), band)",),
    starts=starts,
    shown_by='strokes out and back, with a rest after each',
    seen_against='valve error',
    families=(PLAYS,),
    rests_anywhere=True,
    rank=60,
)
