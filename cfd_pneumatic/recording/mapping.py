# SPDX-License-Identifier: Apache-2.0
"""
Mapping files, which describe the signals of a bag or table that does not follow our convention.

A mapping is YAML with an entry for each signal. docs/reference/mapping.md has examples, and the keys that are
documented here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from cfd_pneumatic.arguments import check_path
from cfd_pneumatic.convention import CYLINDERS, ROLES
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import YamlMapping, read_yaml
from cfd_pneumatic.messages import parse_path
from cfd_pneumatic.recording.sources import OTHER, SignalSource
from cfd_pneumatic.recording.table_format import TableFormat
from cfd_pneumatic.units import UNITS, Unit

_OF_CYLINDER = tuple(role.name for role in ROLES.values() if role.of_cylinder)
_OF_DEVICE = tuple(role.name for role in ROLES.values() if not role.of_cylinder)
_DELIMITERS = {'space': None, 'whitespace': None, 'tab': '\t', 'comma': ',', 'semicolon': ';'}

TOP_KEYS = {
    **{name: f'the {name}' for name in _OF_DEVICE},
    'displacement': 'the displacement; without it the piston is taken to be at rest',
    **dict.fromkeys(CYLINDERS, 'its `pressure`, which is needed, and `setpoint` or `setpoint_applied`'),
    'others': 'measured channels of your own, by names of your own',
    'table': 'layout of the table; without it the mapping is for bags',
    'types': 'folder with `PACKAGE/msg/NAME.msg` files, where a bag lacks its messages’ definitions',
}
"""Keys of a mapping file."""

NUMBER_KEYS = {
    'unit': 'unit of the number; needed',
    'scale': 'units in one raw unit, `25/5` for 25 psi in 5 V; 1 if not given',
    'offset': 'added in the same unit, after the scale; 0 if not given',
    'sign': '1, or -1 where the sensor counts the other way: +x grows cylinder A',
    'time_offset': 'added to the times [s]; 0 if not given',
}
"""Keys of every signal."""

PRESSURE_KEYS = {'reference': '`gauge` or `absolute`; needed'}
"""Further keys of a pressure."""

COLUMN_KEYS = {'column': 'number of the column, from 1 on, or its name where there are header rows; needed'}
"""Further keys of a signal in a table."""

TOPIC_KEYS = {
    'topic': 'topic; without a leading slash it is relative to the namespace; needed',
    'field': 'path of the number inside the message, such as `axes[0].position` or `position[piston]`; '
    'not needed for JointState, FluidPressure, WrenchStamped and Float64',
    'stamp': 'path of the time, where there is no header; `receive` for the time of reception',
    'stamp_unit': 'unit of a stamp that is a plain number; seconds if not given',
}
"""Further keys of a signal in a bag."""

TABLE_KEYS = {
    'time': '`column` and `unit` of the time (`date` for 2024-05-01 12:00:00.25); optional: `thousands`, `scale`, '
    '`offset`. Counters of 16 and 32 bits that wrap are continued',
    'sample_period': 'time between rows [s], where no column has the time',
    'delimiter': f'one character, or one of {", ".join(_DELIMITERS)}; white space if not given',
    'decimal': '`comma` where numbers are written 1,5; points if not given',
    'thousands': '`point`, `comma`, `space` or `apostrophe` where it groups digits by threes, as in 1.701,21',
    'header_rows': 'rows before the numbers, one of which names the columns; 0 if not given',
    'skip_rows': 'rows of numbers to leave out at the beginning; 0 if not given',
}
"""Keys of `table`."""


_DATE = 'date'
_DECIMALS = {'comma': ',', ',': ',', 'point': '.', '.': '.'}
_THOUSANDS = {'point': '.', '.': '.', 'comma': ',', ',': ',', 'space': ' ', 'apostrophe': "'"}
_MOST_ROWS = 10**9
_LARGEST_NUMBER = 1e30
_LONGEST_OFFSET = 1e9  # thirty years [s]
_LONGEST_KEY = 40  # characters of a key that are compared with the known keys


@dataclass(frozen=True)
class ChannelMapping:
    """
    Mapping of the signals in a bag or table.

    Attributes
    ----------
    path : Path
        File of the mapping.
    channels : tuple of SignalSource
        Sources of the signals.
    table : TableFormat or None
        Layout of the table; None if the mapping is for bags.
    types : Path or None
        Folder with message definitions.

    """

    path: Path
    channels: tuple[SignalSource, ...]
    table: TableFormat | None = None
    types: Path | None = None


def read_mapping(path: Path | str) -> ChannelMapping:
    """
    Read a mapping file.

    Parameters
    ----------
    path : Path or str
        A YAML file; see docs/reference/mapping.md.

    Raises
    ------
    InputError
        If the file cannot be read or has an invalid entry. The message names the file, the line, the entry and the key,
        and quotes no values.

    """
    check_path('path', path)
    path = Path(path)
    content = read_yaml(path)
    try:
        return _mapping(path, _Entry('', content))
    except InputError as error:
        raise InputError(f'{path}: {error}') from error


class _Entry:
    """A named part of the file; messages on the part begin with its name."""

    def __init__(self, name: str, content: object, line: int = 0) -> None:
        self._name = name
        if content is None:
            raise self._error('is empty: it must hold keys and values', line)
        if not isinstance(content, YamlMapping):
            raise self._error(f'must hold keys and values, not {_kind_of(content)}', line)
        self._line = line or content.line
        self.content = content

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, text: str, key: str = '') -> InputError:
        """Return an error on this part, or on the value of a key; the error does not quote the value."""
        return self._error(f'{key} {text}' if key else text, self.content.lines.get(key, self._line))

    def check_keys(self, *known: str) -> None:
        """Raise an error for an unknown key."""
        for key in self.content:
            if key not in known:
                near = get_close_matches(str(key)[:_LONGEST_KEY].lower(), known, n=1)
                suggestion = f', did you mean {near[0]}? The' if near else ': the'
                raise self._error(f'unknown key{suggestion} keys are {", ".join(known)}', self.content.lines[key])

    def inner(self, key: str, shown: str = '') -> _Entry:
        """Return the part under a key; messages name the part `shown` if given."""
        name = shown or key
        value = self._value(key)
        return _Entry(f'{self._name}.{name}' if self._name else name, value, self.content.lines[key])

    def text(self, key: str) -> str:
        """Return a mandatory text."""
        value = self._value(key)
        if not isinstance(value, str) or not value:
            raise self.error(f'must be a text, not {_kind_of(value)}', key)
        return value

    def number(self, key: str, default: float, largest: float = _LARGEST_NUMBER) -> float:
        """Return a number, which may be written as a fraction."""
        value = self.content.get(key, default)
        try:
            numerator, _, denominator = str(value).partition('/')
            number = float(numerator) / float(denominator or 1)
        except (ValueError, ZeroDivisionError):
            number = math.nan
        if isinstance(value, bool) or not math.isfinite(number):
            raise self.error('must be a finite number, or a fraction of two', key)
        if abs(number) > largest:
            raise self.error(f'must be between -{largest:g} and {largest:g}', key)
        return number

    def count(self, key: str) -> int:
        """Return a number of rows, 0 if not given."""
        value = self.content.get(key, 0)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= _MOST_ROWS:
            raise self.error(f'must be a number of rows, from 0 to {_MOST_ROWS:,}', key)
        return value

    def choice(self, key: str, choices: tuple[object, ...]) -> object:
        """Return a mandatory value, which must be one of the choices."""
        value = self._value(key)
        if value not in choices or isinstance(value, bool):
            raise self.error(f'must be {_either(choices)}', key)
        return value

    def column(self) -> str | int:
        """Return the column, by name or by number from 1 on."""
        value = self._value('column')
        if (
            isinstance(value, bool)
            or not isinstance(value, (str, int))
            or value in ('', 0)
            or str(value).startswith('-')
        ):
            raise self.error('must be a name or a number from 1 on', 'column')
        return value

    def unit(self, quantity: str | None, key: str = 'unit') -> Unit:
        """Return a mandatory unit, of a given quantity or of any quantity."""
        known = [name for name, unit in UNITS.items() if quantity in (None, unit.quantity)]
        name = self.text(key)
        if name not in known:
            raise self.error(f'must be a unit{f" of {quantity}" if quantity else ""}: {_either(known)}', key)
        return UNITS[name]

    def _value(self, key: str) -> object:
        if key not in self.content:
            raise self.error('is missing', key)
        return self.content[key]

    def _error(self, text: str, line: int) -> InputError:
        return InputError(': '.join(filter(None, (f'line {line}' if line else '', self._name, text))))


def _either(choices: Sequence[object]) -> str:
    """Return the choices as text, with an `or` before the last choice."""
    *first_choices, last = map(str, choices)
    return f'{", ".join(first_choices)} or {last}'


def _kind_of(value: object) -> str:
    """Return the kind of a value, for a message that must not quote the value."""
    kinds: tuple[tuple[type | tuple[type, ...], str], ...] = (
        (dict, 'keys and values'),
        (list, 'a list'),
        (str, 'a text'),
        (bool, 'true or false'),
        ((int, float), 'a number'),
        (date, 'a date'),
    )
    return next((text for kind, text in kinds if isinstance(value, kind)), 'nothing')


def _mapping(path: Path, root: _Entry) -> ChannelMapping:
    root.check_keys(*TOP_KEYS)
    table = _table(root.inner('table')) if 'table' in root else None
    channels = [_channel(root.inner(role), role, None, table) for role in _OF_DEVICE if role in root]
    for cylinder in CYLINDERS:
        if cylinder in root:
            entry = root.inner(cylinder)
            entry.check_keys(*_OF_CYLINDER)
            entry.inner('pressure')
            channels += [_channel(entry.inner(role), role, cylinder, table) for role in _OF_CYLINDER if role in entry]
    if not any(channel.cylinder for channel in channels):
        raise root.error(f'{CYLINDERS[0]} is missing: give the pressure of a cylinder')
    if 'others' in root:
        further_signals = root.inner('others')
        for rank, name in enumerate(further_signals.content, start=1):
            entry = further_signals.inner(name, f'entry {rank}')
            channels.append(_channel(entry, OTHER, str(name), table))
    types = (path.parent / root.text('types')).absolute() if 'types' in root else None
    if types is not None and not _is_folder(types):
        raise root.error('must be an existing folder, relative to the folder of this file', 'types')
    return ChannelMapping(path, tuple(channels), table, types)


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:  # a name that is too long
        return False


def _table(entry: _Entry) -> TableFormat:
    entry.check_keys(*TABLE_KEYS)
    if ('time' in entry) == ('sample_period' in entry):
        raise entry.error('needs either `time`, the column of the time, or `sample_period` [s] where there is none')
    delimiter = entry.text('delimiter') if 'delimiter' in entry else 'space'
    delimiter_ = _DELIMITERS.get(delimiter, delimiter)
    if delimiter_ is not None and len(delimiter_) != 1:
        raise entry.error(f'must be one character, {_either(tuple(_DELIMITERS))}', 'delimiter')
    decimal = _DECIMALS[str(entry.choice('decimal', tuple(_DECIMALS)))] if 'decimal' in entry else '.'
    thousands = _THOUSANDS[str(entry.choice('thousands', tuple(_THOUSANDS)))] if 'thousands' in entry else ''
    if thousands == decimal:
        raise entry.error('thousands and decimal are the same character: give different characters')
    return TableFormat(
        **_time(entry),
        thousands=thousands,
        delimiter=None if delimiter_ == ' ' else delimiter_,
        decimal=decimal,
        header_rows=entry.count('header_rows'),
        skip_rows=entry.count('skip_rows'),
    )


def _time(entry: _Entry) -> dict[str, Any]:
    """Return the fields of a `TableFormat` that describe the time."""
    if 'sample_period' in entry:
        period = entry.number('sample_period', 0.0, _LONGEST_OFFSET)
        if period <= 0.0:
            raise entry.error('must be above 0 s', 'sample_period')
        return {'time': None, 'sample_period': period}
    time = entry.inner('time')
    time.check_keys('column', 'unit', 'thousands', 'scale', 'offset')
    return {
        'time': time.column(),
        'time_unit': None if time.content.get('unit') == _DATE else time.unit('time').si,
        'time_scale': _scale(time),
        'time_offset': time.number('offset', 0.0),
        'time_thousands': _THOUSANDS.get(mark := time.text('thousands'), mark) if 'thousands' in time else '',
    }


def _channel(entry: _Entry, role: str, cylinder: str | None, table: TableFormat | None) -> SignalSource:
    source_keys = TOPIC_KEYS if table is None else COLUMN_KEYS
    quantity = ROLES[role].quantity if role in ROLES else entry.unit(None).quantity
    pressure = quantity == 'pressure'
    if table is None and 'column' in entry:
        raise entry.error('`column` is for tables: the mapping needs the entry `table`, with the time')
    entry.check_keys(*source_keys, *NUMBER_KEYS, *(PRESSURE_KEYS if pressure else ()))
    source = entry.text('topic') if table is None else entry.column()
    sign = entry.choice('sign', (1, -1)) if 'sign' in entry else 1
    unit = entry.unit(quantity).si * (-1.0 if sign == -1 else 1.0)
    return SignalSource(
        role=role,
        cylinder=cylinder,
        source=source,
        field=_path(entry, 'field'),
        stamp=_path(entry, 'stamp'),
        stamp_unit=entry.unit('time', 'stamp_unit').si if 'stamp_unit' in entry else 1.0,
        gain=_scale(entry) * unit,
        bias=entry.number('offset', 0.0) * unit,
        unit=entry.text('unit'),
        gauge=pressure and entry.choice('reference', ('gauge', 'absolute')) == 'gauge',
        time_offset=entry.number('time_offset', 0.0, _LONGEST_OFFSET),
    )


def _scale(entry: _Entry) -> float:
    scale = entry.number('scale', 1.0)
    if scale == 0.0:
        raise entry.error('must not be 0: it is the value of one raw unit in `unit`', 'scale')
    return scale


def _path(entry: _Entry, key: str) -> str | None:
    if key not in entry:
        return None
    try:
        return str(parse_path(entry.text(key)))
    except InputError as error:
        raise entry.error(str(error), key) from error
