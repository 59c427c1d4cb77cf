# SPDX-License-Identifier: Apache-2.0
"""
Read a path from a table: text with a column of positions or times, and a column of errors or displacements.

The head names the columns, each with its unit: `along_m,error_mm` or `time_s,displacement_mm`.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError, quoted
from cfd_pneumatic.files import open_input
from cfd_pneumatic.path.motion import MOST_POINTS, PathMotion, Surface
from cfd_pneumatic.recording import bounded_lines, count_of, encoding_of, listed
from cfd_pneumatic.units import UNITS

_LARGEST = 2**30
"""Size of a table [bytes]."""

_LONGEST_LINE = 2**20
"""Longest line of a table [characters]; a path has few columns."""

_DELIMITERS = ('\t', ';', ',')
_BLANK = ' \r\n\t;,'  # characters of a line without fields
_HEADS = 'along_m,error_mm or time_s,displacement_mm'


@dataclass(frozen=True)
class _Kind:
    """A kind of table: the quantities of its two columns, and what is made of them."""

    base: str
    value: str
    make: Callable[[Array, Array], Surface | PathMotion]

    def is_in(self, names: Sequence[str]) -> bool:
        """Return whether a head has both columns, with any units."""
        return all(any(name.startswith(f'{wanted}_') for name in names) for wanted in (self.base, self.value))


_KINDS = (_Kind('along', 'error', Surface), _Kind('time', 'displacement', PathMotion))
_QUANTITIES = {'along': 'length', 'error': 'length', 'time': 'time', 'displacement': 'length'}
"""Quantity of the unit of each column."""


@dataclass(frozen=True)
class _Column:
    """A column: its position from 0 on, its name in the head, and its unit [SI]."""

    position: int
    name: str
    unit: float


def read_path_table(path: Path) -> Surface | PathMotion:
    """
    Read a path from a table.

    Positions and times are shifted so that they begin at 0.

    Raises
    ------
    InputError
        If the file cannot be read, lacks the columns, or its numbers do not make a path.

    """
    encoding = encoding_of(path, 'is neither a text file nor a bag: give a table as CSV, or a bag')
    with TextIOWrapper(open_input(path, _LARGEST), encoding, newline='') as stream:
        try:
            return _read(_lines(stream))
        except UnicodeError as error:
            raise InputError('is not text all through: save it as CSV in UTF-8') from error


def _lines(stream: TextIOWrapper) -> Iterator[str]:
    """Yield the lines of a table, with an empty line in place of a comment; a head may be a comment."""
    for line in bounded_lines(stream, _LONGEST_LINE):
        if line.lstrip().startswith('#'):
            content = line.lstrip(' \t#')
            yield content if _is_head(content) else '\n'
        else:
            yield line


def _is_head(line: str) -> bool:
    """Return whether a line names the columns of a path, as NumPy's `savetxt` writes them in a comment."""
    return any(kind.is_in(line.replace(delimiter, ' ').split()) for delimiter in _DELIMITERS for kind in _KINDS)


def _read(lines: Iterator[str]) -> Surface | PathMotion:
    """Return the path in the lines of a table."""
    begin, head = next(((number, line) for number, line in enumerate(lines, 1) if line.strip(_BLANK)), (0, ''))
    if not begin:
        raise InputError(f'has no rows: begin with a line such as {_HEADS}')
    delimiter, names = _split_head(head)
    kind, base, value = _find_columns(names)
    decimal = '.' if delimiter == ',' else ','
    positions, values = array('d'), array('d')
    first, last = 0.0, -math.inf
    for line, fields in _rows(lines, begin, len(names), delimiter):
        position, error = (_number(fields[column.position], line, column, decimal) for column in (base, value))
        first = position if not positions else first
        if not last < position - first < math.inf:
            raise InputError(
                f'line {line}: {base.name} must increase from row to row, and {quoted(fields[base.position])} does '
                'not: sort the rows, and remove repeated ones'
            )
        last = position - first
        positions.append(last)
        values.append(error)
        if len(positions) > MOST_POINTS:
            raise InputError(f'has more than {MOST_POINTS:,} rows: write fewer points')
    if len(positions) < 2:
        raise InputError(f'has {count_of(len(positions), "row")} below its head: a path needs at least 2')
    return kind.make(np.array(positions), np.array(values))


