# SPDX-License-Identifier: Apache-2.0
"""
Curve: an unknown characteristic as a table that is estimated from data.

The table has the place where the curve acts, the variable, and the values at the knots. The curve is linear between the
knots and constant beyond them; a curve of the pressure is extrapolated linearly. Half of the knots are on either side
of the middle, evenly spaced or concentrated about the middle.
"""

from __future__ import annotations

from collections.abc import Sequence

from cfd_pneumatic.model.effects.effect import Effect, EffectParameter
from cfd_pneumatic.model.effects.knots import PARAMETERS, choice, height
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import some, where
from cfd_pneumatic.model.lanewise import tanh

ONE_WAY = ('leak_while_growing', 'leak_while_shrinking')
"""Leaks of a seal whose lip lifts in one direction of travel only."""

BOTH_WAYS = ('set_point', 'flow', 'gain', 'chamber', 'leak', 'sensing', 'stiffness')
"""Places of curves that act in both directions of travel."""

ENTERS = (*BOTH_WAYS, *ONE_WAY)
"""Places where the curve may act, in the order of the values of `enters`."""

AGAINST = ('x', 'speed', 'p', 'error', 'flow', 'time')
"""Variables of the curve, in the order of the values of `against`; p is gauge, the flow is lagged."""

CURVE = 'curve'
"""Name of the effect."""

LIFTING = 1e-2
"""Speed at which the lip of a seal lifts [m/s]."""


def is_of_flow(parameters: Sequence[float]) -> bool:
    """Return whether a curve with these parameters depends on the lagged flow."""
    return AGAINST[round(parameters[1])] == 'flow'


@inlined
def _curve_height(moment, flow, against, low, high, middle, crowd, heights):
    """Return the height of the curve in the cylinder's present state."""
    variable = where(against < 0.5, moment.x, moment.rate)
    variable = where(against > 1.5, moment.p - moment.ambient, variable)
    variable = where(against > 2.5, moment.setpoint - moment.p_f, variable)
    variable = where(against > 3.5, flow, variable)
    variable = where(against > 4.5, moment.time, variable)
    return height(variable, abs(against - 2.0) < 0.5, low, high, middle, crowd, heights)


@inlined
def _height_here(here, moment, flow, against, low, high, middle, crowd, heights):
    """Return the height of the curve if the curve acts here, else zero."""
    here_height = 0.0 * moment.p
    if some(here):
        here_height = where(here, _curve_height(moment, flow, against, low, high, middle, crowd, heights), 0.0)
    return here_height


@inlined
def _acts_at(enters, place):
    """Return whether the curve acts at a place."""
    return abs(enters - place) < 0.5


@inlined
def _scales(enters, place):
    """Return whether the curve scales the value at a place, directly or as part of the chamber's stiffness."""
    return min(abs(enters - place), abs(enters - 6.0)) < 0.5


@inlined
def _is_leak(enters):
    """Return whether the curve is a leak, in both directions of travel or in one."""
    return min(min(abs(enters - 4.0), abs(enters - 7.0)), abs(enters - 8.0)) < 0.5


@inlined
def _lifted_share(enters, rate):
    """Return the lifted share of a seal's lip at a speed [m/s]; 1 for a leak in both directions."""
    direction = where(enters > 7.5, -1.0, min(max(enters - 6.0, 0.0), 1.0))
    return 1.0 - 0.5 * abs(direction) * (1.0 - tanh(direction * rate / LIFTING))


@inlined
def setpoint(p_d, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the set-point that acts [Pa]."""
    return p_d + _height_here(_acts_at(enters, 0.0), moment, lagged_flow, against, low, high, middle, crowd, heights)


@inlined
def flow(q, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the pressure rate of the valves' flow [Pa/s]."""
    return q * (
        1.0 + _height_here(_scales(enters, 1.0), moment, lagged_flow, against, low, high, middle, crowd, heights)
    )


@inlined
def velocity_gain(gain, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return K_x [Pa/m]."""
    return gain * (
        1.0 + _height_here(_scales(enters, 2.0), moment, lagged_flow, against, low, high, middle, crowd, heights)
    )


@inlined
def chamber(rate, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the outlet pressure's rate with an added rate or a leak to ambient [Pa/s]."""
    added = _height_here(_acts_at(enters, 3.0), moment, lagged_flow, against, low, high, middle, crowd, heights)
    leaking = _is_leak(enters)
    leaks = _height_here(leaking, moment, lagged_flow, against, low, high, middle, crowd, heights)
    if some(leaking):
        leaks *= _lifted_share(enters, moment.rate)
    return rate + moment.dense * (added - leaks * (moment.p - moment.ambient))


@inlined
def signal(p, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the reading of the pressure sensor [Pa]."""
    return p + _height_here(_acts_at(enters, 5.0), moment, lagged_flow, against, low, high, middle, crowd, heights)


@inlined
def evolve(moment, q, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the rate of the lagged flow [Pa/s^2]."""
    passing = flow(q, moment, lagged_flow, enters, against, lag, low, high, middle, crowd, *heights)
    return ((passing - lagged_flow) / lag,)


def fastest(speed: float, enters: float, against: float, lag: float, *more: float) -> float:
    """Return the inverse of the flow's lag [1/s]."""
    return 1.0 / lag


EFFECT = Effect(
    name=CURVE,
    description='an unknown characteristic, estimated from the recordings',
    parameters=(
        choice('enters', 'place at which the curve acts', ENTERS),
        choice('against', 'variable of the curve', AGAINST),
        EffectParameter('lag', 's', 1e-3, 10.0, 0.1, 'time constant of the lagged flow', logarithmic=True),
        *PARAMETERS,
    ),
    generic=True,
    moves_rest=True,
    fastest=fastest,
    states=1,
    follows='flow',
    rank=90,
)
