# SPDX-License-Identifier: Apache-2.0
"""Droop: the regulated pressure sags under flow, with a lag. Without a lag the sag would be part of K."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, OFFSETS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def setpoint(p_d, moment, lagged_flow, slope, lag):
    """Return the set-point that acts [Pa]."""
    return p_d - slope * lagged_flow


@inlined
def evolve(moment, flow, lagged_flow, slope, lag):
    """Return the rate of the lagged flow [Pa/s^2]."""
    return ((flow - lagged_flow) / lag,)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return droops that are slower than the regulator."""
    settling = 1.0 / data['k_sv']
    return [(0.3 * settling, 10.0 * settling), (0.3 * settling, 50.0 * settling)]


def fastest(speed: float, slope: float, lag: float) -> float:
    """Return the inverse of the lag [1/s]."""
    return 1.0 / lag


EFFECT = Effect(
    name='droop',
    description='the regulated pressure sags under flow, with a lag',
    inspect='the supply line and the regulator: either may be too small',
    parameters=(
        EffectParameter('slope', 's', 0.0, 10.0, 0.0, "sag for each unit of the flow's pressure rate"),
        EffectParameter('lag', 's', 1e-3, 1e2, 1.0, 'time constant', logarithmic=True),
    ),
    equations=(r"p_d' = p_d - slope\,\bar q", r'lag\,\dot{\bar q} = q - \bar q'),
    starts=starts,
    shown_by='large steps of the set-point, up and down',
    seen_against='pressure rate',
    families=(DELAYS, OFFSETS),
    fastest=fastest,
    states=1,
    follows='flow',
    rank=50,
)
