"""Tables: text files with a row for each sample and a column for each signal."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.messages import NANOSECONDS
from cfd_pneumatic.recording.sources import Samples, SignalSource
from cfd_pneumatic.recording.wording import counted, reason_of

_MAX_TIME = 2**62
"""Nanoseconds beyond which a time is a mistake."""

_LONGEST_LINE = 2**24
"""Characters of a line beyond which a file is no table."""

_CHECK = 'check delimiter and header_rows in the mapping; numbers must have decimal points, not commas'


@dataclass(frozen=True)
class TableFormat:
    """
    How a table is laid out.

    Attributes
    ----------
    time : str or int
        Column of the time: its name, or its number from 1 on.
    time_unit : float
        Unit of the time [s].
    thousands : str
        What groups the digits of the time; empty where nothing does.
    delimiter : str or None
        Between columns; None for white space.
    header_rows : int
        Rows above the samples; the last of them names the columns.
    skip_rows : int
        Samples to drop at the beginning.

    """

    time: str | int
    time_unit: float
    thousands: str = ''
    delimiter: str | None = None
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
    columns, names = _resolve(path, layout, [layout.time, *(channel.source for channel in channels)])
    notes: list[str] = []
    lines = _rows(path, layout, names, notes)
    try:
        first = next(lines, None)
        if first is None:
            raise InputError('holds no samples')
        rows = np.loadtxt(
            chain([first], lines),
            delimiter=layout.delimiter,
            usecols=columns,
            ndmin=2,
            converters={columns[0]: lambda text: float(text.replace(layout.thousands, ''))}
            if layout.thousands
            else None,
            encoding='utf-8',
        )
    except (ValueError, IndexError) as error:
        raise InputError(f'cannot be read as a table of numbers: {reason_of(error)}; {_CHECK}') from error
    rows = rows[layout.skip_rows :]
    timed = np.isfinite(rows[:, 0])
    if not timed.any():
        raise InputError(f'holds no samples after the {layout.skip_rows} that are skipped')
    if not timed.all():
        notes.append(f'time: dropped {counted(int(np.sum(~timed)), "row")} not finite')
        rows = rows[timed]
    with np.errstate(over='ignore'):
        nanoseconds = np.rint(rows[:, 0] * (layout.time_unit * NANOSECONDS))
    if np.abs(nanoseconds).max() > _MAX_TIME:
        raise InputError(f'the times in column {layout.time} are far too large: check their unit')
    offsets = [round(channel.time_offset * NANOSECONDS) for channel in channels]
    times = nanoseconds.astype(np.int64)
    times -= min(0, int(times.min()) + min(offsets))
    samples = [
        Samples(channel, times + offset, rows[:, index].copy())
        for index, (channel, offset) in enumerate(zip(channels, offsets), start=1)
    ]
    return samples, notes


def _rows(path: Path, layout: TableFormat, names: Sequence[str], notes: list[str]) -> Iterator[str]:
    """
    Yield the rows below the header: each has a field for each name, or without names as many as the first row.

    A last row without a line end is left out, and noted: a logger that is switched off may cut a number anywhere.
    """
    delimiter = layout.delimiter
    width, known = len(names), f'the header has {len(names)} names'
    with path.open(encoding='utf-8') as stream:
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
            yield row


def _resolve(path: Path, layout: TableFormat, columns: Sequence[str | int]) -> tuple[list[int], list[str]]:
    """Return the positions of columns, from 0 on, and the names of all columns where the header has them."""
    try:
        with path.open(encoding='utf-8', newline='') as stream:
            head = list(islice(_lines(stream), layout.header_rows + 1))
    except UnicodeDecodeError as error:
        raise InputError('is not a text file, and the mapping is for tables') from error
    except OSError as error:
        raise InputError(f'cannot be read: {error.strerror}') from error
    if len(head) <= layout.header_rows:
        raise InputError('holds no samples')
    width = len(_split(head[-1], layout.delimiter))
    names = _split(head[-2].lstrip('# '), layout.delimiter) if layout.header_rows else []
    while names and not names[-1]:
        del names[-1]
    positions = [_position(column, names, width) for column in columns]
    by_number = all(isinstance(column, int) for column in columns)
    if by_number and (layout.delimiter is None or len(names) == 1):
        names = []  # perhaps a line of text
    return positions, names


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
        raise InputError(f'cannot be read as a table: {reason_of(error)}; {_CHECK}') from error


def _position(column: str | int, names: list[str], width: int) -> int:
    if isinstance(column, str):
        if column not in names:
            known = (
                f'its columns are {", ".join(names)}' if names else 'for columns by name set header_rows in the mapping'
            )
            raise InputError(f'has no column {column!r}: {known}')
        if names.count(column) > 1:
            raise InputError(f'has {names.count(column)} columns {column!r}: give the number of the one that is meant')
        return names.index(column)
    if column > width:
        raise InputError(f'has no column {column}: the first row has {width}; check the delimiter in the mapping')
    return column - 1