def _split_head(head: str) -> tuple[str, list[str]]:
    """Return the delimiter of a table and the names in its head."""
    splits = {delimiter: _names(head, delimiter) for delimiter in _DELIMITERS}
    known = [delimiter for delimiter, names in splits.items() if any(kind.is_in(names) for kind in _KINDS)]
    delimiter = known[0] if known else max(splits, key=lambda delimiter: len(splits[delimiter]))
    return delimiter, splits[delimiter]


def _names(head: str, delimiter: str) -> list[str]:
    """Return the names in a head, without empty names at the end."""
    try:
        names = [name.strip() for name in next(csv.reader([head], delimiter=delimiter, skipinitialspace=True))]
    except csv.Error as error:
        raise InputError(f'has no head: begin with a line such as {_HEADS}') from error
    while names and not names[-1]:
        del names[-1]
    return names


def _find_columns(names: Sequence[str]) -> tuple[_Kind, _Column, _Column]:
    """Return the kind of a table and its two columns."""
    found = [kind for kind in _KINDS if kind.is_in(names)]
    if not found:
        shown = quoted(listed(names)) if names else 'no names'
        raise InputError(f'has the head {shown}: its first line must name the columns, as in {_HEADS}')
    if len(found) > 1:
        raise InputError('has columns of a surface (along, error) and of a motion (time, displacement): remove a pair')
    return found[0], _find_column(names, found[0].base), _find_column(names, found[0].value)


def _find_column(names: Sequence[str], wanted: str) -> _Column:
    """Return the column of a position, time, error or displacement."""
    units = {f'{wanted}_{name}': unit.si for name, unit in UNITS.items() if unit.quantity == _QUANTITIES[wanted]}
    columns = [_Column(position, name, units[name]) for position, name in enumerate(names) if name in units]
    if not columns:
        unknown = next(name for name in names if name.startswith(f'{wanted}_'))
        raise InputError(f'has the column {quoted(unknown)} of unknown unit: name it one of {", ".join(units)}')
    if len(columns) > 1:
        found = listed([column.name for column in columns])
        raise InputError(f'has {len(columns)} columns of {wanted} ({found}): remove all but one')
    return columns[0]


def _rows(lines: Iterator[str], begin: int, width: int, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """
    Yield the rows below the head that are not empty: the number of the line at which the row ends, and its fields.

    Parameters
    ----------
    lines
        Lines below the head.
    begin
        Number of the head's line.
    width
        Number of the head's names; each row has as many fields. Further fields must be empty.
    delimiter
        Character between the fields.

    """
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        for fields in rows:
            if not ''.join(fields).strip():
                continue
            if len(fields) < width or ''.join(fields[width:]).strip():
                raise InputError(
                    f'line {begin + rows.line_num} has {count_of(len(fields), "field")}, but the head has {width}: '
                    'with decimal commas, separate the columns by semicolons'
                )
            yield begin + rows.line_num, fields
    except csv.Error as error:
        raise InputError(f'line {begin + rows.line_num} is not a row of a table: check its quotation marks') from error


def _number(text: str, line: int, column: _Column, decimal: str) -> float:
    """Return the number in a field [SI]; its decimal character is a point or `decimal`."""
    text = text.strip()
    try:
        if '_' in text or not text.isascii():
            raise ValueError
        number = column.unit * float(text.replace(decimal, '.'))
    except ValueError:
        content = f'holds {quoted(text)}' if text else 'is empty'
        raise InputError(f'line {line}: {column.name} {content}: write a number') from None
    if not math.isfinite(number):
        raise InputError(f'line {line}: {column.name} is not finite: write a number, or remove the line')
    return number
