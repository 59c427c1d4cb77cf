# SPDX-License-Identifier: Apache-2.0
"""Set-point delay: the set-point acts a dead time after the command."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a delay of a sample period, and the delay of the pressure behind the steps of the set-point."""
    return [(delay,) for delay in dict.fromkeys((data['period'], max(data['setpoint_lag'], data['period'])))]


EFFECT = Effect(
    name='setpoint_delay',
    description='dead time between the commanded and the acting set-point',
    inspect='the bus and the controller that command the regulator',
    parameters=(EffectParameter('delay', 's', 0.0, 0.5, 0.0, 'dead time'),),
    equations=(r"p_d'(t) = p_d(t - delay)",),
    starts=starts,
    shown_by='set-point steps',
    seen_against='valve error',
    families=(DELAYS,),
    late='setpoint',
)
