# SPDX-License-Identifier: Apache-2.0
"""Transport delay: the pressure is read late, or all else is."""

from __future__ import annotations

from cfd_pneumatic.model.effects.displacement_delay import SHORTEST
from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the delay at which the pressure looks most like the simulated one, and a sample either way."""
    return [(data['lag'],), (data['period'],), (-data['period'],)]


EFFECT = Effect(
    name='transport_delay',
    description='dead time of the pressure against displacement and set-point, either sign',
    parameters=(EffectParameter('delay', 's', -SHORTEST, 0.5, 0.0, 'by which the pressure is read later'),),
    equations=(r's(t) = p(t - delay)',),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='pressure rate',
    families=(DELAYS,),
    late='reading',
)
