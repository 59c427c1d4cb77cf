# SPDX-License-Identifier: Apache-2.0
"""
Places at which an unknown characteristic may enter a model, and variables on which it may depend.

Search, report, console and the draft of an effect read these tables. The kernels of `model/effects/curve.py` and
`force_curve.py` compute what the rows describe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from cfd_pneumatic.identification.channels.thresholds import (
    LARGEST_BORE_CHANGE,
    LARGEST_CELL_CHANGE,
    LARGEST_STIFFNESS_CHANGE,
)
from cfd_pneumatic.model import LIFTING


class EffectFunction(NamedTuple):
    """
    A function of an effect's file.

    Attributes
    ----------
    name, argument
        Name and argument as in `model/effects/effect.py`.
    result
        Expression that the function returns, with a blank for the characteristic's formula.
    returned
        Meaning of the returned value, with its unit.

    """

    name: str
    argument: str
    result: str
    returned: str


@dataclass(frozen=True)
class Place:
    """
    A place at which a characteristic may enter.

    Attributes
    ----------
    unit
        Unit of the characteristic's value.
    axis
        Label of the value in a plot.
    sentence
        Effect of the characteristic, with a blank for its largest value; shares are in percent.
    inspect
        What to inspect on the machine.
    effect
        Functions of the file of an effect with the characteristic.
    gains
        Gains of the model that compensate a constant value; None if no gain does.
    keeps_constant
        Whether no parameter of the model compensates a constant value.
    largest
        Largest value that a device can have [unit].

    """

    unit: str
    axis: str
    sentence: str
    inspect: str
    effect: tuple[EffectFunction, ...]
    gains: slice | None = None
    keeps_constant: bool = False
    largest: float = math.inf


@dataclass(frozen=True)
class Variable:
    """
    A variable on which a characteristic may depend.

    Attributes
    ----------
    unit
        Unit of the variable.
    axis
        Label of the variable in a plot.
    symbol
        Symbol of the variable in a formula.
    sentence
        The dependence as a clause.
    effect
        Expression for the variable in an effect's file; empty if an effect has no access to the variable.
    seen_against
        Signal against which a residual shows the dependence, as in `Effect.seen_against`.

    """

    unit: str
    axis: str
    symbol: str
    sentence: str
    effect: str = ''
    seen_against: str = ''


_FLOW = EffectFunction('flow', 'q', 'q * (1.0 + {})', "the pressure rate that the valves' flow makes [Pa/s]")
_GAIN = EffectFunction('velocity_gain', 'gain', 'gain * (1.0 + {})', 'K_x [Pa/m]')
_LEAK = 'rate - {} * (moment.p - moment.ambient)'
_LIFTED = f'tanh(moment.rate / {LIFTING:g})'


def _of_chamber(result: str) -> tuple[EffectFunction, ...]:
    return (EffectFunction('chamber', 'rate', result, "the outlet pressure's rate [Pa/s]"),)


def _of_force(result: str, returned: str) -> tuple[EffectFunction, ...]:
    return (EffectFunction('force', 'value', result, returned),)


PLACES: Mapping[str, Place] = MappingProxyType(
    {
        'set_point': Place(
            'Pa',
            'set-point, off by',
            'the pressure that the regulator holds varies by {} Pa',
            'the regulator, its control line and its mounting',
            (EffectFunction('setpoint', 'p_d', 'p_d + {}', 'the set-point that acts [Pa]'),),
        ),
        'flow': Place(
            '1',
            'flow, more by',
            'the flow of the valves varies by {} %',
            'the supply line, the valve seats and the silencer',
            (_FLOW,),
            gains=slice(1, 3),
        ),
        'gain': Place(
            '1',
            'swept volume and stiffness K_x, more by',
            'the volume that the piston sweeps varies by {} %',
            'the bore, the seal and the chamber walls',
            (_GAIN,),
            gains=slice(0, 1),
            largest=LARGEST_BORE_CHANGE,
        ),
        'chamber': Place(
            'Pa/s',
            'rate of the pressure, more by',
            'an additional flow of air changes the pressure by up to {} Pa per second',
            'the seal and the fittings',
            _of_chamber('rate + {}'),
            keeps_constant=True,
        ),
        'leak': Place(
            '1/s',
            'leak, share of the gauge pressure',
            'the chamber loses up to {} % of its gauge pressure per second',
            'the seal and the fittings',
            _of_chamber(_LEAK),
            keeps_constant=True,
        ),
        'leak_while_growing': Place(
            '1/s',
            'leak while the chamber grows, share of the gauge pressure',
            'while the chamber grows, it loses up to {} % of its gauge pressure per second',
            'the lip of the seal',
            _of_chamber(f'{_LEAK} * 0.5 * (1.0 + {_LIFTED})'),
            keeps_constant=True,
        ),
        'leak_while_shrinking': Place(
            '1/s',
            'leak while the chamber shrinks, share of the gauge pressure',
            'while the chamber shrinks, it loses up to {} % of its gauge pressure per second',
            'the lip of the seal',
            _of_chamber(f'{_LEAK} * 0.5 * (1.0 - {_LIFTED})'),
            keeps_constant=True,
        ),
        'sensing': Place(
            'Pa',
            'reading, off by',
            'the reading of the pressure sensor varies by {} Pa',
            'the pressure sensor, its line and its supply',
            (EffectFunction('signal', 'p', 'p + {}', 'the reading of the sensor [Pa]'),),
        ),
        'stiffness': Place(
            '1',
            'stiffness of the air, more by',
            'the stiffness of the air in the chamber varies by {} %',
            'the chamber walls, and hoses and parts that are connected to the chamber',
            (_GAIN, _FLOW),
            gains=slice(0, 3),
            largest=LARGEST_STIFFNESS_CHANGE,
        ),
        'force': Place(
            'N',
            'force, more by',
            'an additional force varies by {} N',
            'cables and hoses that the piston moves, stops, and the zero of the load cell',
            _of_force('value + {}', 'the contact force [N]'),
        ),
        'friction': Place(
            'N',
            'friction',
            'friction opposes the motion with up to {} N',
            'the bore, the rod and its seals and guides',
            _of_force('value - {} * stretch', 'the contact force less friction [N]'),
            keeps_constant=True,
        ),
        'cell': Place(
            '1',
            'reading of the load cell, more by',
            'the reading of the load cell varies by {} %',
            'the load cell, how it is mounted, and the linkage',
            _of_force('value * (1.0 + {})', 'the reading of the load cell [N]'),
            largest=LARGEST_CELL_CHANGE,
        ),
    }
)
"""Places by name, as in `enters` of an effect that is a curve."""

VARIABLES: Mapping[str, Variable] = MappingProxyType(
    {
        'x': Variable('m', 'displacement', 'x', 'depending on the position of the piston', 'moment.x', 'displacement'),
        'speed': Variable(
            'm/s', 'speed of the piston', 'v', 'depending on the speed of the piston', 'moment.rate', 'speed'
        ),
        'p': Variable(
            'Pa', 'gauge pressure', 'p', 'depending on the pressure', 'moment.p - moment.ambient', 'pressure'
        ),
        'error': Variable(
            'Pa',
            'valve error',
            'e',
            'depending on how far the valves are open',
            'moment.setpoint - moment.p_f',
            'valve error',
        ),
        'flow': Variable('Pa/s', 'flow, lagged', 'q', 'depending on how much air has flowed recently'),
        'time': Variable('s', 'time', 't', 'changing over time', 'moment.time', 'time'),
        'force': Variable('N', 'force', 'F', 'depending on the force', 'value', 'pressure'),
    }
)
"""Variables by name, as in `against` of an effect that is a curve."""
