# SPDX-License-Identifier: Apache-2.0
"""
Stribeck friction: what slowly moving seals rub beyond seal friction, as they have to be broken away first.

It falls with the speed as a Gaussian does (Armstrong-Hélouvry et al., 1994), and turns round after a reversal as seal
friction does.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import FRICTIONS, Data, Effect, EffectParameter
from cfd_pneumatic.model.effects.seal_friction import stretched
from cfd_pneumatic.model.kernels import inlined


@inlined
def force(value, moment, stretch, breakaway, speed, presliding):
    """Return the contact force [N], less what slow seals hold back."""
    share = moment.rate / speed
    return value - breakaway * stretch * math.exp(-share * share)


@inlined
def slide(travel, stretch, breakaway, speed, presliding):
    """Return the seal's stretch, -1 to 1."""
    return (stretched(travel, stretch, presliding),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return friction of the residual's size up to a slow speed or a medium one, that turns round at once or not."""
    size, fast = data['residual'], data['largest_speed']
    return [(size, share * fast, presliding) for share in (0.03, 0.3) for presliding in (2e-5, 2e-4)]


EFFECT = Effect(
    name='stribeck_friction',
    description='slow seals rub more than fast ones',
    parameters=(
        EffectParameter('breakaway', 'N', 0.0, 1e3, 0.0, 'excess over seal friction where the piston hardly moves'),
        EffectParameter('speed', 'm/s', 1e-5, 1.0, 1e-2, 'speed at which it has fallen to 1 / e', logarithmic=True),
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction turns round', logarithmic=True
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
