"""Sensor lag: the pressure sensor, or the line to it, is a first-order lag."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel


@kernel
def signal(p, moment, reading, lag):
    """Return what the sensor reads [Pa]."""
    return p if lag < SHORTEST else reading


@kernel
def evolve(moment, p, reading, lag):
    """Return the rate of the reading [Pa/s]."""
    return ((p - reading) / max(lag, SHORTEST),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return lags of a sample and of a few."""
    return [(data['period'],), (4.0 * data['period'],)]


SHORTEST = 2e-4
"""Time constant below which there is no lag [s]."""


def fastest(lag: float) -> float:
    """Return the inverse of the lag [1/s]."""
    return 1.0 / max(lag, SHORTEST)


EFFECT = Effect(
    name='sensor_lag',
    description='the pressure sensor is a first-order lag',
    parameters=(EffectParameter('lag', 's', 0.0, 1.0, 0.0, 'time constant'),),
    starts=starts,
    fastest=fastest,
    states=1,
    follows='signal',
    rank=60,
)
