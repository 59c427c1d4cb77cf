# SPDX-License-Identifier: Apache-2.0
"""Tables: text files with a row for each sample and a column for each signal."""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from cfd_pneumatic.errors import InputError, quoted
from cfd_pneumatic.input_files import open_input
from cfd_pneumatic.recording.bags.messages import NANOSECONDS
from cfd_pneumatic.recording.sources import Samples, SignalSource
from cfd_pneumatic.recording.wording import counted

_MAX_TIME = 2**62
"""Nanoseconds beyond which a time is a mistake."""

_LONGEST_LINE = 2**24
"""Characters of a line beyond which a file is no table."""

_LONGEST_NAME = 40  # characters that are compared
"""Characters of the one field that a message shows."""

_MOST_NAMES = 1_000
"""Columns among which one of a similar name is looked for."""

_LOOKED_AT = 2**16
"""Bytes that tell how a file is encoded."""

_CHECK = 'check delimiter and header_rows in the mapping; numbers with decimal commas need `decimal: comma`'

_DATE = re.compile(
    r'(?:(\d{4})-(\d\d)-(\d\d)[ T])?(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?) ?(?:Z|([+-])(\d\d):?(\d\d))?', re.ASCII
)
_DATES = 'times are to be such as 2024-05-01 12:00:00.25 or 12:00:00.25'
_MOST_ALIKE = 0.1  # share of rows with the time of another
_DAY = 86_400  # seconds
_BEFORE_EPOCH = date(1970, 1, 1).toordinal()


@dataclass(frozen=True)
class TableFormat:
    """
    How a table is laid out.

    Attributes
    ----------
    time : str or int
        Column of the time: its name, or its number from 1 on.
    time_unit : float or None
        Unit of the time [s]; None where the column holds dates, or times of the day.
    thousands : str
        What groups the digits of the time; empty where nothing does.
    delimiter : str or None
        Between columns; None for white space.
    decimal : str
        Before the fraction of a number.
    header_rows : int
        Rows above the samples; the last one with all names that are asked for names the columns.
    skip_rows : int
        Samples to drop at the beginning.

    """

    time: str | int
    time_unit: float | None
    thousands: str = ''
    delimiter: str | None = None
    decimal: str = '.'
    header_rows: int = 0
    skip_rows: int = 0


def read_table(path: Path, layout: TableFormat, channels: Sequence[SignalSource]) -> tuple[list[Samples], list[str]]:
    """
    Return what a table holds for some channels, in their order, and what was amiss.

    Times below zero, as a trigger makes them, are moved up so that the table begins at zero.

    Raises
    ------
    InputError
        If the file can't be read, isn't all numbers in the wanted columns, lacks a column, or has rows of different
        lengths.

    """
    encoding = _encoding(path)
    wanted = [('time', layout.time), *((channel.name, channel.source) for channel in channels)]
    columns, names = _resolve(path, encoding, layout, wanted)
    notes: list[str] = []
    lines = _rows(path, encoding, layout, names, notes)
    try:
        first = next(lines, None)
        if first is None:
            raise InputError('holds no samples')
        rows = np.loadtxt(
            (row for _, row in chain([first], lines)),
            delimiter=layout.delimiter,
            usecols=columns,
            ndmin=2,
            converters=_converters(layout, columns),
            encoding='utf-8',
        )
    except (ValueError, IndexError) as error:
        again = _rows(path, encoding, layout, names, [])
        raise InputError(f'cannot be read as a table of numbers: {_explained(layout, columns, again)}') from error
    rows = rows[layout.skip_rows :]
    timed = np.isfinite(rows[:, 0])
    if not timed.any():
        skipped = ' after those that are skipped' if layout.skip_rows else ' with a time'
        raise InputError(f'holds no samples{skipped}')
    if not timed.all():
        notes.append(f'time: dropped {counted(int(np.sum(~timed)), "row")} not finite')
        rows = rows[timed]
    if layout.time_unit is None and np.max(rows[:, 0]) < _DAY:  # of the day: past midnight
        rows[1:, 0] += _DAY * np.cumsum(np.diff(rows[:, 0]) < -0.5 * _DAY)
    with np.errstate(over='ignore'):
        nanoseconds = np.rint(rows[:, 0] * ((layout.time_unit or 1.0) * NANOSECONDS))
    if np.abs(nanoseconds).max() > _MAX_TIME:
        raise InputError('the times are far too large: check their column and their unit')
    alike = int(np.count_nonzero(np.diff(nanoseconds) == 0.0))
    if alike and alike == len(rows) - 1:
        raise InputError('the time never changes: is its column the time, with all its digits?')
    if alike > _MOST_ALIKE * len(rows):
        notes.append(
            f'time: {alike:,} of {counted(len(rows), "row")} have the time of the row before: were its last digits '
            'cut off, or rows written twice?'
        )
    offsets = [round(channel.time_offset * NANOSECONDS) for channel in channels]
    times = nanoseconds.astype(np.int64)
    times -= min(0, int(times.min()) + min(offsets))
    samples = [
        Samples(channel, times + offset, rows[:, index].copy())
        for index, (channel, offset) in enumerate(zip(channels, offsets), start=1)
    ]
    return samples, notes


