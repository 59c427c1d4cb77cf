# SPDX-License-Identifier: Apache-2.0
"""The table: its two forms say the same, and keep what they were given."""

from __future__ import annotations

import csv
from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from cfd_pneumatic.plant.result_table import COLUMNS, iso_time, write_table

VALUES = {
    'text': st.text(st.characters(blacklist_categories=['Cs', 'Cc']), min_size=1),
    'number': st.floats(allow_nan=False, allow_infinity=False),
    'time': st.integers(631_152_000, 2**31).map(lambda seconds: seconds * 10**9 + 123_456_789),
}
ROWS = st.lists(st.fixed_dictionaries({}, optional={one.name: VALUES[one.kind] for one in COLUMNS}), max_size=4)


def read(folder):
    """Return the rows of both forms, with None where there is nothing."""
    with (folder / 'results.csv').open(newline='', encoding='utf-8') as stream:
        texts = [{name: text or None for name, text in row.items()} for row in csv.DictReader(stream)]
    return texts, parquet.read_table(folder / 'results.parquet')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('table')


@given(ROWS)
def test_both_forms_keep_every_value(folder, rows):
    write_table(rows, folder)
    texts, table = read(folder)
    assert table.column_names == [one.name for one in COLUMNS]
    for one in COLUMNS:
        given_values = [row.get(one.name) for row in rows]
        in_text = [row[one.name] for row in texts]
        in_parquet = table[one.name].to_pylist()
        if one.kind == 'time':
            told = [None if value is None else iso_time(value) for value in given_values]
            assert in_text == told
            assert in_parquet == [
                None if text is None else datetime.fromisoformat(text[:-1] + '+00:00') for text in told
            ]
        elif one.kind == 'number':
            assert [None if text is None else float(text) for text in in_text] == in_parquet == given_values
        else:
            assert in_parquet == given_values
            assert in_text == [value and ("'" + value if value[0] in '=+-@' else value) for value in given_values]


def test_times_are_iso_8601_in_utc():
    assert iso_time(1_700_000_000_123_456_789) == '2023-11-14T22:13:20.123Z'


def test_columns_tell_their_units(folder):
    write_table([], folder)
    _, table = read(folder)
    units = {field.name: field.metadata[b'unit'].decode() for field in table.schema}
    assert units['k_x_pa_per_m'] == units['k_x_after_std_pa_per_m'] == 'Pa/m'
    assert units['rmse_before_n'] == 'N'
    assert units['verdict'] == ''
    assert all(field.metadata[b'description'] for field in table.schema)
    assert len(set(units)) == len(COLUMNS)
