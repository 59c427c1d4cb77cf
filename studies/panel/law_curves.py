# SPDX-License-Identifier: Apache-2.0
"""
How near curves that were drawn are to the laws of the rig.

What is even of a curve, or straight of a sensor's, is also the gains', the offset's or the area's: the true law is told
but for that, and one of the flow into the chamber but for its scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.identification import Characteristic
from cfd_pneumatic.rig import ONE_WAY_SPEED, ForceOddities, Oddities
from studies.panel import STRANGE_FORCE, Draw


class Law(NamedTuple):
    """A law of the rig where it can be drawn as it is."""

    enters: str
    against: str
    value: Callable[[Array, Any], Array]
    """At some values of what it depends on, but for what is `free`."""

    free: Callable[[Array, Array], list[Array]]
    """What may be added to its value for nothing, of the same two."""


class Nearness(NamedTuple):
    """How near a curve is to the law."""

    error: float
    """Root mean square over the visited points, as a share of the law's range there [-]."""

    covered: int
    """Visited points where the law is within the band."""

    points: int
    """Visited points."""


def _hump(at: Array, middle: float, width: float) -> Array:
    return np.asarray(np.exp(-(((at - middle) / width) ** 2)))


def _bent(read: Array, odd: ForceOddities) -> Array:
    """Return the share by which the cell reads more, of what it reads: that is less by the bend for each newton."""
    return np.asarray(0.5 * (np.sqrt(1.0 - 4.0 * odd.bend * np.abs(read)) - 1.0))


def _constant(at: Array, value: Array) -> list[Array]:
    return [np.ones_like(at)]


def _gain(at: Array, value: Array) -> list[Array]:
    return [1.0 + value]  # of a share that multiplies a gain, the gain has a part


def _valves(at: Array, value: Array) -> list[Array]:
    return [(1.0 + value) * (at > 0.0), (1.0 + value) * (at <= 0.0)]  # charging and exhausting have a gain each


def _straight(at: Array, value: Array) -> list[Array]:
    return [np.ones_like(at), at]


def _nothing(at: Array, value: Array) -> list[Array]:
    return []


LAWS: Mapping[str, tuple[Law, ...]] = {
    'bulge': (Law('gain', 'x', lambda x, odd: odd.bulge * _hump(x, odd.bulge_position, odd.bulge_length), _gain),),
    'one_way': (Law('gain', 'speed', lambda v, odd: odd.one_way * np.tanh(v / ONE_WAY_SPEED), _gain),),
    'swimming_seal': (Law('leak', 'speed', lambda v, odd: v**2 / (v**2 + odd.lifting_speed**2), _nothing),),
    'pop_valve': (
        Law('chamber', 'p', lambda p, odd: -np.maximum(p - odd.pop_pressure, 0.0), _nothing),
        Law('leak', 'p', lambda p, odd: np.maximum(p - odd.pop_pressure, 0.0) / p, _nothing),
    ),
    'worn_seat': (
        Law('flow', 'error', lambda e, odd: odd.groove * _hump(np.abs(e), odd.groove_error, odd.groove_width), _valves),
    ),
    'rushing_air': (Law('set_point', 'speed', lambda v, odd: -odd.port * _hump(v, 0.0, odd.port_speed), _constant),),
    'ledge': (
        Law('set_point', 'x', lambda x, o: 0.5 * o.ledge * np.tanh((x - o.ledge_position) / o.ledge_length), _constant),
    ),
    'creep': (Law('set_point', 'time', lambda t, odd: -odd.creep * np.exp(-t / odd.creep_time), _constant),),
    'kinked_sensor': (
        Law('sensing', 'p', lambda p, odd: odd.kink * np.maximum(p - odd.kink_pressure, 0.0), _straight),
    ),
    'tilting_sensor': (
        Law('sensing', 'x', lambda x, odd: odd.tilt * np.sin(2.0 * np.pi * x / odd.tilt_length), _constant),
    ),
    'scarred_bore': (
        Law('friction', 'x', lambda x, odd: odd.scar * _hump(x, odd.scar_position, odd.scar_length), _nothing),
    ),
    'bent_cell': (Law('cell', 'force', _bent, _gain),),
    'cable_bundle': (
        Law('force', 'x', lambda x, o: -o.bundle * np.sign(x) * np.maximum(np.abs(x) - o.bundle_slack, 0.0), _constant),
    ),
}
"""By their names in the panel; the others are no curve of one variable as they stand."""

_SCALED = ('swimming_seal', 'pop_valve')  # by the chamber's volume, and what warms it


def nearness(shape: Characteristic, law: str, drawn: Draw) -> Nearness | None:
    """Return how near a curve is to a law of the rig; None where it was drawn in another place."""
    kind, whose = (ForceOddities, 'odd_force.') if law in STRANGE_FORCE else (Oddities, 'odd_a.')
    changes = drawn.truth.changes.items()
    odd = kind(**{name.removeprefix(whose): value for name, value in changes if name.startswith(whose)})
    for own in LAWS.get(law, ()):
        if (own.enters, own.against) == (shape.enters, shape.against) and np.count_nonzero(shape.visited) > 1:
            seen = shape.visited
            at, told = shape.at[seen], shape.value[seen]
            true = own.value(at * (1.0 + told) if own.enters == 'cell' else at, odd)
            if law in _SCALED:
                true = true * (true @ told) / max(float(true @ true), 1e-300)
            columns = np.column_stack([*own.free(at, true), np.zeros_like(at)])
            true = true + columns @ np.linalg.lstsq(columns, told - true, rcond=None)[0]
            error = rms(told - true) / max(float(np.ptp(true)), 1e-300)
            inside = (shape.low[seen] <= true) & (true <= shape.high[seen])
            return Nearness(error, int(np.count_nonzero(inside)), int(at.size))
    return None
