"""
Mapping files: where a bag or a table of another make keeps the signals.

A mapping is YAML, with an entry for each signal. For a bag::

    types: msgs                  # folder with PACKAGE/msg/NAME.msg files, where the bag lacks its messages' definitions
    displacement:
      topic: /press/axes
      field: axes[0].position    # obvious for JointState, FluidPressure, WrenchStamped, Float64; else needed
      unit: inch
      scale: 1/3.1736            # units in one raw unit: here inches in a volt
      offset: -0.5               # in the same unit
      sign: -1                   # +x grows cylinder A; -1 where the sensor's reading falls then
    cylinder_a:
      pressure:
        topic: /press/analog
        field: data[3]
        unit: psi
        scale: 25/5              # 25 psi in 5 V
        reference: gauge         # or absolute
        time_offset: -0.002      # seconds, added to the times
        stamp: t_us              # where the time is, if not in a header; `receive` for the time of reception
        stamp_unit: us
      setpoint: {topic: /press/regulator, unit: bar, reference: gauge}
    cylinder_b:
      pressure: {topic: /press/pressure_b, unit: Pa, reference: absolute}
    force: {topic: /press/load_cell, field: wrench.force.z, unit: N}
    others:                      # what a measured channel of your own is of, by names of your own
      tool_force: {topic: /press/second_cell, unit: N}

For a table, with columns by number (from 1 on) or, where there are header rows, by name::

    table:
      time: {column: 1, unit: ms}
      delimiter: ','             # white space if not given
      header_rows: 1             # the last of them names the columns
      skip_rows: 15              # samples dropped at the beginning
    displacement: {column: laser, unit: mm, sign: -1}
    cylinder_a:
      pressure: {column: 6, unit: bar, reference: gauge}

All rows of a table have the same number of fields, as many as the header has names; numbers have decimal points.

A number becomes ``sign * (scale * raw + offset)`` in `unit`. `displacement` and the pressure of a cylinder are needed,
the rest is optional. A `setpoint` acts from its time on; a `setpoint_applied` acted up to its time, since the one
before. A topic without a leading slash is relative to the namespace that the reader is given. An array's entry that has
a name can be given by it, as in ``position[piston]``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cfd_pneumatic import units
from cfd_pneumatic.convention import CYLINDERS, ROLES
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.fields import parse_path
from cfd_pneumatic.recording.sources import OTHER, SignalSource
from cfd_pneumatic.recording.table import TableFormat
from cfd_pneumatic.yaml_files import read_yaml

_OF_CYLINDER = tuple(role.name for role in ROLES.values() if role.of_cylinder)
_OF_DEVICE = tuple(role.name for role in ROLES.values() if not role.of_cylinder)
_DELIMITERS = {'space': None, 'whitespace': None, 'tab': '\t', 'comma': ',', 'semicolon': ';'}

_NUMBER_KEYS = ('unit', 'scale', 'offset', 'sign', 'time_offset')
_TOPIC_KEYS = ('topic', 'field', 'stamp', 'stamp_unit')
_TABLE_KEYS = ('time', 'delimiter', 'header_rows', 'skip_rows')


@dataclass(frozen=True)
class ChannelMapping:
    """
    Where a bag or a table keeps the signals.

    Attributes
    ----------
    path : Path
        The file it was read from.
    channels : tuple of SignalSource
        The signals.
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
        A YAML file as the module describes it.

    Raises
    ------
    InputError
        If it can't be read or something in it can't be meant: the message names the file, the entry and the key.

    """
    path = Path(path)
    content = read_yaml(path)
    try:
        return _mapping(path, _Entry('', content))
    except InputError as error:
        raise InputError(f'{path}: {error}') from error


class _Entry:
    """A part of the file and its name, which every message about it begins with."""

    def __init__(self, name: str, content: object) -> None:
        self.name = name
        if not isinstance(content, dict):
            raise self.error(f'must hold keys and values, not {content!r}')
        self.content: dict[str, Any] = content

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, text: str) -> InputError:
        """Return an error about this part."""
        return InputError(f'{self.name}: {text}' if self.name else text)

    def check_keys(self, *known: str) -> None:
        """Raise if there is a key that isn't known."""
        for key in self.content:
            if key not in known:
                raise self.error(f'unknown key {key!r}: the keys are {", ".join(known)}')

    def inner(self, key: str) -> _Entry:
        """Return the part under a key."""
        return _Entry(f'{self.name}.{key}' if self.name else key, self._value(key))

    def text(self, key: str) -> str:
        """Return a text that is needed."""
        value = self._value(key)
        if not isinstance(value, str) or not value:
            raise self.error(f'{key} must be a text, not {value!r}')
        return value

    def number(self, key: str, default: float) -> float:
        """Return a number, which may be written as a fraction."""
        value = self.content.get(key, default)
        try:
            numerator, _, denominator = str(value).partition('/')
            number = float(numerator) / float(denominator or 1)
        except (ValueError, ZeroDivisionError):
            number = math.nan
        if isinstance(value, bool) or not math.isfinite(number):
            raise self.error(f'{key} must be a number, not {value!r}')
        return number

    def count(self, key: str) -> int:
        """Return a number of rows, 0 if not given."""
        value = self.content.get(key, 0)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise self.error(f'{key} must be a number of rows, not {value!r}')
        return value

    def choice(self, key: str, choices: tuple[object, ...]) -> object:
        """Return one of several values that is needed."""
        value = self._value(key)
        if value not in choices or isinstance(value, bool):
            raise self.error(f'{key} must be {" or ".join(map(str, choices))}, not {value!r}')
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
            raise self.error(f'column must be a name or a number from 1 on, not {value!r}')
        return value

    def unit(self, quantity: str, key: str = 'unit') -> float:
        """Return what a unit is in SI."""
        name = self.text(key)
        try:
            return units.factor(name, quantity)
        except InputError as error:
            raise self.error(str(error)) from error

    def _value(self, key: str) -> object:
        if key not in self.content:
            raise self.error(f'{key} is missing')
        return self.content[key]


