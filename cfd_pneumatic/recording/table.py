# SPDX-License-Identifier: Apache-2.0
"""Tables: text files with a row for each sample and a column for each signal."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.message_texts import count_of
from cfd_pneumatic.recording.sources import Samples, SignalSource
from cfd_pneumatic.recording.table_format import CHECK, DAY, TableFormat
from cfd_pneumatic.recording.table_numbers import numbers_of
from cfd_pneumatic.recording.table_rows import columns_of, encoding_of, rows_of

_MAX_TIME = 1e11
"""Largest time [s]: 3,000 years, since days of MATLAB and ticks of .NET count from year 0. Larger times are errors."""

_LATEST = 2**31
"""Time that exceeds a stamp [s]: days of a spreadsheet count from 1900 on."""

_MOST_SPAN = 2**62 / NANOSECONDS
"""Largest time span of a table [s]; a larger span is an input error."""

_COUNTER_SIZES = (2.0**16, 2.0**32)
"""Number of values of a counter with 16 or 32 bits."""

_LONGEST_STEP = 10.0
"""Largest step of a counter at its wrap, as a multiple of the usual step."""

_MOST_ALIKE = 0.1  # share of rows with a repeated time


def read_table(path: Path, layout: TableFormat, channels: Sequence[SignalSource]) -> tuple[list[Samples], list[str]]:
    """
    Return the samples of given channels in a table, in the order of the channels, and notes on defects.

    If there are times below zero, as a trigger produces, all times are shifted so that the table begins at zero.

    Raises
    ------
    InputError
        If the file cannot be read, has a text in place of a number, lacks a column, or has rows of different lengths.

    """
    encoding = encoding_of(path)
    times = [] if layout.time is None else [('time', layout.time)]
    wanted = [*times, *((channel.name, channel.source) for channel in channels)]
    columns, names = columns_of(path, encoding, layout, wanted)
    notes: list[str] = []
    try:
        rows = numbers_of(rows_of(path, encoding, layout, columns, names, notes), layout, columns)
    except csv.Error as error:
        raise InputError(f'cannot be read as a table: {error}; {CHECK}') from error
    except UnicodeError as error:
        raise InputError(f'cannot be read as a table: it is not text all through; {CHECK}') from error
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
            notes.append(f'time: dropped {count_of(int(np.sum(~timed)), "row")} not finite')
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
            f'time: {alike:,} of {count_of(len(rows), "row")} have the time of the row before: were its last digits '
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
    Return the column's times without the backward jumps of a counter that wraps.

    The counter has 16 or 32 bits or counts the time of the day. A backward jump is a wrap only if the unwrapped numbers
    continue the previous numbers; a clock that was set back does not continue them.
    """
    with np.errstate(over='ignore'):
        steps = np.diff(counts)
    forward = steps[steps > 0.0]
    longest = _LONGEST_STEP * float(np.median(forward)) if forward.size else 0.0
    sizes = [*_COUNTER_SIZES, *([DAY / (layout.time_unit * layout.time_scale)] if layout.time_unit else [])]
    for size in sizes:
        ends = steps < -0.5 * size
        after = steps[ends] + size
        if after.size and np.all((after > 0.0) & (after <= longest)):
            notes.append(f'time: the counter wraps after {size:,.15g} ({count_of(after.size, "time")}): times continue')
            return counts + size * np.append(0, np.cumsum(ends))
    return counts


def _seconds(counts: Array, layout: TableFormat, notes: list[str]) -> Array:
    """Convert the column's times to seconds, counted from the first row if a stamp cannot hold them."""
    unit = layout.time_unit or 1.0
    with np.errstate(over='ignore'):
        seconds = (layout.time_scale * counts + layout.time_offset) * unit
        if layout.time_unit is None and np.max(seconds) < DAY:  # of the day: past midnight
            seconds[1:] += DAY * np.cumsum(np.diff(seconds) < -0.5 * DAY)
        if _LATEST < np.abs(seconds).max() <= _MAX_TIME:
            notes.append(f'time: begins at {seconds[0]:g} s, which no stamp of ROS 2 holds: counted from the first row')
            seconds = layout.time_scale * (counts - counts[0]) * unit  # in this order: large times have few digits
    return seconds
