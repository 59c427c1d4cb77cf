"""
Stribeck friction: what slowly moving seals rub beyond seal friction, as they have to be broken away first.

A smooth bump over the speed, as drive simulations have it: it is odd, so that it vanishes at rest, where presliding has
its place. It is largest at the given speed, and gone at three times of it.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import FRICTIONS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel


@kernel
def force(value, moment, breakaway, speed):
    """Return the contact force [N], less what slow seals hold back."""
    share = moment.rate / speed
    return value - breakaway * share * math.exp(0.5 - 0.5 * share * share)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return friction of half the residual's size at a slow speed and at a medium one."""
    return [(0.5 * data['force_residual'], share * data['largest_speed']) for share in (0.03, 0.3)]


EFFECT = Effect(
    name='stribeck_friction',
    description='slow seals rub more than fast ones',
    parameters=(
        EffectParameter('breakaway', 'N', 0.0, 1e3, 0.0, 'largest excess over seal friction'),
        EffectParameter('speed', 'm/s', 1e-5, 1.0, 1e-2, 'speed at which it is largest', logarithmic=True),
    ),
    equations=(r"F' = F - breakaway\,\frac{\dot x}{speed} \exp\frac{1 - (\dot x / speed)^2}{2}",),
    starts=starts,
    shown_by='strokes at several speeds, from very slow to fast',
    seen_against='speed',
    families=(FRICTIONS,),
    rank=40,
)
