# SPDX-License-Identifier: Apache-2.0
"""
Curve: a law that nobody knows, as a table that data have drawn: where it enters, against what, and its values.

Between its knots it runs straight. Beyond them it stays as it ends; one of the pressure runs straight on. As many knots
lie on either side of its middle, evenly, or crowding about that.
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
"""All other places."""

ENTERS = (*BOTH_WAYS, *ONE_WAY)
"""Where it may enter, by the number of its parameter `enters`."""

AGAINST = ('x', 'speed', 'p', 'error', 'flow', 'time')
"""What it may depend on, by the number of its parameter `against`: p is gauge, the flow is lagged."""

CURVE = 'curve'
"""Its name."""

LIFTING = 1e-2
"""Speed at which the lip of a seal lifts [m/s]."""


def is_of_flow(parameters: Sequence[float]) -> bool:
    """Return whether a curve with some parameters depends on the flow, whose lag counts then."""
    return AGAINST[round(parameters[1])] == 'flow'


@inlined
def _own_height(moment, flow, against, low, high, middle, crowd, heights):
    """Return the height of the curve where the cylinder is."""
    at = where(against < 0.5, moment.x, moment.rate)
    at = where(against > 1.5, moment.p - moment.ambient, at)
    at = where(against > 2.5, moment.setpoint - moment.p_f, at)
    at = where(against > 3.5, flow, at)
    at = where(against > 4.5, moment.time, at)
    return height(at, abs(against - 2.0) < 0.5, low, high, middle, crowd, heights)


@inlined
def _entering(here, moment, flow, against, low, high, middle, crowd, heights):
    """Return the height of the curve if it enters here, else nothing; not computed where none does."""
    own = 0.0 * moment.p
    if some(here):
        own = where(here, _own_height(moment, flow, against, low, high, middle, crowd, heights), 0.0)
    return own


@inlined
def _is(enters, place):
    """Tell whether it enters at a place."""
    return abs(enters - place) < 0.5


@inlined
def _scales(enters, place):
    """Tell whether it scales what is at a place: alone, or as part of the chamber's stiffness."""
    return min(abs(enters - place), abs(enters - 6.0)) < 0.5


@inlined
def _leaks(enters):
    """Tell whether it is a leak, always or one way."""
    return min(min(abs(enters - 4.0), abs(enters - 7.0)), abs(enters - 8.0)) < 0.5


@inlined
def _lifted(enters, rate):
    """Return how far a seal has lifted at a speed [m/s]: 1 where it does not depend on that."""
    way = where(enters > 7.5, -1.0, min(max(enters - 6.0, 0.0), 1.0))
    return 1.0 - 0.5 * abs(way) * (1.0 - tanh(way * rate / LIFTING))


@inlined
def setpoint(p_d, moment, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the set-point that acts [Pa]."""
    return p_d + _entering(_is(enters, 0.0), moment, passed, against, low, high, middle, crowd, heights)


@inlined
def flow(q, moment, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the pressure rate that the valves' flow makes [Pa/s]."""
    return q * (1.0 + _entering(_scales(enters, 1.0), moment, passed, against, low, high, middle, crowd, heights))


@inlined
def velocity_gain(gain, moment, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return K_x [Pa/m]."""
    return gain * (1.0 + _entering(_scales(enters, 2.0), moment, passed, against, low, high, middle, crowd, heights))


@inlined
def chamber(rate, moment, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the outlet pressure's rate [Pa/s]: more of it, or less what leaks to ambient."""
    added = _entering(_is(enters, 3.0), moment, passed, against, low, high, middle, crowd, heights)
    leaking = _leaks(enters)
    leaks = _entering(leaking, moment, passed, against, low, high, middle, crowd, heights)
    if some(leaking):
        leaks *= _lifted(enters, moment.rate)
    return rate + moment.dense * (added - leaks * (moment.p - moment.ambient))


@inlined
def signal(p, moment, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return what the pressure's sensor reads [Pa]."""
    return p + _entering(_is(enters, 5.0), moment, passed, against, low, high, middle, crowd, heights)


@inlined
def evolve(moment, q, passed, enters, against, lag, low, high, middle, crowd, *heights):
    """Return the rate of the lagged flow [Pa/s^2], of that which passes."""
    passing = flow(q, moment, passed, enters, against, lag, low, high, middle, crowd, *heights)
    return ((passing - passed) / lag,)


def fastest(speed: float, enters: float, against: float, lag: float, *more: float) -> float:
    """Return the inverse of the flow's lag, where that counts [1/s]."""
    return 1.0 / lag


EFFECT = Effect(
    name=CURVE,
    description='a law that nobody knows, as data have drawn it',
    parameters=(
        choice('enters', 'where it enters', ENTERS),
        choice('against', 'what it depends on', AGAINST),
        EffectParameter('lag', 's', 1e-3, 10.0, 0.1, 'time constant of the flow that it depends on', logarithmic=True),
        *PARAMETERS,
    ),
    generic=True,
    moves_rest=True,
    fastest=fastest,
    states=1,
    follows='flow',
    rank=90,
)
