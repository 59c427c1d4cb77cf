# SPDX-License-Identifier: Apache-2.0
"""Transport delay: the pressure is recorded late, or all other signals are."""

from __future__ import annotations

from cfd_pneumatic.model.effects.displacement_delay import SHORTEST
from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the delay of best agreement with the simulated pressure, and a sample period of either sign."""
    return [(data['lag'],), (data['period'],), (-data['period'],)]


EFFECT = Effect(
    name='transport_delay',
    description='dead time of the pressure relative to displacement and set-point, of either sign',
    inspect='the clocks and filters of the pressure and displacement signals',
    parameters=(EffectParameter('delay', 's', -SHORTEST, 0.5, 0.0, 'delay of the recorded pressure'),),
    equations=(r's(t) = p(t - delay)',),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='pressure rate',
    families=(DELAYS,),
    late='reading',
)
