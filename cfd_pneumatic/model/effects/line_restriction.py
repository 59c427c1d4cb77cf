"""Line restriction: a laminar resistance between the regulator, with its outlet's volume, and the cylinder."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel

NONE = 1e-5
"""Resistance below which there is none [s]."""

QUICKEST = 3e-4
"""Time in which the outlet's volume fills at least; below, it is as good as filled at once [s]."""


@kernel
def evolve(moment, valves, regulator, resistance, volume):
    """Return the rate of the pressure at the regulator's outlet [Pa/s]."""
    if resistance < NONE:
        return (0.0,)
    passes = (regulator - moment.p) / resistance
    return ((valves - passes) / max(volume, QUICKEST / resistance),)


@kernel
def flow(valves, moment, regulator, resistance, volume):
    """Return the pressure rate that the flow through the line makes [Pa/s]."""
    return valves if resistance < NONE else (regulator - moment.p) / resistance


@kernel
def outlet(p, moment, valves, regulator, resistance, volume):
    """Return the pressure at the regulator's outlet [Pa]."""
    return p if resistance < NONE else regulator


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return resistances that matter beside the regulator's own, and a small outlet."""
    return [(0.05 / data['k_sv'], 0.05), (0.5 / data['k_sv'], 0.05)]


def fastest(resistance: float, volume: float) -> float:
    """Return the inverse of the time in which the outlet's volume fills [1/s]."""
    return 0.0 if resistance < NONE else 1.0 / max(volume * resistance, QUICKEST)


EFFECT = Effect(
    name='line_restriction',
    description='laminar resistance between the regulator and the cylinder',
    parameters=(
        EffectParameter(
            'resistance', 's', 0.0, 1.0, 0.0, 'pressure drop for each unit of the rate that the flow makes'
        ),
        EffectParameter('volume', '-', 1e-3, 1.0, 0.05, "of the regulator's outlet, in chambers", logarithmic=True),
    ),
    starts=starts,
    shown_by='large steps of the set-point, up and down',
    fastest=fastest,
    states=1,
    follows='flow',
    rests_at_pressure=True,
    rank=80,
)
