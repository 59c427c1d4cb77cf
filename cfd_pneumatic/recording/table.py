"""Tables: text files with a row for each sample and a column for each signal."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.channels import Channel, Samples
from cfd_pneumatic.recording.messages import NANOSECONDS
from cfd_pneumatic.recording.wording import reason_of

_MAX_TIME = 2**62
"""Nanoseconds beyond which a time is a mistake."""


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
    delimiter : str or None
        Between columns; None for white space.
    header_rows : int
        Rows above the samples; the last of them names the columns.
    skip_rows : int
        Samples to drop at the beginning.

    """

    time: str | int
    time_unit: float
    delimiter: str | None = None
    header_rows: int = 0
    skip_rows: int = 0


def read_table(path: Path, layout: TableFormat, channels: Sequence[Channel]) -> list[Samples]:
    """
    Return what a table holds for some channels, in their order.

    Times below zero, as a trigger makes them, are moved up so that the table begins at zero.

    Raises
    ------
    InputError
        If the file can't be read, isn't all numbers in the wanted columns, or lacks a column.

    """
    columns = _resolve(path, layout, [layout.time, *(channel.source for channel in channels)])
    try:
        rows = np.loadtxt(
            path, delimiter=layout.delimiter, skiprows=layout.header_rows, usecols=columns, ndmin=2, encoding='utf-8'
        )
    except (ValueError, IndexError) as error:
        raise InputError(
            f'cannot be read as a table of numbers: {reason_of(error)}; check delimiter and header_rows in the mapping'
        ) from error
    rows = rows[layout.skip_rows :]
    rows = rows[np.isfinite(rows[:, 0])]
    if not len(rows):
        raise InputError(f'holds no samples after the {layout.skip_rows} that are skipped')
    nanoseconds = np.rint(rows[:, 0] * (layout.time_unit * NANOSECONDS))
    if np.abs(nanoseconds).max() > _MAX_TIME:
        raise InputError(f'the times in column {layout.time} are far too large: check their unit')
    offsets = [round(channel.time_offset * NANOSECONDS) for channel in channels]
    times = nanoseconds.astype(np.int64)
    times -= min(0, int(times.min()) + min(offsets))
    return [
        Samples(channel, times + offset, rows[:, index].copy())
        for index, (channel, offset) in enumerate(zip(channels, offsets), start=1)
    ]


def _resolve(path: Path, layout: TableFormat, columns: Sequence[str | int]) -> list[int]:
    """Return the positions of columns, from 0 on."""
    try:
        with path.open(encoding='utf-8', newline='') as stream:
            head = list(islice(stream, layout.header_rows + 1))
    except UnicodeDecodeError as error:
        raise InputError('is not a text file, and the mapping is for tables') from error
    except OSError as error:
        raise InputError(f'cannot be read: {error.strerror}') from error
    if len(head) <= layout.header_rows:
        raise InputError('holds no samples')
    width = len(_split(head[-1], layout.delimiter))
    names = _split(head[-2].lstrip('# '), layout.delimiter) if layout.header_rows else []
    return [_position(column, names, width) for column in columns]


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])]


def _position(column: str | int, names: list[str], width: int) -> int:
    if isinstance(column, str):
        if column not in names:
            known = (
                f'its columns are {", ".join(names)}' if names else 'for columns by name set header_rows in the mapping'
            )
            raise InputError(f'has no column {column!r}: {known}')
        return names.index(column)
    if column > width:
        raise InputError(f'has no column {column}: the first row has {width}; check the delimiter in the mapping')
    return column - 1
