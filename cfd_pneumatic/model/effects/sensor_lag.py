# SPDX-License-Identifier: Apache-2.0
"""Sensor lag: the pressure sensor, or the line to it, is a first-order lag."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where


@inlined
def signal(p, moment, reading, lag):
    """Return the reading of the pressure sensor [Pa]."""
    return where(lag <= SHORTEST, p, reading)


@inlined
def evolve(moment, p, reading, lag):
    """Return the rate of the reading [Pa/s]."""
    return (where(lag <= SHORTEST, 0.0, (p - reading) / lag),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a lag of a sample period and the lag of the measured pressure."""
    return [(data['period'],), (max(data['lag'], 4.0 * data['period']),)]


SHORTEST = 1e-4
"""A shorter time constant counts as none [s]."""


def fastest(speed: float, lag: float) -> float:
    """Return the inverse of the lag [1/s]."""
    return 0.0 if lag <= SHORTEST else 1.0 / lag


EFFECT = Effect(
    name='sensor_lag',
    description='the pressure sensor is a first-order lag',
    inspect='the filter of the pressure sensor and the line to it',
    parameters=(EffectParameter('lag', 's', SHORTEST, 1.0, SHORTEST, 'time constant', logarithmic=True),),
    equations=(r'lag\,\dot s = p - s',),
    starts=starts,
    shown_by='fast strokes',
    shown_at=500.0,
    seen_against='pressure rate',
    families=(DELAYS,),
    fastest=fastest,
    states=1,
    follows='signal',
    rests_at_pressure=True,
    rank=60,
)
