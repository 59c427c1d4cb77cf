# SPDX-License-Identifier: Apache-2.0
"""Displacement delay: the displacement is reported late."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined

SHORTEST = 0.02
"""What is less may be a matter of the pressure's clock: that is what `transport_delay` says below zero [s]."""

_OF_FILTERS = (0.05, 0.1)  # that a search starts from: too far off, none finds its way [s]


@inlined
def displacement(x, moment, delay):
    """Return the piston's displacement [m], as far as its speed tells what is not reported yet."""
    return x + delay * moment.rate


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return what sensors take that average."""
    return [(delay,) for delay in _OF_FILTERS]


EFFECT = Effect(
    name='displacement_delay',
    description='the displacement is reported late, by a filter or the clock of its sensor',
    parameters=(EffectParameter('delay', 's', 0.0, 0.5, 0.0, 'dead time', least=SHORTEST),),
    equations=(r"x'(t) = x(t + delay)",),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='pressure rate',
    families=(DELAYS,),
    late='displacement',
    rank=40,
)
