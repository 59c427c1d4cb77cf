# SPDX-License-Identifier: Apache-2.0
"""Tables: text files with a row for each sample and a column for each signal."""

from __future__ import annotations

import csv
import math
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError, quoted
from cfd_pneumatic.files import open_input
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.sources import Samples, SignalSource
from cfd_pneumatic.recording.wording import counted

_MAX_TIME = 1e11
"""Seconds beyond which a time is an input error: 3,000 years. Days of MATLAB and ticks of .NET count from year 0 on."""

_LATEST = 2**31
"""Seconds that a stamp cannot hold: days of a spreadsheet count from 1900 on."""

_MOST_SPAN = 2**62 / NANOSECONDS
"""Seconds from the first row to another one beyond which a time is an input error."""

_COUNTER_SIZES = (2.0**16, 2.0**32)
"""Numbers of values that a counter of 16 or 32 bits has."""

_LONGEST_STEP = 10.0
"""Usual steps within which a counter goes on after it has begun again."""

_LONGEST_LINE = 2**24
"""Characters of a line beyond which a file is no table."""

_LONGEST_NAME = 40
"""Characters of a column's name that are compared."""

_MOST_NAMES = 1_000
"""Columns among which one of a similar name is looked for."""

_LOOKED_AT = 2**16
"""Bytes that tell how a file is encoded."""

_MOST_ASCII = 0.9
"""Share of characters below U+0100 above which bytes without a byte order mark are text in UTF-16."""

_CHECK = 'check delimiter and header_rows in the mapping; numbers with decimal commas need `decimal: comma`'

_MISSING = {
    *('', '-', 'nan', '+nan', '-nan', 'na', 'n/a', '<na>', '#n/a', '#na', '#n/a n/a', 'null', 'none'),
    *('#div/0!', '#value!', '#num!', '#ref!', '#name?', '#null!'),
}
"""What stands where there is no number, in lower case: of spreadsheets and of databases."""

_NAN_OF_C = re.compile(r'[+-]?1\.#[A-Z]+0*', re.ASCII | re.IGNORECASE)
"""Text that C of Windows prints for nan and infinity, with zeros up to the number of digits."""

_APOSTROPHE_OF_WINDOWS = '\x92'
"""Typographic apostrophe in Windows-1252, read as Latin-1."""

_TYPOGRAPHIC = str.maketrans(
    {
        **dict.fromkeys('\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}', ' '),
        **dict.fromkeys(f'\N{RIGHT SINGLE QUOTATION MARK}{_APOSTROPHE_OF_WINDOWS}', "'"),
        '\N{MINUS SIGN}': '-',
    }
)
"""Characters that spreadsheets and reports write for a space, an apostrophe and a minus."""

_FORTRAN = re.compile(r'([.,]\d*)[Dd](?=[+-]?\d)', re.ASCII)
"""Fraction of a number before the exponent that Fortran writes for double precision, as in 6.8D-01."""

_MARKS = {'.': 'point', ',': 'comma', ' ': 'space', "'": 'apostrophe'}
"""Names in a mapping of the characters inside of numbers."""

_GROUPED = re.compile(r"[+-]?\d{1,3}([., '])\d{3}(?:\1\d{3})*(?:(?!\1)([.,])\d*)?", re.ASCII)
"""A number whose digits a character groups by threes: that character and the decimal one."""

