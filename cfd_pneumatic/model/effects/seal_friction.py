# SPDX-License-Identifier: Apache-2.0
"""
Seal friction: Coulomb friction that grows with pressure, viscous friction, and presliding after a reversal (Dahl).

The gauge pressure of a cylinder presses its seal; the friction therefore depends on the sum of both gauge pressures.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import FRICTIONS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def force(value, moment, stretch, coulomb, per_pressure, viscous, presliding):
    """Return the contact force without the friction of the seals [N]."""
    gauge = moment.p - moment.ambient + moment.opposing - moment.ambient
    return value - max(coulomb + per_pressure * gauge, 0.0) * stretch - viscous * moment.rate


@inlined
def stretched(travel, stretch, presliding):
    """Return a seal's stretch, -1 to 1, after a travel in one direction; exact, because Dahl's model is linear."""
    direction = math.copysign(1.0, travel)
    return direction + (stretch - direction) * math.exp(-abs(travel) / presliding)


@inlined
def slide(travel, stretch, coulomb, per_pressure, viscous, presliding):
    """Return the seal's stretch, -1 to 1."""
    return (stretched(travel, stretch, presliding),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return frictions of the residual's size, half of it from pressure, with a short and a long presliding."""
    half = 0.5 * data['residual']
    return [(half, half / data['gauge'], 0.0, presliding) for presliding in (5e-5, 5e-4)]


EFFECT = Effect(
    name='seal_friction',
    description='friction of the seals: Coulomb friction affine in gauge pressure, viscous friction, presliding',
    inspect='the piston seal and the lubrication',
    parameters=(
        EffectParameter('coulomb', 'N', 0.0, 1e3, 0.0, 'Coulomb friction without pressure'),
        EffectParameter(
            'per_pressure',
            'N/Pa',
            0.0,
            1e-2,
            0.0,
            'Coulomb friction for each pascal of gauge pressure',
            of_pressure=True,
        ),
        EffectParameter('viscous', 'N s/m', 0.0, 1e4, 0.0, 'friction for each metre per second'),
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction reverses', logarithmic=True
        ),
    ),
    equations=(
        r"F' = F - \max(coulomb + per_pressure\,(p_A + p_B - 2 p_0), 0)\,z - viscous\,\dot x",
        r'\frac{dz}{d|x|} = \frac{\mathrm{sgn}\, \dot x - z}{presliding}',
    ),
    starts=starts,
    shown_by='slow strokes with reversals, at two set-points well apart',
    seen_against='speed',
    families=(FRICTIONS,),
    states=1,
    follows='motion',
    rank=30,
)
