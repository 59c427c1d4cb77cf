# SPDX-License-Identifier: Apache-2.0
"""Every parameter of a device, described once: for its file, the nodes that declare it, the planner and Python."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from cfd_pneumatic import convention
from cfd_pneumatic.device.identified_range import UNKNOWN
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import FORCE_PARTS, PRESSURE_PARTS, SPECS, TABLE_1, Effect
from cfd_pneumatic.units import PSI

Value = bool | float | tuple[float, ...] | tuple[str, ...]
"""A switch, a number, a list of numbers, or a list of names."""


_SPAN = 'two finite numbers, the lower first; 0, 0: not known'

NO_NAMES = ('',)
"""A list of names without any; ROS has no empty lists."""


@dataclass(frozen=True)
class Descriptor:
    """
    What there is to know about a parameter; what it is follows from its default.

    Attributes
    ----------
    name
        In files and of a node: `cylinder_a.leakage.conductance`.
    default
        Value that stands in where none is given; of the gains the paper's Table 1 [unit].
    description
        One line.
    unit
        SI unit; empty for a switch.
    lower, upper
        Range, of each number in a list, too [unit].
    constraints
        On a list, for people.
    remark
        Stands beside the unit in a file.
    at_start
        Whether a node takes it at its start only.

    """

    name: str
    default: Value
    description: str
    unit: str = ''
    lower: float = -math.inf
    upper: float = math.inf
    constraints: str = ''
    remark: str = ''
    at_start: bool = False

    def checked(self, value: object) -> Value:
        """
        Return a value as one of this parameter.

        Raises
        ------
        InputError
            If it has another type, or is a number outside the range; a list's ranges are checked by who uses it.

        """
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise InputError(f'{self.name}: give true or false')
            return value
        if isinstance(self.default, float):
            if not _is_number(value):
                raise InputError(f'{self.name}: give a number')
            number = float(value)  # type: ignore[arg-type]
            if not self.lower <= number <= self.upper:
                raise InputError(
                    f'{self.name} = {number:g} is outside {self.lower:g} to {self.upper:g} {self.unit}'.rstrip(' -')
                )
            return number
        entries = value if isinstance(value, Sequence) and not isinstance(value, str) else ()
        if self.lists_names:
            if not all(isinstance(one, str) for one in entries):
                raise InputError(f'{self.name}: give a list of names')
            return tuple(entries)
        if not entries or not all(map(_is_number, entries)):
            raise InputError(f'{self.name}: give a list of numbers')
        return tuple(map(float, entries))

    @property
    def lists_names(self) -> bool:
        """Whether it is a list of names."""
        return self.default == NO_NAMES


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _device() -> Iterator[Descriptor]:
    yield Descriptor(
        'ambient_pressure',
        convention.AMBIENT_PRESSURE,
        'absolute pressure that gauge set-points are counted from',
        'Pa',
        *convention.AMBIENT_PRESSURES,
    )
    yield Descriptor(
        'supply_pressure', convention.SUPPLY_PRESSURE, 'gauge; a set-point above it is ignored', 'Pa', 1e4, 2e6
    )
    yield Descriptor('area', convention.PISTON_AREA, 'piston area of either cylinder', 'm^2', *convention.AREAS)
    yield Descriptor(
        'geometric_factor',
        1.0,
        'contact force over piston force, from the linkage',
        '-',
        *convention.FACTORS,
        remark='only its product with the area shows',
    )
    yield Descriptor(
        'identified_displacement',
        UNKNOWN,
        'lowest and highest displacement of the recordings that the device was identified with',
        'm',
        constraints=_SPAN,
    )
    yield Descriptor(
        'identified_speed', 0.0, 'largest speed of the piston in these recordings; 0: not known', 'm/s', 0.0, 1e3
    )
    for cylinder in convention.CYLINDERS:
        yield from _cylinder(cylinder)
    force = convention.CONTACT_FORCE
    yield Descriptor(
        f'{force}.seal_play',
        2e-6,
        'half of the play with which seals follow the displacement, lest noise turn them round: half a bit of its '
        'sensor, or three standard deviations of its noise',
        'm',
        0.0,
        1e-3,
    )
    yield from _effects(force, FORCE_PARTS)


def _cylinder(name: str) -> Iterator[Descriptor]:
    yield Descriptor(
        f'{name}.enabled',
        True,
        'false: there is none, and ambient pressure takes its place in the force',
        at_start=True,
    )
    yield Descriptor(
        f'{name}.initial_setpoint',
        10.0 * PSI,
        'gauge set-point until one arrives',
        'Pa',
        -1e5,
        2e6,
        remark='gauge',
        at_start=True,
    )
    yield Descriptor(f'{name}.setpoint_offset', 0.0, 'what the regulator holds above what it is told', 'Pa', -1e5, 1e5)
    yield Descriptor(
        f'{name}.setpoints',
        tuple(TABLE_1.setpoints.tolist()),
        'gauge set pressures at which the gains are given',
        'Pa',
        constraints='finite, strictly increasing',
        remark='gauge',
    )
    for spec in SPECS:
        yield Descriptor(
            f'{name}.{spec.name}',
            tuple(getattr(TABLE_1, spec.name).tolist()),
            f'{spec.description}, one for each set-point',
            spec.unit,
            spec.lower,
            spec.upper,
            f'{spec.lower:g} to {spec.upper:g} {spec.unit}, as many as setpoints',
        )
    yield Descriptor(
        f'{name}.identified_setpoints',
        UNKNOWN,
        'lowest and highest gauge set-point of the recordings that the device was identified with',
        'Pa',
        constraints=_SPAN,
        remark='gauge',
    )
    yield Descriptor(
        f'{name}.identified_pressures',
        UNKNOWN,
        'lowest and highest absolute pressure of these recordings',
        'Pa',
        constraints=_SPAN,
        remark='absolute',
    )
    yield Descriptor(
        f'{name}.not_identifiable', NO_NAMES, 'gains that the recordings did not tell: they are as the fit used them'
    )
    yield from _effects(name, PRESSURE_PARTS)


def _effects(prefix: str, library: Mapping[str, Effect]) -> Iterator[Descriptor]:
    """Yield what switches cores and effects; by default effects are null: one that is given nothing changes nothing."""
    for effect in library.values():
        default = (
            'its gains hold at a pressure and a position' if effect.core else 'its parameters by default change nothing'
        )
        yield Descriptor(f'{prefix}.{effect.name}.enabled', False, f'{effect.description}; {default}')
        for one in effect.parameters:
            yield Descriptor(
                f'{prefix}.{effect.name}.{one.name}',
                float(one.null),
                f'{effect.description}: {one.description}',
                one.unit,
                one.lower,
                one.upper,
            )


DESCRIPTORS: Mapping[str, Descriptor] = {one.name: one for one in _device()}
"""By their names, in the order in which they stand in a file."""
