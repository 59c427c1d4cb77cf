# SPDX-License-Identifier: Apache-2.0
"""Force offset: the reading of the force sensor without load."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import LOADS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def force(value, moment, offset):
    """Return the reading of the force sensor [N]."""
    return value + offset


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the mean of the residual."""
    return [(data['mean'],)]


EFFECT = Effect(
    name='force_offset',
    description="the force sensor's zero is wrong",
    inspect='the zero of the force sensor and the weight that hangs on it',
    parameters=(EffectParameter('offset', 'N', -1e4, 1e4, 0.0, 'reading without load'),),
    equations=(r"F' = F + offset",),
    starts=starts,
    shown_by='rest at two set-points well apart',
    seen_against='pressure',
    families=(LOADS,),
    constant=True,
    rank=90,
)
