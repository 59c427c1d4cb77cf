# SPDX-License-Identifier: Apache-2.0
"""
Field paths, which select a number of a message.

A path is a sequence of names separated by dots, with an array's entry in brackets: ``wrench.force.x``, ``data[3]``,
``sensors[1].pressure``. If a message has names for its array entries, as JointState has in ``name``, the path may
give an entry by its name: ``position[piston]``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages.types import HEADER, TIME

NAMES = 'name'
"""Field with the names of the entries of the arrays in the same message."""

NUMBERS = {
    'bool': 'u1',
    'byte': 'u1',
    'char': 'u1',
    'int8': 'i1',
    'uint8': 'u1',
    'int16': 'i2',
    'uint16': 'u2',
    'int32': 'i4',
    'uint32': 'u4',
    'int64': 'i8',
    'uint64': 'u8',
    'float32': 'f4',
    'float64': 'f8',
}
"""NumPy's name of each number type of messages, without the byte order."""

_STEP = re.compile(r'(?P<name>[A-Za-z]\w*)(\[(?P<index>[^\[\]]+)\])?')
_NUMBER = re.compile(r'[0-9]{1,9}')
_MAX_LISTED = 30


@dataclass(frozen=True)
class Step:
    """A step of a path: a field, and the entry if the field is an array."""

    name: str
    index: int | str | None = None

    def __str__(self) -> str:
        """Return the step as text."""
        return self.name if self.index is None else f'{self.name}[{self.index}]'


@dataclass(frozen=True)
class FieldPath:
    """A path of steps from a message to a number in it."""

    steps: tuple[Step, ...]

    def __str__(self) -> str:
        """Return the path as text."""
        return '.'.join(map(str, self.steps))

    @property
    def field(self) -> str:
        """The names of the path, without array entries."""
        return '.'.join(step.name for step in self.steps)


def parse_path(text: str) -> FieldPath:
    """
    Parse the text of a field path.

    Raises
    ------
    InputError
        If the text is not a field path.

    """
    steps = []
    for part in re.split(r'\.(?![^\[]*\])', text):
        match = _STEP.fullmatch(part.strip())
        if match is None:
            raise InputError('is not a field path: write it like wrench.force.x or data[3]')
        index = match['index']
        steps.append(Step(match['name'], int(index) if index is not None and _NUMBER.fullmatch(index) else index))
    return FieldPath(tuple(steps))


def has_header(types: Typestore, msgtype: str) -> bool:
    """Return whether a message type has a std_msgs/Header named `header`."""
    return dict(types.fielddefs[msgtype][1]).get('header') == (Nodetype.NAME, HEADER)


def is_time(types: Typestore, msgtype: str, path: FieldPath) -> bool:
    """Return whether a path leads to a builtin_interfaces/Time."""
    return _target(types, msgtype, path) == (Nodetype.NAME, TIME)


def check_number(types: Typestore, msgtype: str, path: FieldPath) -> None:
    """
    Make sure that a path leads to a number.

    Raises
    ------
    InputError
        If the path does not lead to a number. The message lists the existing fields and does not quote the path.

    """
    kind, detail = _target(types, msgtype, path)
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        raise InputError(f'field {path.field} of {msgtype} is an array: give an entry, such as {path.field}[0]')
    if kind == Nodetype.NAME:
        raise InputError(f'field {path.field} of {msgtype} is a message: {list_numbers(types, msgtype)}')
    if detail[0] not in NUMBERS:
        numbers = list_numbers(types, msgtype)
        raise InputError(f'field {path.field} of {msgtype} is a {detail[0]}, not a number: {numbers}')


def list_numbers(types: Typestore, msgtype: str) -> str:
    """Return a sentence that lists the numbers of a message type."""
    numbers = list(islice(_numbers(types, msgtype), _MAX_LISTED + 1))
    listed = ', '.join(numbers[:_MAX_LISTED]) + (', ...' if len(numbers) > _MAX_LISTED else '')
    return f'its numbers are {listed}' if numbers else 'it has no numbers'


def _target(types: Typestore, msgtype: str, path: FieldPath) -> FieldDesc:
    """Return the definition of the field that a path leads to."""
    target: FieldDesc = (Nodetype.NAME, msgtype)
    for step in path.steps:
        fields = dict(types.fielddefs[target[1]][1]) if target[0] == Nodetype.NAME else {}
        if step.name not in fields:
            raise InputError(f'{msgtype} has no such field: {list_numbers(types, msgtype)}')
        target = fields[step.name]
        if step.index is None:
            continue
        if target[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            raise InputError(f'field {step.name} of {msgtype} is not an array: {list_numbers(types, msgtype)}')
        element, length = target[1]
        if target[0] == Nodetype.ARRAY and isinstance(step.index, int) and step.index >= length:
            raise InputError(f'the array {step.name} of {msgtype} has {length} entries: the first is {step.name}[0]')
        if isinstance(step.index, str) and not _is_list_of_names(fields.get(NAMES)):
            raise InputError(f'the entries of {step.name} in {msgtype} have no names: give a number, {step.name}[0]')
        target = element
    return target


def _is_list_of_names(desc: FieldDesc | None) -> bool:
    if desc is None or desc[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return False
    element = desc[1][0]
    return element[0] == Nodetype.BASE and element[1][0] == 'string'


def _numbers(types: Typestore, msgtype: str, prefix: str = '') -> Iterator[str]:
    """Yield the paths of all numbers of a message type."""
    for name, desc in types.fielddefs[msgtype][1]:
        path = f'{prefix}{name}'
        if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            path, desc = f'{path}[0]', desc[1][0]
        if desc[0] == Nodetype.NAME:
            yield from _numbers(types, desc[1], f'{path}.')
        elif desc[1][0] in NUMBERS:
            yield path
