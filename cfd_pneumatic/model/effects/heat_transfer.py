# SPDX-License-Identifier: Apache-2.0
"""Heat transfer: a fast change of volume is adiabatic and relaxes to isothermal, because the walls take the heat."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import STIFFNESS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

ADIABATIC = 1.4
"""Ratio of the specific heats of air [-]."""


@inlined
def flow(value, moment, heat, loss):
    """Return the pressure rate of the flow [Pa/s]; a mass flow of warmer air removes more pressure."""
    warm = where(value > 0.0, 0.0, where(loss > 0.0, heat, 0.0))
    return value / (1.0 - warm / moment.p)


@inlined
def cooling(moment, heat, loss):
    """Return the rate at which the walls reduce the pressure [Pa/s]; less air cools faster."""
    return loss * heat * moment.ambient / (moment.p - heat)


@inlined
def chamber(rate, moment, heat, loss):
    """Return the outlet pressure's rate [Pa/s]."""
    return rate - cooling(moment, heat, loss)


@inlined
def evolve(moment, rate, heat, loss):
    """Return the rate of the pressure due to temperature, p (1 - T_wall / T) [Pa/s]."""
    return (warming(moment, rate, heat, loss, ADIABATIC),)


@inlined
def warming(moment, rate, heat, loss, exponent):
    """Return the rate of the pressure due to temperature [Pa/s] for a polytropic exponent; 1.4 is adiabatic."""
    thinned = min(rate, -moment.swept)  # supplied air has the temperature of the wall and brings no heat
    return (1.0 - 1.0 / exponent) * rate + heat / (exponent * moment.p) * thinned - cooling(moment, heat, loss)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return walls with time constants of 1 s and 0.1 s."""
    return [(1.0,), (10.0,)]


def fastest(speed: float, loss: float) -> float:
    """Return the inverse of the walls' time constant [1/s]."""
    return loss


EFFECT = Effect(
    name='heat_transfer',
    description='adiabatic changes of pressure relax to isothermal',
    inspect='no part: heat exchange with the chamber walls is no fault',
    parameters=(
        EffectParameter(
            'loss', '1/s', 0.0, 1e3, 0.0, 'inverse of the time constant m c_v / (h A), at ambient pressure'
        ),
    ),
    equations=(
        r"\dot p' = \dot p - \Lambda, \qquad \Lambda = loss\,\theta\,\frac{p_0}{p - \theta}",
        r"q' = q / (1 - \theta / p) \quad \text{where } q < 0",
        r'\dot\theta = (1 - 1 / 1.4)\,\dot p + \frac{\theta}{1.4\,p} \min(\dot p, -K_x \dot x) - \Lambda',
    ),
    starts=starts,
    shown_by='large steps of the set-point, up and down',
    seen_against='valve error',
    families=(STIFFNESS,),
    fastest=fastest,
    states=1,
    follows='chamber',
    rank=90,
)
