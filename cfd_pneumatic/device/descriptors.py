# SPDX-License-Identifier: Apache-2.0
"""Describe every parameter of a device once: for the parameter file, the nodes, the planner and Python."""

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


_SPAN = 'two finite numbers, the lower first; 0, 0: unknown'

NO_NAMES = ('',)
"""An empty list of names; ROS has no empty lists."""


@dataclass(frozen=True)
class Descriptor:
    """
    Description of a parameter; the default determines the type.

    Attributes
    ----------
    name
        Name in files and nodes: `cylinder_a.leakage.conductance`.
    default
        Value of a parameter that is not given; for the gains the paper's Table 1 [unit].
    description
        One line.
    unit
        SI unit; empty for a switch.
    lower, upper
        Range of the number, or of each number in a list [unit].
    constraints
        Constraints of a list, for people.
    remark
        Text after the unit in a file.
    at_start
        Whether a node reads the parameter only at start.

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
        Return a value with the type of this parameter.

        Raises
        ------
        InputError
            If the value has a wrong type, or is a number outside of the range. The users of a list check its ranges.

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
            if not all(isinstance(entry, str) for entry in entries):
                raise InputError(f'{self.name}: give a list of names')
            return tuple(entries)
        if not entries or not all(map(_is_number, entries)):
            raise InputError(f'{self.name}: give a list of numbers')
        return tuple(map(float, entries))

    @property
    def lists_names(self) -> bool:
        """Whether the parameter is a list of names."""
        return self.default == NO_NAMES


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _device_descriptors() -> Iterator[Descriptor]:
    yield Descriptor(
        'ambient_pressure',
        convention.AMBIENT_PRESSURE,
        'absolute ambient pressure, the zero of gauge set-points',
        'Pa',
        *convention.AMBIENT_PRESSURES,
    )
    yield Descriptor(
        'supply_pressure',
        convention.SUPPLY_PRESSURE,
        'gauge supply pressure; set-points above the supply are ignored',
        'Pa',
        1e4,
        2e6,
    )
    yield Descriptor('area', convention.PISTON_AREA, 'piston area of either cylinder', 'm^2', *convention.AREAS)
    yield Descriptor(
        'geometric_factor',
        1.0,
        'ratio of contact force to piston force, from the linkage',
        '-',
        *convention.FACTORS,
        remark='only the product with the area is identifiable',
    )
    yield Descriptor(
        'identified_displacement',
        UNKNOWN,
        'lowest and highest displacement of the recordings that the device was identified with',
        'm',
        constraints=_SPAN,
    )
    yield Descriptor(
        'identified_speed', 0.0, 'largest speed of the piston in these recordings; 0: unknown', 'm/s', 0.0, 1e3
    )
    for cylinder in convention.CYLINDERS:
        yield from _cylinder_descriptors(cylinder)
    force = convention.CONTACT_FORCE
    yield Descriptor(
        f'{force}.seal_play',
        2e-6,
        'half of the backlash between displacement and seals: half a bit of the sensor, or three standard deviations '
        'of its noise',
        'm',
        0.0,
        1e-3,
    )
    yield from _effect_descriptors(force, FORCE_PARTS)


def _cylinder_descriptors(name: str) -> Iterator[Descriptor]:
    yield Descriptor(
        f'{name}.enabled',
        True,
        'whether the device has this cylinder; false: the force is computed with ambient pressure instead',
        at_start=True,
    )
    yield Descriptor(
        f'{name}.initial_setpoint',
        10.0 * PSI,
        'gauge set-point until the first message arrives',
        'Pa',
        -1e5,
        2e6,
        remark='gauge',
        at_start=True,
    )
    yield Descriptor(f'{name}.setpoint_offset', 0.0, 'pressure at rest minus set-point', 'Pa', -1e5, 1e5)
    yield Descriptor(
        f'{name}.setpoints',
        tuple(TABLE_1.setpoints.tolist()),
        'gauge set-points at which the gains are given',
        'Pa',
        constraints='finite, strictly increasing',
        remark='gauge',
    )
    for spec in SPECS:
        yield Descriptor(
            f'{name}.{spec.name}',
            tuple(getattr(TABLE_1, spec.name).tolist()),
            f'{spec.description}, a value for each set-point',
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
        f'{name}.not_identifiable',
        NO_NAMES,
        'gains that the recordings do not determine: their values are those assumed in the fit',
    )
    yield from _effect_descriptors(name, PRESSURE_PARTS)


def _effect_descriptors(prefix: str, library: Mapping[str, Effect]) -> Iterator[Descriptor]:
    """Yield the switches and parameters of cores and effects; an effect with default parameters changes nothing."""
    for effect in library.values():
        default = (
            'its gains are valid at a pressure and a position'
            if effect.core
            else 'its default parameters change nothing'
        )
        yield Descriptor(f'{prefix}.{effect.name}.enabled', False, f'{effect.description}; {default}')
        for parameter in effect.parameters:
            yield Descriptor(
                f'{prefix}.{effect.name}.{parameter.name}',
                float(parameter.null),
                f'{effect.description}: {parameter.description}',
                parameter.unit,
                parameter.lower,
                parameter.upper,
            )


DESCRIPTORS: Mapping[str, Descriptor] = {descriptor.name: descriptor for descriptor in _device_descriptors()}
"""Descriptors by name, in the order of a parameter file."""
