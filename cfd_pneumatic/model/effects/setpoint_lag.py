# SPDX-License-Identifier: Apache-2.0
"""Set-point lag: the acting set-point follows the command as a first-order lag."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where
from cfd_pneumatic.model.lanewise import exp

SHORTEST = 1e-4
"""A shorter time constant counts as none [s]."""


@inlined
def setpoint(p_d, moment, acting, lag):
    """Return the set-point that acts [Pa]."""
    return where(lag <= SHORTEST, p_d, acting)


@inlined
def follow(elapsed, p_d, acting, lag):
    """Return the acting set-point after any time at a constant command [Pa]."""
    return (p_d + (acting - p_d) * exp(-elapsed / lag),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a lag of a sample period, and the delay of the pressure behind the steps of the set-point."""
    return [(lag,) for lag in dict.fromkeys((data['period'], max(data['setpoint_lag'], data['period'])))]


def fastest(speed: float, lag: float) -> float:
    """Return the inverse of the lag [1/s]."""
    return 0.0 if lag <= SHORTEST else 1.0 / lag


EFFECT = Effect(
    name='setpoint_lag',
    description='the acting set-point follows the command as a first-order lag',
    inspect='the pilot valve or the electronics that turn the command into a set-point',
    parameters=(EffectParameter('lag', 's', SHORTEST, 1.0, SHORTEST, 'time constant', logarithmic=True),),
    equations=(r"lag\,\dot p_d' = p_d - p_d'",),
    starts=starts,
    shown_by='set-point steps',
    seen_against='valve error',
    families=(DELAYS,),
    fastest=fastest,
    states=1,
    follows='setpoint',
    rank=20,
)