def _mapping(path: Path, root: _Entry) -> ChannelMapping:
    root.check_keys(*_OF_DEVICE, *CYLINDERS, 'others', 'table', 'types')
    table = _table(root.inner('table')) if 'table' in root else None
    root.inner('displacement')
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
        others = root.inner('others')
        channels += [_channel(others.inner(name), OTHER, name, table) for name in others.content]
    types = (path.parent / root.text('types')).absolute() if 'types' in root else None
    if types is not None and not types.is_dir():
        raise root.error(f'types: {types} is not a folder')
    return ChannelMapping(path, tuple(channels), table, types)


def _table(entry: _Entry) -> TableFormat:
    entry.check_keys(*_TABLE_KEYS)
    time = entry.inner('time')
    time.check_keys('column', 'unit')
    delimiter = entry.text('delimiter') if 'delimiter' in entry else 'space'
    delimiter_ = _DELIMITERS.get(delimiter, delimiter)
    if delimiter_ is not None and len(delimiter_) != 1:
        raise entry.error(f'delimiter must be one character or one of {", ".join(_DELIMITERS)}, not {delimiter!r}')
    return TableFormat(
        time=time.column(),
        time_unit=time.unit('time'),
        delimiter=None if delimiter_ == ' ' else delimiter_,
        header_rows=entry.count('header_rows'),
        skip_rows=entry.count('skip_rows'),
    )


def _channel(entry: _Entry, role: str, cylinder: str | None, table: TableFormat | None) -> SignalSource:
    source_keys = _TOPIC_KEYS if table is None else ('column',)
    quantity = ROLES[role].quantity if role in ROLES else units.quantity(entry.text('unit'))
    pressure = quantity == 'pressure'
    entry.check_keys(*source_keys, *_NUMBER_KEYS, *(('reference',) if pressure else ()))
    source = entry.text('topic') if table is None else entry.column()
    sign = entry.choice('sign', (1, -1)) if 'sign' in entry else 1
    unit = entry.unit(quantity) * (-1.0 if sign == -1 else 1.0)
    return SignalSource(
        role=role,
        cylinder=cylinder,
        source=source,
        field=_path(entry, 'field'),
        stamp=_path(entry, 'stamp'),
        stamp_unit=entry.unit('time', 'stamp_unit') if 'stamp_unit' in entry else 1.0,
        gain=_scale(entry) * unit,
        bias=entry.number('offset', 0.0) * unit,
        gauge=pressure and entry.choice('reference', ('gauge', 'absolute')) == 'gauge',
        time_offset=entry.number('time_offset', 0.0),
    )


def _scale(entry: _Entry) -> float:
    scale = entry.number('scale', 1.0)
    if scale == 0.0:
        raise entry.error('scale must not be 0: it is what one raw unit is in `unit`')
    return scale


def _path(entry: _Entry, key: str) -> str | None:
    if key not in entry:
        return None
    try:
        return str(parse_path(entry.text(key)))
    except InputError as error:
        raise entry.error(f'{key}: {error}') from error