def _converters(layout: TableFormat, columns: Sequence[int]) -> dict[int | str, Callable[[str], float]] | None:
    """Return what makes numbers of the fields that are none as they stand."""

    def number(text: str) -> float:
        if '_' in text or (layout.decimal == ',' and '.' in text):  # digits that are grouped
            raise ValueError(text)
        return float(text.replace(layout.decimal, '.'))

    converters: dict[int | str, Callable[[str], float]] = {}
    if layout.decimal == ',':
        converters |= dict.fromkeys(columns, number)
    if layout.time_unit is None:
        converters[columns[0]] = seconds_of
    elif layout.thousands:
        converters[columns[0]] = lambda text: number(text.replace(layout.thousands, ''))
    return converters or None


class _DateError(ValueError):
    """A text is no date."""


def seconds_of(text: str) -> float:
    """
    Return the time of a date such as `2024-05-01 12:00:00.25`, or of a time of the day [s].

    Without a zone it is UTC.

    Raises
    ------
    ValueError
        If it is neither.

    """
    found = _DATE.fullmatch(text.strip().strip('"'))
    if not found:
        raise _DateError(_DATES)
    year, month, day, hours, minutes, seconds, sign, *zone = found.groups()
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _BEFORE_EPOCH if year else 0
    except ValueError as error:
        raise _DateError(_DATES) from error
    ahead = int(f'{sign}1') * (60 * int(zone[0]) + int(zone[1])) if sign else 0
    return days * _DAY + 3600 * int(hours) + 60 * (int(minutes) - ahead) + float(seconds.replace(',', '.'))


def _explained(layout: TableFormat, columns: Sequence[int], rows: Iterator[tuple[int, str]]) -> str:
    """Return which field is no number, and what to look at."""
    converters = _converters(layout, columns) or {}
    with suppress(UnicodeError):  # the error that there was, then
        for line, row in rows:
            fields = row.split(layout.delimiter)
            for column in columns:
                try:
                    converters.get(column, float)(fields[column])
                except ValueError as failed:
                    text = fields[column].strip()
                    fix = str(failed) if isinstance(failed, _DateError) else _fix_of(text, line, layout)
                    return f'line {line}, column {column + 1} holds {quoted(text)}; {fix}'
    return _CHECK


def _fix_of(text: str, line: int, layout: TableFormat) -> str:
    """Return what to look at where a text is no number."""
    if not text:
        return f'write nan where there is no value, or {_CHECK}'
    if _DATE.fullmatch(text):
        return 'if it is the time, `unit: date` reads it'
    if re.fullmatch(r'[+-]?\d*,\d+', text):
        return 'if that is a decimal comma, `table` needs `decimal: comma`'
    if line == layout.header_rows + 1:
        return f'if names or units stand there, `table` needs `header_rows: {line}`; or {_CHECK}'
    return _CHECK


