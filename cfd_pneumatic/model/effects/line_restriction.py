"""Line restriction: a laminar resistance between valve and cylinder, so that the regulator senses the flow too."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel


@kernel
def outlet(p, moment, flow, resistance):
    """Return the pressure at the regulator's outlet [Pa]."""
    return p + resistance * flow


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return resistances that matter beside the regulator's own."""
    return [(0.1 / data['k_sv'],), (0.5 / data['k_sv'],)]


EFFECT = Effect(
    name='line_restriction',
    description='laminar resistance between valve and cylinder',
    parameters=(
        EffectParameter(
            'resistance', 's', 0.0, 1.0, 0.0, 'pressure drop for each unit of the rate that the flow makes'
        ),
    ),
    starts=starts,
)
