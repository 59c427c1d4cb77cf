# SPDX-License-Identifier: Apache-2.0
"""Write recordings as tables of several formats, each with its mapping file."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from cfd_pneumatic.files import write_text
from studies.foreign.cylinder import AMBIENT
from studies.foreign.devices import Recorded
from studies.foreign.excitation import Array

SI = {'mm': 1e-3, 'um': 1e-6, 'inch': 0.0254, 'psi': 6894.757293, 'kPa': 1e3, 'bar': 1e5, 'N': 1.0, 'lbf': 4.4482216}
"""Units in SI."""

START = datetime.datetime(2024, 5, 1, 12, 0, 0)
"""Date of the first sample in tables with dates."""


class Quantity(NamedTuple):
    """
    How a table holds a quantity: SI value = unit x sign x (scale x number + offset).

    Attributes
    ----------
    unit, scale, offset, sign
        As in a mapping file.
    digits
        Digits after the decimal point.
    reference
        `gauge` or `absolute` for pressures.

    """

    unit: str
    digits: int
    reference: str = ''
    scale: float = 1.0
    offset: float = 0.0
    sign: int = 1

    def texts(self, values: Array) -> list[str]:
        """Return SI values as texts."""
        gauge = values - AMBIENT if self.reference == 'gauge' else values
        numbers = (gauge / SI[self.unit] * self.sign - self.offset) / self.scale
        return [f'{number:.{self.digits}f}' for number in numbers.tolist()]

    def mapping(self, column: str | int) -> dict[str, Any]:
        """Return the entry of a mapping file."""
        entry: dict[str, Any] = {'column': column, 'unit': self.unit}
        if self.reference:
            entry['reference'] = self.reference
        changed = {'scale': (self.scale, 1.0), 'offset': (self.offset, 0.0), 'sign': (self.sign, 1)}
        return entry | {key: value for key, (value, default) in changed.items() if value != default}


class Format(NamedTuple):
    """
    Form of a table.

    Attributes
    ----------
    delimiter, delimiter_name
        Character between columns, and its name in a mapping file.
    time
        Unit of the time; `date`, or empty without a column of times.
    header
        Names of the time, displacement, force, pressure and set-point columns; empty without header rows.
    title
        Row above the names of the columns, or empty.
    decimal_comma
        Whether numbers have decimal commas.

    """

    delimiter: str
    delimiter_name: str
    time: str
    header: tuple[str, ...]
    title: str
    decimal_comma: bool
    displacement: Quantity
    pressure: Quantity
    force: Quantity


FORMATS = {
    'german': Format(
        ';', 'semicolon', 'ms', ('Zeit [ms]', 'Weg [mm]', 'Kraft [N]', 'Druck [psi]', 'Soll [psi]'), '', True,
        Quantity('mm', 4, offset=12.0), Quantity('psi', 4, 'gauge'), Quantity('N', 3),
    ),
    'laboratory': Format(
        '\t', 'tab', 's', ('t', 'position um', 'load N', 'p bar', 'p_ref bar'), 'Bench 3, channel list', False,
        Quantity('um', 2), Quantity('bar', 6, 'absolute'), Quantity('N', 4),
    ),
    'logger': Format(
        ',', 'comma', 'date', ('Timestamp', 'LVDT (in)', 'Load (lbf)', 'P (kPa)', 'SP (kPa)'), '', False,
        Quantity('inch', 6, sign=-1), Quantity('kPa', 3, 'gauge'), Quantity('lbf', 4),
    ),
    'volts': Format(
        ' ', 'whitespace', '', (), '', False,
        Quantity('mm', 5, scale=5.0, offset=-25.0), Quantity('bar', 6, 'gauge', 2.5, -1.0),
        Quantity('N', 5, scale=20.0),
    ),
}  # fmt: skip
"""Formats of tables by name: times in ms, in s, as dates, and none; a force column if the device has a force."""


def write_table(recorded: Recorded, name: str, folder: Path) -> tuple[Path, Path]:
    """Write a table and its mapping file into a folder; return their paths."""
    layout = FORMATS[name]
    columns: list[list[str]] = []
    names: list[str] = []

    def add(title: int, texts: list[str], suffix: str = '') -> str | int:
        """Add a column; return its name, or its number without a header."""
        columns.append(texts)
        names.append(layout.header[title] + suffix if layout.header else '')
        return names[-1] if layout.header else len(columns)

    mapping: dict[str, Any] = {'table': _table_keys(layout, recorded.times)}
    if layout.time:
        mapping['table']['time'] = {'column': add(0, _times(recorded.times, layout.time)), 'unit': layout.time}
    mapping['displacement'] = layout.displacement.mapping(add(1, layout.displacement.texts(recorded.displacement)))
    for letter, pressure, setpoint in zip('ab', recorded.pressures, recorded.setpoints):
        suffix = f' {letter.upper()}' if len(recorded.pressures) > 1 else ''
        mapping[f'cylinder_{letter}'] = {
            'pressure': layout.pressure.mapping(add(3, layout.pressure.texts(pressure), suffix)),
            'setpoint': layout.pressure.mapping(add(4, layout.pressure.texts(setpoint), suffix)),
        }
    if recorded.force is not None:
        mapping['force'] = layout.force.mapping(add(2, layout.force.texts(recorded.force)))
    rows = [layout.delimiter.join(row) for row in zip(*columns)]
    text = '\n'.join(rows) + '\n'
    if layout.decimal_comma:
        text = text.replace('.', ',')
    head = [layout.title] * bool(layout.title) + [layout.delimiter.join(names)] * bool(layout.header)
    table_path, mapping_path = folder / 'table.csv', folder / 'mapping.yaml'
    write_text(table_path, ''.join(f'{line}\n' for line in head) + text)
    write_text(mapping_path, yaml.safe_dump(mapping, sort_keys=False, allow_unicode=True))
    return table_path, mapping_path


def _table_keys(layout: Format, times: Array) -> dict[str, Any]:
    keys: dict[str, Any] = {'delimiter': layout.delimiter_name}
    if layout.header:
        keys['header_rows'] = 2 if layout.title else 1
    if layout.decimal_comma:
        keys['decimal'] = 'comma'
    if not layout.time:
        keys['sample_period'] = round(float(times[1] - times[0]), 6)
    return keys


def _times(times: Array, unit: str) -> list[str]:
    """Return times [s] as texts."""
    if unit == 'date':
        stamps = (START + datetime.timedelta(milliseconds=round(1e3 * time)) for time in times.tolist())
        return [stamp.isoformat(' ', 'milliseconds') for stamp in stamps]
    factor, digits = {'ms': (1e3, 2), 's': (1.0, 4)}[unit]
    return [f'{factor * time:.{digits}f}' for time in np.asarray(times).tolist()]