def _rows(
    path: Path, encoding: str, layout: TableFormat, names: Sequence[str], notes: list[str]
) -> Iterator[tuple[int, str]]:
    """
    Yield the rows below the header, each with the number of its line.

    Each has a field for each name, or without names as many as the first row. A last row without a line end is left
    out, and noted: a logger that is switched off may cut a number anywhere.
    """
    delimiter = layout.delimiter
    width, known = len(names), f'the header has {len(names)} names'
    with TextIOWrapper(open_input(path), encoding) as stream:
        for number, line in enumerate(islice(_lines(stream), layout.header_rows, None), layout.header_rows + 1):
            row = line.partition('#')[0].rstrip('\n')
            if not row.strip():
                continue
            if not line.endswith('\n'):
                notes.append('the last row has no line end and may be cut: left out')
                return
            if '"' in row and delimiter is not None:  # within quotes it ends no field
                row = delimiter.join(field.replace(delimiter, ' ') for field in _split(row, delimiter))
            fields = len(row.split()) if delimiter is None else row.count(delimiter) + 1
            if not width:
                width, known = fields, f'the first row has {fields}'
            if fields > width and delimiter is not None:
                fields = max(width, len(row.rstrip(f'{delimiter} ').split(delimiter)))  # empty ones at the end are none
            if fields != width:
                raise InputError(f'line {number} has {counted(fields, "field")}, but {known}: {_CHECK}')
            yield number, row


def _encoding(path: Path) -> str:
    """Return how a file of text is encoded, as far as its beginning tells."""
    with open_input(path) as stream:
        head = stream.read(_LOOKED_AT)
    if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return 'utf-16'
    try:
        getincrementaldecoder('utf-8')().decode(head)
    except UnicodeDecodeError as error:
        if re.search(rb'[\x00-\x08\x0e-\x1f\x7f-\x9f]', head):
            raise InputError('is not a text file, and the mapping is for tables') from error
        return 'latin-1'
    return 'utf-8-sig'


def _resolve(
    path: Path, encoding: str, layout: TableFormat, columns: Sequence[tuple[str, str | int]]
) -> tuple[list[int], list[str]]:
    """Return where the columns of signals are, from 0 on, and the names of all columns where the header has them."""
    try:
        with TextIOWrapper(open_input(path), encoding, newline='') as stream:
            head = list(islice(_lines(stream), layout.header_rows + 1))
    except UnicodeError as error:
        raise InputError('is not a text file, and the mapping is for tables') from error
    if len(head) <= layout.header_rows:
        raise InputError('holds no samples')
    width = len(_split(head[-1], layout.delimiter))
    wanted = {column for _, column in columns if isinstance(column, str)}
    rows = [_names(line, layout) for line in reversed(head[:-1])]
    last = rows[0] if rows else []
    names = next((row for row in rows if wanted <= {*row}), last) if wanted else last  # units may stand below them
    positions = [_position(signal, column, names, width) for signal, column in columns]
    if not wanted and (layout.delimiter is None or len(names) == 1):
        names = []  # perhaps a line of text
    return positions, names


def _names(line: str, layout: TableFormat) -> list[str]:
    """Return the names in a row of the header."""
    names = _split(line.lstrip('# '), layout.delimiter)
    while names and not names[-1]:
        del names[-1]
    return names


def _lines(stream: TextIO) -> Iterator[str]:
    while line := stream.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise InputError(f'has a line of more than {_LONGEST_LINE:,} characters: is it a table?')
        yield line


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as error:
        raise InputError(f'cannot be read as a table; {_CHECK}') from error


def _position(signal: str, column: str | int, names: Sequence[str], width: int) -> int:
    if isinstance(column, int):
        if column > width:
            raise InputError(
                f'has no column of the number that the mapping gives for the {signal}: the first row has {width}; '
                'check the delimiter in the mapping'
            )
        return column - 1
    if column not in names:
        missing = f'has no column of the name that the mapping gives for the {signal}'
        raise InputError(f'{missing}: {_advice(column, names)}')
    if names.count(column) > 1:
        raise InputError(
            f'has {names.count(column)} columns of the name that the mapping gives for the {signal}: '
            'give the number of the one that is meant'
        )
    return names.index(column)


def _advice(column: str, names: Sequence[str]) -> str:
    """Return what to do where a table has no column of a name; of its names the most similar one is shown."""
    if not names:
        return 'for columns by name set header_rows in the mapping'
    if len(names) == 1:
        return 'its header has one name; check the delimiter in the mapping'
    shown = [name[:_LONGEST_NAME] for name in names[:_MOST_NAMES]]
    (nearest,) = get_close_matches(column[:_LONGEST_NAME], shown, n=1, cutoff=0.0)
    return f'of its {len(names):,} columns {quoted(nearest)} is the nearest; a column may be given by its number, too'
