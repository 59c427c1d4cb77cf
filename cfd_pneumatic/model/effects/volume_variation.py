# SPDX-License-Identifier: Apache-2.0
"""Volume variation: the volume V = V0 + A x changes all gains."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import STIFFNESS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined

SMALLEST = 0.05
"""Least volume / volume at x = 0 [-]."""


@inlined
def velocity_gain(k_x, moment, slope):
    """Return K_x [Pa/m] at the piston's present position: the constant `k_x` over the relative volume."""
    return k_x / max(1.0 + slope * moment.x, SMALLEST)


@inlined
def flow(value, moment, slope):
    """Return the pressure rate of the flow [Pa/s], inverse to the volume."""
    return value / max(1.0 + slope * moment.x, SMALLEST)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return slopes by which the stroke changes the volume by a quarter, of either sign."""
    stroke = data['x_high'] - data['x_low']
    return [(0.25 / stroke,), (-0.25 / stroke,)]


def quickens(pressure: float, x: float, k_x: float, slope: float) -> float:
    """Return the factor of the gains at a displacement [m]."""
    return 1.0 / max(1.0 + slope * x, SMALLEST)


EFFECT = Effect(
    name='volume_variation',
    description="the chamber's volume changes with displacement, and all gains with it",
    inspect='the dead volume of chamber and line, and the zero of the displacement',
    parameters=(EffectParameter('slope', '1/m', -1e3, 1e3, 0.0, 'A / V0: change of volume with displacement'),),
    equations=(r"K' = \frac{K}{\max(1 + slope\,x,\,0.05)}, \qquad K = K_x, K_{sv}, K_v",),
    starts=starts,
    shown_by='strokes over the whole travel',
    seen_against='displacement',
    families=(STIFFNESS,),
    quickens=quickens,
    rank=20,
)