_BLOCK = 20_000  # rows whose numbers are made at once

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
    time : str, int or None
        Column of the time: its name, or its number from 1 on; None where samples come at a fixed period.
    time_unit : float or None
        Unit of the time [s]; None where the column holds dates, or times of the day.
    time_scale, time_offset : float
        Time in that unit for one of the column's numbers, and what is added then.
    time_thousands : str
        What groups the digits of the time; empty where nothing does.
    sample_period : float
        Time between rows where no column holds it [s].
    thousands : str
        What groups the digits of the other numbers by threes; empty where nothing does.
    delimiter : str or None
        Between columns; None for white space.
    decimal : str
        Before the fraction of a number.
    header_rows : int
        Rows above the samples; the last one with all names that are asked for names the columns.
    skip_rows : int
        Samples to drop at the beginning.

    """

    time: str | int | None
    time_unit: float | None = 1.0
    time_scale: float = 1.0
    time_offset: float = 0.0
    time_thousands: str = ''
    sample_period: float = 0.0
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
    times = [] if layout.time is None else [('time', layout.time)]
    wanted = [*times, *((channel.name, channel.source) for channel in channels)]
    columns, names = _resolve(path, encoding, layout, wanted)
    notes: list[str] = []
    try:
        rows = _numbers(_rows(path, encoding, layout, columns, names, notes), layout, columns)
    except csv.Error as error:
        raise InputError(f'cannot be read as a table: {error}; {_CHECK}') from error
    except UnicodeError as error:
        raise InputError(f'cannot be read as a table: it is not text all through; {_CHECK}') from error
    if not len(rows):
        skipped = ' after those that are skipped' if layout.skip_rows else ''
        raise InputError(f'holds no samples{skipped}')
    if layout.time is None:
        seconds = layout.sample_period * np.arange(len(rows))
    else:
        timed = np.isfinite(rows[:, 0])
        if not timed.any():
            raise InputError(
                'holds no samples with a time: if no column has one, leave `time` out and give `sample_period` [s]'
            )
        if not timed.all():
            notes.append(f'time: dropped {counted(int(np.sum(~timed)), "row")} not finite')
            rows = rows[timed]
        seconds = _seconds(_unwrapped(rows[:, 0], layout, notes), layout, notes)
        rows = rows[:, 1:]
    if np.abs(seconds).max() > _MOST_SPAN:
        raise InputError('the times are far too large: check their column and their unit')
    nanoseconds = np.rint(seconds * NANOSECONDS)
    alike = int(np.count_nonzero(np.diff(nanoseconds) == 0.0))
    if alike and alike == len(rows) - 1:
        raise InputError('the time never changes: is its column the time, with all its digits?')
    if alike > _MOST_ALIKE * len(rows):
        notes.append(
            f'time: {alike:,} of {counted(len(rows), "row")} have the time of the row before: were its last digits '
            'cut off, or rows written twice?'
        )
    offsets = [round(channel.time_offset * NANOSECONDS) for channel in channels]
    stamps = nanoseconds.astype(np.int64)
    stamps -= min(0, int(stamps.min()) + min(offsets))
    samples = [
        Samples(channel, stamps + offset, rows[:, index].copy())
        for index, (channel, offset) in enumerate(zip(channels, offsets))
    ]
    return samples, notes


def _unwrapped(counts: Array, layout: TableFormat, notes: list[str]) -> Array:
    """
    Return times as the column counts them, without the jumps back of a counter that begins again.

    The counter has 16 or 32 bits or counts the time of the day. A jump back counts as its end only if the next number
    then continues the numbers before, so that a clock that was set back is not taken for one.
    """
    with np.errstate(over='ignore'):
        steps = np.diff(counts)
    forward = steps[steps > 0.0]
    longest = _LONGEST_STEP * float(np.median(forward)) if forward.size else 0.0
    sizes = [*_COUNTER_SIZES, *([_DAY / (layout.time_unit * layout.time_scale)] if layout.time_unit else [])]
    for size in sizes:
        ends = steps < -0.5 * size
        after = steps[ends] + size
        if after.size and np.all((after > 0.0) & (after <= longest)):
            notes.append(f'time: the counter wraps after {size:,.15g} ({counted(after.size, "time")}): times continue')
            return counts + size * np.append(0, np.cumsum(ends))
    return counts


def _seconds(counts: Array, layout: TableFormat, notes: list[str]) -> Array:
    """Return times as the column counts them in seconds, from the first row on if no stamp can hold them."""
    unit = layout.time_unit or 1.0
    with np.errstate(over='ignore'):
        seconds = (layout.time_scale * counts + layout.time_offset) * unit
        if layout.time_unit is None and np.max(seconds) < _DAY:  # of the day: past midnight
            seconds[1:] += _DAY * np.cumsum(np.diff(seconds) < -0.5 * _DAY)
        if _LATEST < np.abs(seconds).max() <= _MAX_TIME:
            notes.append(f'time: begins at {seconds[0]:g} s, which no stamp of ROS 2 holds: counted from the first row')
            seconds = layout.time_scale * (counts - counts[0]) * unit  # in this order: large times have few digits
    return seconds


class _Row(NamedTuple):
    """What a row holds in the wanted columns, and the number of its line."""

    line: int
    fields: list[str]


def _numbers(rows: Iterator[_Row], layout: TableFormat, columns: Sequence[int]) -> Array:
    """Return the numbers of all rows, shape (rows, columns)."""
    parsers = [_parser(layout, is_time=_is_time(index, layout)) for index in range(len(columns))]
    blocks = [np.empty((0, len(columns)))]
    while block := list(islice(rows, _BLOCK)):
        texts = zip(*(row.fields for row in block))
        blocks.append(np.empty((len(block), len(columns))))
        for index, (own, parse) in enumerate(zip(texts, parsers)):
            try:
                blocks[-1][:, index] = parse.all(own)
            except ValueError:
                blocks[-1][:, index] = _one_by_one(
                    parse, own, block, columns[index], layout, is_time=_is_time(index, layout)
                )
    return np.concatenate(blocks)


def _is_time(index: int, layout: TableFormat) -> bool:
    """Return whether a wanted column is the time, which comes first if a column has it."""
    return index == 0 and layout.time is not None


def _one_by_one(
    parse: _Parser, texts: Sequence[str], block: Sequence[_Row], column: int, layout: TableFormat, *, is_time: bool
) -> list[float]:
    """Return the numbers of a column, nan where there is none; refuse what is no number by its line."""
    found = []
    for row, text in zip(block, texts):
        try:
            found.append(parse.one(text.strip()))
        except ValueError as error:
            dated = isinstance(error, _DateError)
            fix = str(error) if dated else _fix_of(text.strip(), row.line, layout, is_time=is_time)
            where = f'line {row.line}, column {column + 1} holds {quoted(text)}'
            raise InputError(f'cannot be read as a table of numbers: {where}; {fix}') from error
    return found


class _Parser:
    """Makes numbers of texts."""

    def all(self, texts: Sequence[str]) -> Array:
        """Return the numbers of texts that are all plain; raise ValueError if one is not."""
        raise ValueError

    def one(self, text: str) -> float:
        """Return the number of a text, nan of one that says that there is none; raise ValueError if it is no number."""
        raise NotImplementedError


class _NumberParser(_Parser):
    def __init__(self, decimal: str, thousands: str, *, anywhere: bool = False) -> None:
        """Take what groups digits for that by threes only, or anywhere."""
        thousands = thousands.translate(_TYPOGRAPHIC)
        self._decimal, self._thousands, self._anywhere = decimal, thousands, anywhere
        mark = re.escape(thousands)
        self._grouped = (
            re.compile(rf'[+-]?\d{{1,3}}(?:{mark}\d{{3}})+(?!\d)[^{mark}]*', re.ASCII) if thousands else None
        )

    def all(self, texts: Sequence[str]) -> Array:
        joined = '\n'.join(texts)
        if '_' in joined or not joined.isascii() or self._thousands:
            raise ValueError
        if self._decimal == ',':
            if '.' in joined:
                raise ValueError
            texts = joined.replace(',', '.').split('\n')
        return np.array(texts, dtype=float)

    def one(self, text: str) -> float:
        text = text.translate(_TYPOGRAPHIC)
        if text.lower() in _MISSING or _NAN_OF_C.fullmatch(text):
            return math.nan
        if self._thousands and (self._anywhere or (self._grouped and self._grouped.fullmatch(text))):
            text = text.replace(self._thousands, '')
        if '_' in text or not text.isascii() or (self._decimal == ',' and '.' in text):
            raise ValueError(text)
        return float(_FORTRAN.sub(r'\1e', text).replace(self._decimal, '.'))


class _DateParser(_Parser):
    def one(self, text: str) -> float:
        return math.nan if text.lower() in _MISSING else seconds_of(text)


def _parser(layout: TableFormat, *, is_time: bool) -> _Parser:
    if is_time and layout.time_unit is None:
        return _DateParser()
    if is_time and layout.time_thousands:
        return _NumberParser(layout.decimal, layout.time_thousands, anywhere=True)
    return _NumberParser(layout.decimal, layout.thousands)


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


def _fix_of(text: str, line: int, layout: TableFormat, *, is_time: bool) -> str:
    """Return what to change if a cell is not a number."""
    text = text.translate(_TYPOGRAPHIC)
    if _DATE.fullmatch(text):
        return 'if it is the time, `unit: date` reads it'
    if re.search(r'\d:\d\d', text):
        return 'if it is the time, write it as 2024-05-01 12:00:00.25 or 12:00:00.25 and set `unit: date`'
    advice = [*_grouping_advice(text, layout.decimal, is_time=is_time), *_decimal_advice(text, layout.decimal)]
    if advice:
        return '; '.join(advice)
    if re.match(r'[^\w"]*\d', text):
        return f'write the number alone, without a unit or another mark, or {_CHECK}'
    if line == layout.header_rows + 1:
        return f'if names or units stand there, `table` needs `header_rows: {line}`; or {_CHECK}'
    return f'write nan where there is no value, or {_CHECK}'


def _grouping_advice(text: str, decimal: str, *, is_time: bool) -> list[str]:
    """Return which keys read a number if a character groups its digits by threes; empty if none does."""
    grouped = _GROUPED.fullmatch(text)
    if not grouped:
        return []
    mark, point = grouped.groups()
    point = point or (decimal if mark != decimal else ',' if mark == '.' else '.')
    change = f'`table` needs `decimal: {_MARKS[point]}` and ' if point != decimal else ''
    holder = '`time` needs ' if is_time else '' if change else '`table` needs '
    return [f'if {_MARKS[mark]}s group its digits, {change}{holder}`thousands: {_MARKS[mark]}`']


def _decimal_advice(text: str, decimal: str) -> list[str]:
    """Return which key reads a number with the other decimal character; empty if the number has none."""
    other = ',' if decimal == '.' else '.'
    if not re.fullmatch(rf'[+-]?\d*{re.escape(other)}\d+(?:[Ee][+-]?\d+)?', text, re.ASCII):
        return []
    return [f'if that is a decimal {_MARKS[other]}, `table` needs `decimal: {_MARKS[other]}`']


def _rows(
    path: Path, encoding: str, layout: TableFormat, columns: Sequence[int], names: Sequence[str], notes: list[str]
) -> Iterator[_Row]:
    """
    Yield the rows of samples below the header.

    Each has as many fields as the first row or as the header has names, or a number between. Lines that begin with #
    are comments. A last row without a line end is left out, and noted: a logger that is switched off may cut a number
    anywhere.
    """
    with TextIOWrapper(open_input(path), encoding, newline='') as stream:
        lines = _NumberedLines(stream, notes, layout.header_rows)
        least, most = 0, len(names)
        for fields in islice(_fields(lines, layout.delimiter), layout.skip_rows, None):
            if not most or not least:
                least, most = min(len(fields), most or len(fields)), max(len(fields), most)
                if names and len(fields) > len(names):
                    most = len(names)
            while len(fields) > most and not fields[-1].strip():
                del fields[-1]  # empty ones at the end are none
            if not max(least, max(columns) + 1) <= len(fields) <= most:
                known = f'the header has {len(names)} names' if names else f'the first row has {most}'
                text = quoted((layout.delimiter or ' ').join(fields))
                fix = f'{text}; delete the line if it is a footer, or {_CHECK}' if len(fields) < least else _CHECK
                raise InputError(f'line {lines.number} has {counted(len(fields), "field")}, but {known}: {fix}')
            yield _Row(lines.number, [fields[column] for column in columns])


class _NumberedLines:
    """The lines of a file below its header, without comments and without a last one that has no end."""

    def __init__(self, stream: TextIO, notes: list[str], header_rows: int) -> None:
        self.number = header_rows
        self._stream, self._notes = stream, notes
        for _ in islice(_lines(stream), header_rows):
            pass

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        for line in _lines(self._stream):
            self.number += 1
            if not line.endswith(('\n', '\r')) and line.strip() and not line.startswith('#'):
                self._notes.append('the last row has no line end and may be cut: left out')
                break
            if not line.lstrip().startswith('#'):
                return line
        raise StopIteration


def _fields(lines: Iterator[str], delimiter: str | None) -> Iterator[list[str]]:
    """Yield the fields of each row that has some."""
    rows = (
        (line.split() for line in lines)
        if delimiter is None
        else csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter != '\t')
    )
    for fields in rows:
        if any(field.strip() for field in fields):
            yield fields


def _encoding(path: Path) -> str:
    """Return how a file of text is encoded, as far as its beginning tells."""
    with open_input(path) as stream:
        head = stream.read(_LOOKED_AT)
    if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return 'utf-16'
    if 0 not in head[::2] and head[1::2].count(0) > _MOST_ASCII * len(head[1::2]):
        return 'utf-16-le'
    if 0 not in head[1::2] and head[::2].count(0) > _MOST_ASCII * len(head[::2]):
        return 'utf-16-be'
    try:
        getincrementaldecoder('utf-8')().decode(head)
    except UnicodeDecodeError as error:
        if re.search(rb'[\x00-\x08\x0e-\x1f\x7f-\x91\x93-\x9f]', head):
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
    shown = {name[:_LONGEST_NAME].lower(): name for name in reversed(names[:_MOST_NAMES])}
    (found,) = get_close_matches(column[:_LONGEST_NAME].lower(), shown, n=1, cutoff=0.0)
    nearest = shown[found]
    return f'of its {len(names):,} columns {quoted(nearest)} is the nearest; a column may be given by its number, too'
