# SPDX-License-Identifier: Apache-2.0
"""Displacement delay: the displacement is reported late."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined

SHORTEST = 0.02
"""Shortest searched delay [s]. A shorter delay may come from the pressure's clock: a negative `transport_delay`."""

_FILTER_DELAYS = (0.05, 0.1)  # of usual filters [s]; a search does not converge from distant starting values


@inlined
def displacement(x, moment, delay):
    """Return the piston's displacement, extrapolated over the delay at the present speed [m]."""
    return x + delay * moment.rate


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return delays of usual averaging filters."""
    return [(delay,) for delay in _FILTER_DELAYS]


EFFECT = Effect(
    name='displacement_delay',
    description='the displacement is reported late, by a filter or the clock of its sensor',
    inspect='the filter and the clock of the displacement sensor',
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
