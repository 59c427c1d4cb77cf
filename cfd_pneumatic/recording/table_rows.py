# SPDX-License-Identifier: Apache-2.0
"""Rows of a text file: its encoding, its header, its columns, and the fields of each line."""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TextIO

from cfd_pneumatic.errors import InputError, quoted
from cfd_pneumatic.files import open_input
from cfd_pneumatic.recording.message_texts import count_of
from cfd_pneumatic.recording.table_format import CHECK, TableFormat

_LONGEST_LINE = 2**24
"""Longest line of a table [characters]."""

_NO_TEXT = 'is not a text file, and the mapping is for tables'

_LONGEST_NAME = 40
"""Characters of a column's name that are compared."""

_MOST_NAMES = 1_000
"""Number of columns that are searched for a similar name."""

_HEAD = 2**16
"""Bytes that determine the encoding of a file."""

_MOST_ASCII = 0.9
"""Share of characters below U+0100 above which bytes without a byte order mark are text in UTF-16."""


class Row(NamedTuple):
    """Fields of a row in the wanted columns, and the row's line number."""

    line: int
    fields: list[str]


def columns_of(
    path: Path, encoding: str, layout: TableFormat, columns: Sequence[tuple[str, str | int]]
) -> tuple[list[int], list[str]]:
    """Return the positions of the signals' columns, from 0 on, and the names of all columns in the header."""
    try:
        with TextIOWrapper(open_input(path), encoding, newline='') as stream:
            head = list(islice(bounded_lines(stream), layout.header_rows + 1))
    except UnicodeError as error:
        raise InputError(_NO_TEXT) from error
    if len(head) <= layout.header_rows:
        raise InputError('holds no samples')
    width = len(_split(head[-1], layout.delimiter))
    wanted = {column for _, column in columns if isinstance(column, str)}
    rows = [_names(line, layout) for line in reversed(head[:-1])]
    last = rows[0] if rows else []
    names = next((row for row in rows if wanted <= {*row}), last) if wanted else last  # a row of units may follow
    positions = [_position(signal, column, names, width) for signal, column in columns]
    if not wanted and (layout.delimiter is None or len(names) == 1):
        names = []  # perhaps a line of text
    return positions, names


def rows_of(
    path: Path, encoding: str, layout: TableFormat, columns: Sequence[int], names: Sequence[str], notes: list[str]
) -> Iterator[Row]:
    """
    Yield the rows of samples below the header.

    The number of a row's fields is between that of the first row and that of the header's names. Lines that begin with
    # are comments. A last row without a line end is dropped, with a note: a logger that is switched off may have cut a
    number.
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
                del fields[-1]  # empty fields at the end do not count
            if not max(least, max(columns) + 1) <= len(fields) <= most:
                known = f'the header has {len(names)} names' if names else f'the first row has {most}'
                text = quoted((layout.delimiter or ' ').join(fields))
                fix = f'{text}; delete the line if it is a footer, or {CHECK}' if len(fields) < least else CHECK
                raise InputError(f'line {lines.number} has {count_of(len(fields), "field")}, but {known}: {fix}')
            yield Row(lines.number, [fields[column] for column in columns])


class _NumberedLines:
    """Lines of a file below its header, without comments and without a last line that has no line end."""

    def __init__(self, stream: TextIO, notes: list[str], header_rows: int) -> None:
        self.number = header_rows
        self._stream, self._notes = stream, notes
        for _ in islice(bounded_lines(stream), header_rows):
            pass

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        for line in bounded_lines(self._stream):
            self.number += 1
            if not line.endswith(('\n', '\r')) and line.strip() and not line.startswith('#'):
                self._notes.append('the last row has no line end and may be cut: left out')
                break
            if not line.lstrip().startswith('#'):
                return line
        raise StopIteration


def _fields(lines: Iterator[str], delimiter: str | None) -> Iterator[list[str]]:
    """Yield the fields of each row that is not empty."""
    rows = (
        (line.split() for line in lines)
        if delimiter is None
        else csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter != '\t')
    )
    for fields in rows:
        if any(field.strip() for field in fields):
            yield fields


def encoding_of(path: Path, refusal: str = _NO_TEXT) -> str:
    """
    Return the encoding of a text file, determined from its beginning.

    Raises
    ------
    InputError
        If the file cannot be read. The message is `refusal` if the file is not text.

    """
    with open_input(path) as stream:
        head = stream.read(_HEAD)
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
            raise InputError(refusal) from error
        return 'latin-1'
    return 'utf-8-sig'


def _names(line: str, layout: TableFormat) -> list[str]:
    """Return the names in a row of the header."""
    names = _split(line.lstrip('# '), layout.delimiter)
    while names and not names[-1]:
        del names[-1]
    return names


def bounded_lines(stream: TextIO, longest: int = _LONGEST_LINE) -> Iterator[str]:
    """
    Yield the lines of a text file.

    Raises
    ------
    InputError
        If a line has `longest` characters or more.

    """
    while line := stream.readline(longest):
        if len(line) == longest:
            raise InputError(f'has a line of more than {longest:,} characters: is it a table?')
        yield line


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as error:
        raise InputError(f'cannot be read as a table; {CHECK}') from error


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
            'give the number of the column'
        )
    return names.index(column)


def _advice(column: str, names: Sequence[str]) -> str:
    """Return advice for a missing column name, with the most similar name of the table."""
    if not names:
        return 'for columns by name set header_rows in the mapping'
    if len(names) == 1:
        return 'its header has one name; check the delimiter in the mapping'
    shown = {name[:_LONGEST_NAME].lower(): name for name in reversed(names[:_MOST_NAMES])}
    (match,) = get_close_matches(column[:_LONGEST_NAME].lower(), shown, n=1, cutoff=0.0)
    nearest = shown[match]
    return f'of its {len(names):,} columns {quoted(nearest)} is the nearest; a column may be given by its number, too'
