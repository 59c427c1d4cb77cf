"""Transport delay: dead time of pressure against displacement."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return delays of a sample, either way."""
    return [(data['period'],), (-data['period'],)]


EFFECT = Effect(
    name='transport_delay',
    description='dead time of the pressure against the displacement, either sign',
    parameters=(EffectParameter('delay', 's', -0.5, 0.5, 0.0, 'by which the pressure comes later'),),
    starts=starts,
    delays=True,
)
