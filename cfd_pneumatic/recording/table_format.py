# SPDX-License-Identifier: Apache-2.0
"""How a table is laid out, as a mapping file describes it."""

from __future__ import annotations

from dataclasses import dataclass

CHECK = 'check delimiter and header_rows in the mapping; numbers with decimal commas need `decimal: comma`'

DAY = 86_400  # seconds


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
