# SPDX-License-Identifier: Apache-2.0
"""Parse the texts of a table: numbers with decimal and thousands characters, dates, and missing values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from datetime import date
from itertools import islice

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError, quoted
from cfd_pneumatic.recording.table_format import CHECK, DAY, TableFormat
from cfd_pneumatic.recording.table_rows import Row

_MISSING = {
    *('', '-', 'nan', '+nan', '-nan', 'na', 'n/a', '<na>', '#n/a', '#na', '#n/a n/a', 'null', 'none'),
    *('#div/0!', '#value!', '#num!', '#ref!', '#name?', '#null!'),
}
"""Texts for a missing number in spreadsheets and databases, in lower case."""

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
"""A number with digits grouped by threes: the grouping character and the decimal character."""

_BLOCK = 20_000  # rows that are parsed together

_DATE = re.compile(
    r'(?:(\d{4})-(\d\d)-(\d\d)[ T])?(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?) ?(?:Z|([+-])(\d\d):?(\d\d))?', re.ASCII
)

_DATES = 'times must be such as 2024-05-01 12:00:00.25 or 12:00:00.25'

_BEFORE_EPOCH = date(1970, 1, 1).toordinal()


def numbers_of(rows: Iterator[Row], layout: TableFormat, columns: Sequence[int]) -> Array:
    """Return the numbers of all rows, shape (rows, columns)."""
    parsers = [_parser(layout, is_time=_is_time(index, layout)) for index in range(len(columns))]
    blocks = [np.empty((0, len(columns)))]
    while block := list(islice(rows, _BLOCK)):
        texts = zip(*(row.fields for row in block))
        blocks.append(np.empty((len(block), len(columns))))
        for index, (column_texts, parser) in enumerate(zip(texts, parsers)):
            try:
                blocks[-1][:, index] = parser.parse_all(column_texts)
            except ValueError:
                blocks[-1][:, index] = _parse_singly(
                    parser, column_texts, block, columns[index], layout, is_time=_is_time(index, layout)
                )
    return np.concatenate(blocks)


def _is_time(index: int, layout: TableFormat) -> bool:
    """Return whether a wanted column is the time, which is the first column if the table has one."""
    return index == 0 and layout.time is not None


def _parse_singly(
    parser: _Parser, texts: Sequence[str], block: Sequence[Row], column: int, layout: TableFormat, *, is_time: bool
) -> list[float]:
    """Return the numbers of a column, nan for missing numbers; report the line of any other text."""
    numbers = []
    for row, text in zip(block, texts):
        try:
            numbers.append(parser.parse(text.strip()))
        except ValueError as error:
            is_date = isinstance(error, _DateError)
            fix = str(error) if is_date else _fix_of(text.strip(), row.line, layout, is_time=is_time)
            position = f'line {row.line}, column {column + 1} holds {quoted(text)}'
            raise InputError(f'cannot be read as a table of numbers: {position}; {fix}') from error
    return numbers


class _Parser:
    """Parser of texts as numbers."""

    def parse_all(self, texts: Sequence[str]) -> Array:
        """Return the numbers of plain texts; raise ValueError if a text is not plain."""
        raise ValueError

    def parse(self, text: str) -> float:
        """Return the number of a text, nan for a missing number; raise ValueError for any other text."""
        raise NotImplementedError


class _NumberParser(_Parser):
    def __init__(self, decimal: str, thousands: str, *, anywhere: bool = False) -> None:
        """Accept the thousands character between groups of three digits only, or anywhere."""
        thousands = thousands.translate(_TYPOGRAPHIC)
        self._decimal, self._thousands, self._anywhere = decimal, thousands, anywhere
        mark = re.escape(thousands)
        self._grouped = (
            re.compile(rf'[+-]?\d{{1,3}}(?:{mark}\d{{3}})+(?!\d)[^{mark}]*', re.ASCII) if thousands else None
        )

    def parse_all(self, texts: Sequence[str]) -> Array:
        joined = '\n'.join(texts)
        if '_' in joined or not joined.isascii() or self._thousands:
            raise ValueError
        if self._decimal == ',':
            if '.' in joined:
                raise ValueError
            texts = joined.replace(',', '.').split('\n')
        return np.array(texts, dtype=float)

    def parse(self, text: str) -> float:
        text = text.translate(_TYPOGRAPHIC)
        if text.lower() in _MISSING or _NAN_OF_C.fullmatch(text):
            return math.nan
        if self._thousands and (self._anywhere or (self._grouped and self._grouped.fullmatch(text))):
            text = text.replace(self._thousands, '')
        if '_' in text or not text.isascii() or (self._decimal == ',' and '.' in text):
            raise ValueError(text)
        return float(_FORTRAN.sub(r'\1e', text).replace(self._decimal, '.'))


class _DateParser(_Parser):
    def parse(self, text: str) -> float:
        return math.nan if text.lower() in _MISSING else seconds_of(text)


def _parser(layout: TableFormat, *, is_time: bool) -> _Parser:
    if is_time and layout.time_unit is None:
        return _DateParser()
    if is_time and layout.time_thousands:
        return _NumberParser(layout.decimal, layout.time_thousands, anywhere=True)
    return _NumberParser(layout.decimal, layout.thousands)


class _DateError(ValueError):
    """A text is not a date."""


def seconds_of(text: str) -> float:
    """
    Return the time of a date such as `2024-05-01 12:00:00.25`, or of a time of the day [s].

    Without a zone it is UTC.

    Raises
    ------
    ValueError
        If the text is neither.

    """
    match = _DATE.fullmatch(text.strip().strip('"'))
    if not match:
        raise _DateError(_DATES)
    year, month, day, hours, minutes, seconds, sign, *zone = match.groups()
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _BEFORE_EPOCH if year else 0
    except ValueError as error:
        raise _DateError(_DATES) from error
    ahead = int(f'{sign}1') * (60 * int(zone[0]) + int(zone[1])) if sign else 0
    return days * DAY + 3600 * int(hours) + 60 * (int(minutes) - ahead) + float(seconds.replace(',', '.'))


def _fix_of(text: str, line: int, layout: TableFormat, *, is_time: bool) -> str:
    """Return advice for a cell that is not a number."""
    text = text.translate(_TYPOGRAPHIC)
    if _DATE.fullmatch(text):
        return 'if it is the time, `unit: date` reads it'
    if re.search(r'\d:\d\d', text):
        return 'if it is the time, write it as 2024-05-01 12:00:00.25 or 12:00:00.25 and set `unit: date`'
    advice = [*_grouping_advice(text, layout.decimal, is_time=is_time), *_decimal_advice(text, layout.decimal)]
    if advice:
        return '; '.join(advice)
    if re.match(r'[^\w"]*\d', text):
        return f'write the number alone, without a unit or another mark, or {CHECK}'
    if line == layout.header_rows + 1:
        return f'if the line has names or units, `table` needs `header_rows: {line}`; or {CHECK}'
    return f'write nan where there is no value, or {CHECK}'


def _grouping_advice(text: str, decimal: str, *, is_time: bool) -> list[str]:
    """Return the keys to set for a number with digits grouped by threes; empty for another text."""
    grouped = _GROUPED.fullmatch(text)
    if not grouped:
        return []
    mark, point = grouped.groups()
    point = point or (decimal if mark != decimal else ',' if mark == '.' else '.')
    change = f'`table` needs `decimal: {_MARKS[point]}` and ' if point != decimal else ''
    holder = '`time` needs ' if is_time else '' if change else '`table` needs '
    return [f'if {_MARKS[mark]}s group its digits, {change}{holder}`thousands: {_MARKS[mark]}`']


def _decimal_advice(text: str, decimal: str) -> list[str]:
    """Return the key to set for a number with the alternative decimal character; empty for another text."""
    alternative = ',' if decimal == '.' else '.'
    if not re.fullmatch(rf'[+-]?\d*{re.escape(alternative)}\d+(?:[Ee][+-]?\d+)?', text, re.ASCII):
        return []
    return [f'if that is a decimal {_MARKS[alternative]}, `table` needs `decimal: {_MARKS[alternative]}`']
