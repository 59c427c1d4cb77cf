# SPDX-License-Identifier: Apache-2.0
"""
The table of all results: columns, and writers for CSV and Parquet.

Each bag has a row for each cylinder, and a row for the contact force if the force was identified. A failed bag has a
single row. Columns have the same meaning in all rows: ``table[table.part == 'cylinder_a'].groupby('device')`` gives the
history of each device.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Literal

import pyarrow
from pyarrow import parquet

from cfd_pneumatic.files import marked, write_bytes, write_text
from cfd_pneumatic.model import SPECS

CSV_FILE = 'results.csv'
PARQUET_FILE = 'results.parquet'

FAILED, FITTED = 'failed', 'fitted'
"""Verdicts on bags without a result, and on bags without a closed loop."""

Row = dict[str, Any]
"""Values by names of columns. A missing value is None or has no entry."""

Kind = Literal['text', 'number', 'time']

_FORMULA = ('=', '+', '-', '@', '\t', '\r')
"""First characters of a spreadsheet formula. A quote is put before a text with such a first character."""

_SUFFIXES = {'Pa/m': 'pa_per_m', '1/s': 'per_s', 's': 's', 'Pa': 'pa', 'N': 'n', 'm^2': 'm2', '%': 'percent'}
_TYPES = {'text': pyarrow.string(), 'number': pyarrow.float64(), 'time': pyarrow.timestamp('ms', tz='UTC')}


@dataclass(frozen=True)
class Column:
    """
    A column of the table.

    Attributes
    ----------
    name
        Name of the column, which ends with the unit.
    kind
        Kind of the values: text, numbers, or times [ns] since 1970, which are written in milliseconds, UTC.
    description
        Description of the values.
    unit
        SI unit; empty if the values have no unit.

    """

    name: str
    kind: Kind
    description: str
    unit: str = ''


def column_of(name: str, unit: str, *which: str) -> str:
    """Return the name of a column of numbers; `which` is any of `before`, `after` and `std`, in this order."""
    return '_'.join(filter(None, (name, *which, _SUFFIXES[unit])))


def _gain_columns() -> Iterator[Column]:
    for which, condition in (('', ''), ('after', ', fitted together with the effects')):
        for spec in SPECS:
            name, std = column_of(spec.name, spec.unit, which), column_of(spec.name, spec.unit, which, 'std')
            yield Column(name, 'number', spec.description + condition, spec.unit)
            yield Column(std, 'number', f'standard error of {spec.name}{condition}', spec.unit)


def _error_columns() -> Iterator[Column]:
    for which, model in (('before', 'without effects'), ('after', 'with the effects')):
        for unit, quantity in (('Pa', 'pressure'), ('N', 'contact force')):
            yield Column(column_of('rmse', unit, which), 'number', f'error of the {quantity} {model}, RMS', unit)
        share = f'the error {model} as a share of the measured span'
        yield Column(column_of('nrmse', '%', which), 'number', share, '%')


COLUMNS = (
    Column('device', 'text', 'device on which the bag was recorded'),
    Column('time', 'time', 'begin of the recording; empty if its clock does not count from 1970'),
    Column('bag', 'text', 'path of the bag'),
    Column('part', 'text', 'cylinder_a, cylinder_b or force; empty if the bag failed'),
    Column('verdict', 'text', f'verdict of the closed loop; {FITTED} without closed loop, {FAILED} without a result'),
    Column('reason', 'text', 'reason of the verdict'),
    Column('status', 'text', 'confirmed, or hypothesis if the verdict may be wrong'),
    Column('warnings', 'text', 'codes of likely input errors, separated by semicolons'),
    Column('effects', 'text', 'effects that the model lacks, separated by semicolons'),
    Column('alternatives', 'text', 'effects that the recording cannot distinguish from these, separated by semicolons'),
    Column('law', 'text', 'unknown characteristic: the place where it enters the model, and its variable'),
    Column('judged_on', 'text', 'samples of the errors: test, or all if there is no test part'),
    *_error_columns(),
    Column('after_over_before', 'number', 'error ratio (after / before): with and without effects'),
    *_gain_columns(),
    Column(column_of('area', 'm^2'), 'number', 'piston area, from the contact force', 'm^2'),
    Column(column_of('area', 'm^2', 'std'), 'number', 'standard error of area', 'm^2'),
    Column('effect_parameters', 'text', "the effects' parameters with standard errors, as JSON"),
    Column('duration_s', 'number', 'length of the recording', 's'),
    Column('notes', 'text', 'problems of the recording'),
    Column('report', 'text', 'path of the full report, relative to the folder of this table'),
)
"""All columns, in their order."""


_FIRST = ('device', 'time', 'bag', 'part', 'verdict')
"""First columns of a table of any version."""

is_csv_table = marked(rf'\A{",".join(_FIRST)},')
"""Recognise the CSV file of the table."""


def is_parquet_table(path: Path) -> bool:
    """Recognise the Parquet file of the table."""
    try:
        return tuple(parquet.read_schema(path).names[: len(_FIRST)]) == _FIRST
    except (OSError, pyarrow.ArrowException):
        return False


def write_table(rows: Sequence[Row], folder: Path) -> list[Path]:
    """
    Write the table as CSV and Parquet, and return both files; a spreadsheet reads no text of the CSV file as a formula.

    Raises
    ------
    InputError
        If the folder cannot be written.

    """
    write_text(folder / CSV_FILE, _as_csv(rows))
    write_bytes(folder / PARQUET_FILE, _as_parquet(rows))
    return [folder / CSV_FILE, folder / PARQUET_FILE]


def iso_time(nanoseconds: int) -> str:
    """Return a time [ns] since 1970 as ISO 8601, UTC, with milliseconds."""
    seconds, milliseconds = divmod(nanoseconds // 1_000_000, 1000)
    return f'{datetime.fromtimestamp(seconds, timezone.utc):%Y-%m-%dT%H:%M:%S}.{milliseconds:03d}Z'


def _as_csv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(column.name for column in COLUMNS)
    for row in rows:
        writer.writerow(_as_text(row.get(column.name), column.kind) for column in COLUMNS)
    return text.getvalue()


def _as_text(value: Any, kind: Kind) -> str:
    if value is None:
        return ''
    text = iso_time(value) if kind == 'time' else str(value)
    return f"'{text}" if kind == 'text' and text.startswith(_FORMULA) else text


def _as_parquet(rows: Sequence[Row]) -> bytes:
    arrays, fields = [], []
    for column in COLUMNS:
        values = [row.get(column.name) for row in rows]
        if column.kind == 'time':
            values = [None if value is None else value // 1_000_000 for value in values]
        arrays.append(pyarrow.array(values, type=_TYPES[column.kind]))
        metadata = {'description': column.description, 'unit': column.unit}
        fields.append(pyarrow.field(column.name, _TYPES[column.kind], metadata=metadata))
    stream = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields)), stream)
    return stream.getvalue()
