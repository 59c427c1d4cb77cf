# SPDX-License-Identifier: Apache-2.0
"""
Compare estimated curves with the true characteristics of the rig.

A constant part of a curve, or a linear part of a sensor's curve, is not distinguishable from gains, offset or area.
The comparison therefore ignores these parts. It also ignores the scale of flows into the chamber.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.identification import Characteristic
from cfd_pneumatic.rig import ONE_WAY_SPEED, ForceOddities, Oddities
from studies.panel import STRANGE_FORCE, Draw


class TrueCurve(NamedTuple):
    """A characteristic of the rig that is a curve of one variable."""

    enters: str
    against: str
    value: Callable[[Array, Any], Array]
    """Value of the curve at values of its variable, without the parts of `free`."""

    free: Callable[[Array, Array], list[Array]]
    """Parts that may be added to the curve, as functions of its variable and value."""


class Agreement(NamedTuple):
    """How well an estimated curve agrees with the true characteristic."""

    error: float
    """Root mean square over the visited points, as a share of the true range there [-]."""

    covered: int
    """Visited points at which the true value is within the band."""

    points: int
    """Visited points."""


def _hump(at: Array, middle: float, width: float) -> Array:
    return np.asarray(np.exp(-(((at - middle) / width) ** 2)))


def _bent(read: Array, odd: ForceOddities) -> Array:
    """Return the true curve of a bent load cell: its relative error at a reading."""
    return np.asarray(0.5 * (np.sqrt(1.0 - 4.0 * odd.bend * np.abs(read)) - 1.0))


def _constant(at: Array, value: Array) -> list[Array]:
    return [np.ones_like(at)]


def _gain(at: Array, value: Array) -> list[Array]:
    return [1.0 + value]  # a share that multiplies a gain is partly absorbed by the gain


def _valves(at: Array, value: Array) -> list[Array]:
    return [(1.0 + value) * (at > 0.0), (1.0 + value) * (at <= 0.0)]  # charging and exhausting have separate gains


def _straight(at: Array, value: Array) -> list[Array]:
    return [np.ones_like(at), at]


def _nothing(at: Array, value: Array) -> list[Array]:
    return []


CHARACTERISTICS: Mapping[str, tuple[TrueCurve, ...]] = {
    'bulge': (
        TrueCurve('gain', 'x', lambda x, odd: odd.bulge * _hump(x, odd.bulge_position, odd.bulge_length), _gain),
    ),
    'one_way': (TrueCurve('gain', 'speed', lambda v, odd: odd.one_way * np.tanh(v / ONE_WAY_SPEED), _gain),),
    'swimming_seal': (TrueCurve('leak', 'speed', lambda v, odd: v**2 / (v**2 + odd.lifting_speed**2), _nothing),),
    'pop_valve': (
        TrueCurve('chamber', 'p', lambda p, odd: -np.maximum(p - odd.pop_pressure, 0.0), _nothing),
        TrueCurve('leak', 'p', lambda p, odd: np.maximum(p - odd.pop_pressure, 0.0) / p, _nothing),
    ),
    'worn_seat': (
        TrueCurve(
            'flow', 'error', lambda e, odd: odd.groove * _hump(np.abs(e), odd.groove_error, odd.groove_width), _valves
        ),
    ),
    'rushing_air': (
        TrueCurve('set_point', 'speed', lambda v, odd: -odd.port * _hump(v, 0.0, odd.port_speed), _constant),
    ),
    'ledge': (
        TrueCurve(
            'set_point', 'x', lambda x, o: 0.5 * o.ledge * np.tanh((x - o.ledge_position) / o.ledge_length), _constant
        ),
    ),
    'creep': (TrueCurve('set_point', 'time', lambda t, odd: -odd.creep * np.exp(-t / odd.creep_time), _constant),),
    'kinked_sensor': (
        TrueCurve('sensing', 'p', lambda p, odd: odd.kink * np.maximum(p - odd.kink_pressure, 0.0), _straight),
    ),
    'tilting_sensor': (
        TrueCurve('sensing', 'x', lambda x, odd: odd.tilt * np.sin(2.0 * np.pi * x / odd.tilt_length), _constant),
    ),
    'scarred_bore': (
        TrueCurve('friction', 'x', lambda x, odd: odd.scar * _hump(x, odd.scar_position, odd.scar_length), _nothing),
    ),
    'bent_cell': (TrueCurve('cell', 'force', _bent, _gain),),
    'cable_bundle': (
        TrueCurve(
            'force', 'x', lambda x, o: -o.bundle * np.sign(x) * np.maximum(np.abs(x) - o.bundle_slack, 0.0), _constant
        ),
    ),
}
"""Characteristics by their names in the panel; all others are not curves of one variable."""

_SCALED = ('swimming_seal', 'pop_valve')  # the chamber's volume and heat exchange scale these flows


def curve_agreement(estimated: Characteristic, name: str, drawn: Draw) -> Agreement | None:
    """Compare an estimated curve with a true characteristic; return None if place or variable differ."""
    kind, prefix = (ForceOddities, 'odd_force.') if name in STRANGE_FORCE else (Oddities, 'odd_a.')
    changes = drawn.truth.changes.items()
    odd = kind(**{field.removeprefix(prefix): value for field, value in changes if field.startswith(prefix)})
    place = estimated.enters, estimated.against
    for true_curve in CHARACTERISTICS.get(name, ()):
        if (true_curve.enters, true_curve.against) == place and np.count_nonzero(estimated.visited) > 1:
            visited = estimated.visited
            at, values = estimated.at[visited], estimated.value[visited]
            true = true_curve.value(at * (1.0 + values) if true_curve.enters == 'cell' else at, odd)
            if name in _SCALED:
                true = true * (true @ values) / max(float(true @ true), 1e-300)
            columns = np.column_stack([*true_curve.free(at, true), np.zeros_like(at)])
            true = true + columns @ np.linalg.lstsq(columns, values - true, rcond=None)[0]
            error = rms(values - true) / max(float(np.ptp(true)), 1e-300)
            is_covered = (estimated.low[visited] <= true) & (true <= estimated.high[visited])
            return Agreement(error, int(np.count_nonzero(is_covered)), int(at.size))
    return None
