# SPDX-License-Identifier: Apache-2.0
"""
Stribeck friction: additional friction of slowly moving seals, which have to break away first.

The friction decreases with the speed as a Gaussian (Armstrong-Hélouvry et al., 1994). It reverses after a reversal of
the motion as seal friction does.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import FRICTIONS, Data, Effect, EffectParameter
from cfd_pneumatic.model.effects.seal_friction import stretched
from cfd_pneumatic.model.kernels import inlined


@inlined
def force(value, moment, stretch, breakaway, speed, presliding):
    """Return the contact force without the additional friction of slow seals [N]."""
    share = moment.rate / speed
    return value - breakaway * stretch * math.exp(-share * share)


@inlined
def slide(travel, stretch, breakaway, speed, presliding):
    """Return the seal's stretch, -1 to 1."""
    return (stretched(travel, stretch, presliding),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return frictions of the residual's size up to a slow or a medium speed, with short or long presliding."""
    size, fast = data['residual'], data['largest_speed']
    return [(size, share * fast, presliding) for share in (0.03, 0.3) for presliding in (2e-5, 2e-4)]


EFFECT = Effect(
    name='stribeck_friction',
    description='slow seals have more friction than fast seals',
    inspect='the piston seal and the lubrication',
    parameters=(
        EffectParameter('breakaway', 'N', 0.0, 1e3, 0.0, 'friction in addition to seal friction at zero speed'),
        EffectParameter(
            'speed',
            'm/s',
            1e-5,
            1.0,
            1e-2,
            'speed at which the additional friction has fallen to 1 / e',
            logarithmic=True,
        ),
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction reverses', logarithmic=True
        ),
    ),
    equations=(
        r"F' = F - breakaway\,z\,\exp\left(-(\dot x / speed)^2\right)",
        r'\frac{dz}{d|x|} = \frac{\mathrm{sgn}\, \dot x - z}{presliding}',
    ),
    starts=starts,
    shown_by='strokes at several speeds, from very slow to fast',
    seen_against='speed',
    families=(FRICTIONS,),
    states=1,
    follows='motion',
    rank=40,
)
