"""
Curve: a law that nobody knows, as a table that data have drawn: where it enters, against what, and its values.

Between its knots it runs straight, and beyond them on as it ends; one of the time stays as it ends. Knots lie evenly
over the curve's range, or crowd about its middle.
"""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import inlined
from cfd_pneumatic.model.lanes import some, where

ENTERS = ('set_point', 'flow', 'gain', 'chamber', 'leak', 'sensing')
"""Where it may enter, by the number of its parameter `enters`."""

AGAINST = ('x', 'speed', 'p', 'error', 'flow', 'time')
"""What it may depend on, by the number of its parameter `against`: p is gauge, the flow is lagged."""

CURVE = 'curve'
"""Its name."""

KNOTS = 11
"""How many values a curve has."""

_LAST = 10.0  # number of the last knot


@inlined
def _height(moment, flow, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the height of the curve where the cylinder is."""
    at = where(against < 0.5, moment.x, moment.rate)
    at = where(against > 1.5, moment.p - moment.ambient, at)
    at = where(against > 2.5, moment.setpoint - moment.p_f, at)
    at = where(against > 3.5, flow, at)
    at = where(against > 4.5, min(moment.time, high), at)
    share = (2.0 * at - low - high) / (high - low)
    place = 0.5 * _LAST * (1.0 + share * (1.0 + crowd) / (abs(share) + crowd))
    inner = min(max(place, 0.0), _LAST)
    height = w0 * max(1.0 - inner, 0.0) + w10 * max(inner - 9.0, 0.0)
    height += w1 * max(1.0 - abs(inner - 1.0), 0.0) + w2 * max(1.0 - abs(inner - 2.0), 0.0)
    height += w3 * max(1.0 - abs(inner - 3.0), 0.0) + w4 * max(1.0 - abs(inner - 4.0), 0.0)
    height += w5 * max(1.0 - abs(inner - 5.0), 0.0) + w6 * max(1.0 - abs(inner - 6.0), 0.0)
    height += w7 * max(1.0 - abs(inner - 7.0), 0.0) + w8 * max(1.0 - abs(inner - 8.0), 0.0)
    height += w9 * max(1.0 - abs(inner - 9.0), 0.0)
    return height + min(place, 0.0) * (w1 - w0) + max(place - _LAST, 0.0) * (w10 - w9)


@inlined
def _entering(place, enters, moment, flow, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the height of the curve if it enters at this place, else nothing; not computed where none does."""
    height = 0.0 * moment.p
    here = abs(enters - place) < 0.5
    if some(here):
        height = where(
            here, _height(moment, flow, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10), 0.0
        )
    return height


@inlined
def setpoint(p_d, moment, flow, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the set-point that acts [Pa]."""
    return p_d + _entering(
        0.0, enters, moment, flow, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10
    )


@inlined
def flow(q, moment, passed, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the pressure rate that the valves' flow makes [Pa/s]."""
    return q * (
        1.0
        + _entering(1.0, enters, moment, passed, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10)
    )


@inlined
def velocity_gain(
    gain, moment, passed, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10
):
    """Return K_x [Pa/m]."""
    return gain * (
        1.0
        + _entering(2.0, enters, moment, passed, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10)
    )


@inlined
def chamber(rate, moment, passed, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the outlet pressure's rate [Pa/s]: more of it, or less what leaks to ambient."""
    added = _entering(
        3.0, enters, moment, passed, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10
    )
    leaks = _entering(
        4.0, enters, moment, passed, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10
    )
    return rate + moment.dense * (added - leaks * (moment.p - moment.ambient))


@inlined
def signal(p, moment, passed, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return what the pressure's sensor reads [Pa]."""
    return p + _entering(
        5.0, enters, moment, passed, against, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10
    )


@inlined
def evolve(moment, q, passed, enters, against, lag, low, high, crowd, w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10):
    """Return the rate of the lagged flow [Pa/s^2]."""
    return ((q - passed) / lag,)


def fastest(speed: float, enters: float, against: float, lag: float, *more: float) -> float:
    """Return the inverse of the flow's lag, where that counts [1/s]."""
    return 1.0 / lag


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return none: a search for a law draws its own."""
    return []


EFFECT = Effect(
    name=CURVE,
    description='a law that nobody knows, as data have drawn it',
    parameters=(
        EffectParameter(
            'enters',
            '-',
            0.0,
            len(ENTERS) - 1.0,
            0.0,
            f'where it enters: {", ".join(f"{number} {name}" for number, name in enumerate(ENTERS))}',
            choice=True,
        ),
        EffectParameter(
            'against',
            '-',
            0.0,
            len(AGAINST) - 1.0,
            0.0,
            f'what it depends on: {", ".join(f"{number} {name}" for number, name in enumerate(AGAINST))}',
            choice=True,
        ),
        EffectParameter('lag', 's', 1e-3, 1e2, 0.1, 'time constant of the flow that it depends on', choice=True),
        EffectParameter('low', '-', -1e9, 1e9, -1.0, 'where it begins, in the unit of what it depends on', choice=True),
        EffectParameter('high', '-', -1e9, 1e9, 1.0, 'where it ends, likewise', choice=True),
        EffectParameter(
            'crowd', '-', 1e-3, 1e6, 1e6, 'share of the range about whose middle the knots crowd', choice=True
        ),
        *(
            EffectParameter(
                f'w{number}', '-', -1e12, 1e12, 0.0, f'height at knot {number}, in the unit of where it enters'
            )
            for number in range(KNOTS)
        ),
    ),
    starts=starts,
    generic=True,
    moves_rest=True,
    fastest=fastest,
    states=1,
    follows='flow',
    rank=90,
)
