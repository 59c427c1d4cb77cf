# SPDX-License-Identifier: Apache-2.0
"""Layout of a table according to a mapping file."""

from __future__ import annotations

from dataclasses import dataclass

CHECK = 'check delimiter and header_rows in the mapping; numbers with decimal commas need `decimal: comma`'

DAY = 86_400  # seconds


@dataclass(frozen=True)
class TableFormat:
    """
    Layout of a table.

    Attributes
    ----------
    time : str, int or None
        Column of the time: its name, or its number from 1 on; None for a fixed sample period.
    time_unit : float or None
        Unit of the time [s]; None for a column of dates or of times of the day.
    time_scale, time_offset : float
        Factor from the column's numbers to that unit, and offset that is added afterwards.
    time_thousands : str
        Character that groups the digits of the time; empty if there is none.
    sample_period : float
        Time between rows if no column has the time [s].
    thousands : str
        Character that groups the digits of the other numbers by threes; empty if there is none.
    delimiter : str or None
        Character between columns; None for white space.
    decimal : str
        Character before the fraction of a number.
    header_rows : int
        Rows above the samples. The last row with all wanted names gives the names of the columns.
    skip_rows : int
        Samples that are dropped at the beginning.

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
