# SPDX-License-Identifier: Apache-2.0
"""Flow saturation: the largest flow of the valves is limited, with separate limits for charge and exhaust."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def flow(value, moment, charge, exhaust):
    """Return the pressure rate of the flow [Pa/s]."""
    return min(max(value, -exhaust), charge)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return limits at shares of the largest flow: of charge, of exhaust, and of both."""
    charge, exhaust = data['largest_charge'], data['largest_exhaust']
    return [
        *((0.7 * charge, NEVER), (0.4 * charge, NEVER)),
        *((NEVER, 0.7 * exhaust), (NEVER, 0.4 * exhaust)),
        *((0.6 * charge, 0.6 * exhaust),),
    ]


NEVER = 1e9
"""A limit that no flow reaches [Pa/s]."""

EFFECT = Effect(
    name='flow_saturation',
    description='the largest flow is limited, separately for charging and exhausting',
    inspect='the supply pressure, the size of the valves and the silencer',
    parameters=(
        EffectParameter('charge', 'Pa/s', 1.0, NEVER, NEVER, 'largest rate while charging', logarithmic=True),
        EffectParameter('exhaust', 'Pa/s', 1.0, NEVER, NEVER, 'largest rate while exhausting', logarithmic=True),
    ),
    equations=(r"q' = \min(\max(q, -exhaust), charge)",),
    starts=starts,
    shown_by='large steps of the set-point, up and down',
    seen_against='pressure rate',
    rank=5,
)
