# SPDX-License-Identifier: Apache-2.0
"""Line restriction: a laminar resistance between the volume of the regulator's outlet and the cylinder."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

NONE = 1e-5
"""A lower resistance counts as none [s]."""

QUICKEST = 3e-4
"""
Shortest time constant of the outlet's pressure [s].

A shorter time constant is raised to this value; the settled pressure and the mass of air in the outlet stay exact.
"""


@inlined
def evolve(moment, valves, drop, resistance, volume):
    """Return the rate of the pressure drop along the line [Pa/s]."""
    both = 1.0 + volume
    settled = resistance * (valves + volume * moment.swept) / both
    rate = (settled - drop) / max(volume * resistance / both, QUICKEST)
    return (where(resistance < NONE, 0.0, rate),)


@inlined
def flow(valves, moment, drop, resistance, volume):
    """Return the pressure rate of the flow through the line [Pa/s]; the outlet's volume stores the difference."""
    (rate,) = evolve(moment, valves, drop, resistance, volume)
    through = (valves + volume * (moment.swept - rate)) / (1.0 + volume)
    return where(resistance < NONE, valves, through)


@inlined
def outlet(p, moment, valves, drop, resistance, volume):
    """Return the pressure at the regulator's outlet [Pa]."""
    return p + drop


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return resistances comparable with the regulator's, and a small outlet."""
    return [(0.05 / data['k_sv'], 0.05), (0.5 / data['k_sv'], 0.05)]


def fastest(speed: float, resistance: float, volume: float) -> float:
    """Return the inverse of the drop's time constant [1/s]."""
    return 0.0 if resistance < NONE else 1.0 / max(volume * resistance / (1.0 + volume), QUICKEST)


EFFECT = Effect(
    name='line_restriction',
    description='laminar resistance between the regulator and the cylinder',
    inspect='the line between regulator and cylinder: length, diameter, kinks',
    parameters=(
        EffectParameter('resistance', 's', 0.0, 1.0, 0.0, "pressure drop for each unit of the flow's pressure rate"),
        EffectParameter(
            'volume', '-', 1e-3, 1.0, 0.05, "volume of the regulator's outlet / volume of the chamber", logarithmic=True
        ),
    ),
    equations=(
        r"p_r = p + \Delta, \qquad q' = \frac{q + volume\,(K_x \dot x - \dot\Delta)}{1 + volume}",
        r'volume\;resistance\;\dot\Delta = resistance\,(q + volume\,K_x \dot x) - (1 + volume)\,\Delta',
    ),
    starts=starts,
    shown_by='large steps of the set-point, up and down',
    seen_against='pressure rate',
    families=(DELAYS,),
    fastest=fastest,
    states=1,
    follows='flow',
    rank=80,
)
