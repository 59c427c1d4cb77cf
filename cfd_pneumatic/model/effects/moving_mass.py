# SPDX-License-Identifier: Apache-2.0
"""
Moving mass: what inertia and weight of the moving parts take from the air's force.

At an inclination that never changes the weight is a constant, which no recording tells from the force sensor's offset:
the inclination is given, not searched.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import LOADS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""


@inlined
def force(value, moment, mass, inclination):
    """Return the contact force [N], less inertia and weight."""
    return value - mass * (moment.acceleration + GRAVITY * math.sin(inclination))


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a mass whose inertia is the residual's size, level."""
    return [(data['residual'] / data['largest_acceleration'], 0.0)]


def as_constant(offset: float) -> tuple[float, ...]:
    """Return the mass that on the steepest incline weighs as much, level."""
    return abs(offset) / GRAVITY, 0.0


EFFECT = Effect(
    name='moving_mass',
    description='inertia and weight of what moves between air and force sensor',
    parameters=(
        EffectParameter('mass', 'kg', 0.0, 100.0, 0.0, 'of what moves'),
        EffectParameter('inclination', 'rad', -1.6, 1.6, 0.0, 'of +x above the horizontal', choice=True),
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
