# SPDX-License-Identifier: Apache-2.0
"""
Moving mass: inertia and weight of the moving parts, which reduce the contact force.

The inclination is given and not searched. At a constant inclination a recording cannot distinguish the weight from the
force sensor's offset.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import LOADS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""


@inlined
def force(value, moment, mass, inclination):
    """Return the contact force without inertia and weight [N]."""
    return value - mass * (moment.acceleration + GRAVITY * math.sin(inclination))


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a mass with an inertia of the residual's size, at no inclination."""
    return [(data['residual'] / data['largest_acceleration'], 0.0)]


def as_constant(offset: float) -> tuple[float, ...]:
    """Return the mass with a weight equal to an offset [N], at no inclination."""
    return abs(offset) / GRAVITY, 0.0


EFFECT = Effect(
    name='moving_mass',
    description='inertia and weight of the parts that move between air and force sensor',
    inspect='the mass of the parts between air and force sensor, and the mounting angle',
    parameters=(
        EffectParameter('mass', 'kg', 0.0, 100.0, 0.0, 'mass of the moving parts'),
        EffectParameter('inclination', 'rad', -1.6, 1.6, 0.0, 'angle of +x above the horizontal', choice=True),
    ),
    equations=(r"F' = F - mass\,(\ddot x + g \sin(inclination))",),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='acceleration',
    families=(LOADS,),
    as_constant=as_constant,
    rank=20,
)
