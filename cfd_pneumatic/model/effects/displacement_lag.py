# SPDX-License-Identifier: Apache-2.0
"""Displacement lag: the measured displacement lags the piston."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def displacement(x, moment, lag):
    """Return the piston's displacement [m]."""
    return x + lag * moment.rate


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a lag of one sample period and of four."""
    return [(data['period'],), (4.0 * data['period'],)]


EFFECT = Effect(
    name='displacement_lag',
    description='the displacement sensor is a first-order lag',
    inspect='the filter of the displacement sensor',
    parameters=(EffectParameter('lag', 's', 0.0, 1.0, 0.0, 'time constant'),),
    equations=(r"x' = x + lag\,\dot x",),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='pressure rate',
    families=(DELAYS,),
    looks_ahead=True,
    rank=40,
)
