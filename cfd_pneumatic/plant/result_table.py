# SPDX-License-Identifier: Apache-2.0
"""
The table of all results: its columns, and its two forms, CSV and Parquet.

One row for each cylinder of each bag, and one for the contact force where it was identified too: `verdict`, the
parameters and the rest mean the same in each row, so that ``table[table.part == 'cylinder_a'].groupby('device')`` is
all it takes to follow them. A bag that failed is one row.
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
"""Verdicts on bags that give no result, and on those whose loop was not closed."""

Row = dict[str, Any]
"""Values by the names of columns; None, or no entry, where there is none."""

Kind = Literal['text', 'number', 'time']

_FORMULA = ('=', '+', '-', '@', '\t', '\r')
"""What a spreadsheet takes for the beginning of a formula; a text that begins so gets a quote before it."""

_SUFFIXES = {'Pa/m': 'pa_per_m', '1/s': 'per_s', 's': 's', 'Pa': 'pa', 'N': 'n', 'm^2': 'm2', '%': 'percent'}
_TYPES = {'text': pyarrow.string(), 'number': pyarrow.float64(), 'time': pyarrow.timestamp('ms', tz='UTC')}


@dataclass(frozen=True)
class Column:
    """
    A column of the table.

    Attributes
    ----------
    name
        Of the column, its unit at the end.
    kind
        What stands in it: text, numbers, or times [ns] since 1970, which are written in milliseconds, UTC.
    description
        What it is.
    unit
        SI unit; empty where it has none.

    """

    name: str
    kind: Kind
    description: str
    unit: str = ''


def column_of(name: str, unit: str, *which: str) -> str:
    """Return the name of a column of numbers; `which` may be `before`, `after` and `std`, in this order."""
    return '_'.join(filter(None, (name, *which, _SUFFIXES[unit])))


def _gain_columns() -> Iterator[Column]:
    for which, of in (('', ''), ('after', ', fitted beside the effects')):
        for spec in SPECS:
            name, std = column_of(spec.name, spec.unit, which), column_of(spec.name, spec.unit, which, 'std')
            yield Column(name, 'number', spec.description + of, spec.unit)
            yield Column(std, 'number', f'standard error of {spec.name}{of}', spec.unit)


def _error_columns() -> Iterator[Column]:
    for which, model in (('before', 'without effects'), ('after', 'with the effects')):
        for unit, of in (('Pa', 'pressure'), ('N', 'contact force')):
            yield Column(column_of('rmse', unit, which), 'number', f'error of the {of} {model}, RMS', unit)
        share = f'the error {model} as a share of the measured span'
        yield Column(column_of('nrmse', '%', which), 'number', share, '%')


COLUMNS = (
    Column('device', 'text', 'what the bag was recorded on'),
    Column('time', 'time', 'when the recording begins; empty where its clock does not count from 1970'),
    Column('bag', 'text', 'path of the bag'),
    Column('part', 'text', 'cylinder_a, cylinder_b or force; empty where the bag failed'),
    Column('verdict', 'text', f'of closing the loop; {FITTED} where it stayed open, {FAILED} where there is no result'),
    Column('reason', 'text', 'why that is the verdict'),
    Column('status', 'text', 'confirmed, or hypothesis where the verdict may be wrong'),
    Column('warnings', 'text', 'which mistakes the bag looks like, by semicolons'),
    Column('effects', 'text', 'effects that the model lacks, by semicolons'),
    Column('alternatives', 'text', 'effects that the recording cannot tell from those, by semicolons'),
    Column('law', 'text', 'where a law that is none of the effects enters, and what it depends on'),
    Column('judged_on', 'text', 'samples that the errors are those of: test, or all where there is no test part'),
    *_error_columns(),
    Column('after_over_before', 'number', 'error with the effects over the error without'),
    *_gain_columns(),
    Column(column_of('area', 'm^2'), 'number', 'piston area, from the contact force', 'm^2'),
    Column(column_of('area', 'm^2', 'std'), 'number', 'standard error of area', 'm^2'),
    Column('effect_parameters', 'text', "the effects' parameters with standard errors, as JSON"),
    Column('duration_s', 'number', 'length of the recording', 's'),
    Column('notes', 'text', 'what was amiss with the recording'),
    Column('report', 'text', 'the full report, from the folder of this table'),
)
"""All columns, in their order."""


_FIRST = ('device', 'time', 'bag', 'part', 'verdict')
"""Columns that a table of any version begins with."""

is_csv_table = marked(rf'\A{",".join(_FIRST)},')
"""Recognises a table in its form as CSV."""


def is_parquet_table(path: Path) -> bool:
    """Recognise a table in its form as Parquet."""
    try:
        return tuple(parquet.read_schema(path).names[: len(_FIRST)]) == _FIRST
    except (OSError, pyarrow.ArrowException):
        return False


def write_table(rows: Sequence[Row], folder: Path) -> list[Path]:
    """
    Write the table in both forms and return the files; no text in the CSV file is a formula to a spreadsheet.

    Raises
    ------
    InputError
        If the folder can't be written.

    """
    write_text(folder / CSV_FILE, _as_csv(rows))
    write_bytes(folder / PARQUET_FILE, _as_parquet(rows))
    return [folder / CSV_FILE, folder / PARQUET_FILE]


def iso_time(nanoseconds: int) -> str:
    """Return a time [ns] since 1970 as ISO 8601, UTC, with milliseconds."""
    seconds, rest = divmod(nanoseconds // 1_000_000, 1000)
    return f'{datetime.fromtimestamp(seconds, timezone.utc):%Y-%m-%dT%H:%M:%S}.{rest:03d}Z'


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
        about = {'description': column.description, 'unit': column.unit}
        fields.append(pyarrow.field(column.name, _TYPES[column.kind], metadata=about))
    stream = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields)), stream)
    return stream.getvalue()
