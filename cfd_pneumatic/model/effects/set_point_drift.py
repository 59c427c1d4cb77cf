# SPDX-License-Identifier: Apache-2.0
"""Set-point drift: the regulated pressure drifts at constant set-point."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import OFFSETS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def setpoint(p_d, moment, rate):
    """Return the set-point that acts [Pa]."""
    return p_d + rate * moment.time


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return drifts by the residual's size over the recording, up and down."""
    rate = data['residual'] / data['duration']
    return [(rate,), (-rate,)]


EFFECT = Effect(
    name='set_point_drift',
    description='the set-point, or the reading of the pressure sensor, moves linearly with time',
    inspect='the temperature of the regulator and of the pressure sensor, and the signal that commands the regulator',
    parameters=(EffectParameter('rate', 'Pa/s', -1e5, 1e5, 0.0, 'rate of the drift'),),
    equations=(r"p_d' = p_d + rate\,t",),
    starts=starts,
    shown_by='a long recording at one set-point',
    seen_against='time',
    of_time=True,
    families=(OFFSETS,),
    rank=30,
)
