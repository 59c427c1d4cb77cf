# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os

import numpy as np
import pytest
from recording_cases import MEASURED, ROOT, assert_same

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_mapping, read_recording, write_recording

BY_NUMBER = """\
table:
  time: {column: 1, unit: ms}
displacement: {column: 2, unit: mm, sign: -1}
cylinder_a:
  pressure: {column: 3, unit: bar, reference: gauge}
"""
ROWS = '0 1.0 2.0\n10 1.5 2.5\n20 2.0 3.0\n'


def read(folder, rows, mapping=BY_NUMBER):
    (folder / 'run.csv').write_text(rows)
    (folder / 'mapping.yaml').write_text(mapping)
    return read_recording(folder / 'run.csv', mapping=read_mapping(folder / 'mapping.yaml'))


def test_columns_by_number(tmp_path):
    found = read(tmp_path, ROWS)
    assert (found.name, found.epoch, found.force, found.health) == ('run.csv', 0, None, ())
    np.testing.assert_array_equal(found.displacement.times, [0.0, 0.01, 0.02])
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3], rtol=1e-15)
    np.testing.assert_allclose(found.cylinders['cylinder_a'].pressure.values, 101_325 + np.array([2e5, 2.5e5, 3e5]))


def test_thousands_of_times_may_be_grouped(tmp_path):
    mapping = "table: {time: {column: 1, unit: us, thousands: '.'}, delimiter: semicolon}\n"
    mapping += 'cylinder_a: {pressure: {column: 2, unit: bar, reference: gauge}}\n'
    found = read(tmp_path, '0.000;2.5\n273.000;2.4\n119.141.000;2.3\n', mapping)
    pressure = found.cylinders['cylinder_a'].pressure
    np.testing.assert_allclose(pressure.times, [0.0, 0.273, 119.141])
    np.testing.assert_allclose(pressure.values, 101_325 + np.array([2.5e5, 2.4e5, 2.3e5]))
    assert found.rests
    assert not found.displacement.values.any()


def test_columns_by_name_and_a_delimiter(tmp_path):
    mapping = """\
table: {time: {column: t, unit: s}, delimiter: comma, header_rows: 2, skip_rows: 1}
displacement: {column: laser raw, unit: mm}
cylinder_b:
  pressure: {column: p, unit: kPa, reference: absolute}
  setpoint: {column: set, unit: kPa, reference: absolute}
force: {column: f, unit: N}
"""
    rows = 'a run of May\nt, laser raw, p, set, f, note\n' + ''.join(
        f'{time},{2 * time},{3 * time},{100 if time < 3 else 200},{time},n/a\n' for time in range(1, 6)
    )
    found = read(tmp_path, rows, mapping)
    assert found.epoch == 2_000_000_000
    np.testing.assert_allclose(found.displacement.values, [0.004, 0.006, 0.008, 0.01])
    np.testing.assert_array_equal(found.cylinders['cylinder_b'].setpoint.times, [0.0, 1.0])
    np.testing.assert_array_equal(found.cylinders['cylinder_b'].setpoint.values, [1e5, 2e5])
    np.testing.assert_array_equal(found.force.values, [2, 3, 4, 5])


def test_units_may_stand_below_the_names(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  header_rows: 2').replace('column: 2', 'column: x')
    np.testing.assert_allclose(read(tmp_path, 't x p\nms mm bar\n' + ROWS, mapping).displacement.values[0], -1e-3)


def test_names_may_stand_in_a_comment(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  header_rows: 1').replace('column: 2', 'column: x')
    found = read(tmp_path, '# t x p\n' + ROWS, mapping)
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])


def test_times_before_a_trigger_are_moved_up(tmp_path):
    found = read(tmp_path, '-10 1 2\n0 1 2\n10 1 2\n', BY_NUMBER.replace('unit: mm', 'unit: mm, time_offset: -0.005'))
    assert found.epoch == 0
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.01, 0.02])
    np.testing.assert_allclose(found.cylinders['cylinder_a'].pressure.times, [0.005, 0.015, 0.025])


def test_rows_that_are_not_finite_are_dropped(tmp_path):
    found = read(tmp_path, ROWS + 'nan 1 1\n30 nan 4.0\n')
    assert len(found.displacement) == 3
    assert len(found.cylinders['cylinder_a'].pressure) == 4
    assert found.health == ('time: dropped 1 row not finite', 'displacement: dropped 1 sample not finite')


@pytest.mark.filterwarnings('error')
def test_a_number_too_large_for_its_unit_is_dropped(tmp_path):
    found = read(tmp_path, ROWS + '30 1 1e308\n')
    assert len(found.displacement) == 4
    assert found.health == ('cylinder_a pressure: dropped 1 sample not finite',)


LAYOUTS = {
    'empty fields at the end': ('comma', 't,x,note,p,\n0,1,,2\n10,1,,3,\n20,1,,4,,\n'),
    'empty fields between tabs': ('tab', 't\tx\tnote\tp\tmore\n0\t1\t\t2\t\n10\t1\t\t3\t\n20\t1\t\t4\t\n'),
    'delimiters in quotes': ('comma', 't,x,note,p\n0,1,"slow, then fast",2\n10,"1","5,5",3\n20,1,-,"4"\n'),
    'remarks and empty lines': ('space', '# t x note p\n0 1 - 2\n\n10 1 - 3\n  \n # on\n20 1 - 4\n'),
    'line ends of Windows': ('comma', 't,x,note,p\r\n0,1,,2\r\n10,1,,3\r\n20,1,,4\r\n'),
}


@pytest.mark.parametrize(('delimiter', 'rows'), LAYOUTS.values(), ids=LAYOUTS.keys())
def test_how_tables_may_be_laid_out(tmp_path, delimiter, rows):
    mapping = f"""\
table: {{time: {{column: t, unit: ms}}, delimiter: {delimiter}, header_rows: 1}}
displacement: {{column: x, unit: mm}}
cylinder_a:
  pressure: {{column: p, unit: bar, reference: absolute}}
"""
    found = read(tmp_path, rows, mapping)
    np.testing.assert_allclose(found.cylinders['cylinder_a'].pressure.values, [2e5, 3e5, 4e5])
    assert found.health == ()


def test_a_header_may_be_a_line_of_text_where_columns_are_given_by_number(tmp_path):
    found = read(tmp_path, 'press 7, a run of May\n' + ROWS, BY_NUMBER.replace('ms}', 'ms}\n  header_rows: 1'))
    assert len(found.displacement) == 3
    mapping = BY_NUMBER.replace('ms}', 'ms}\n  delimiter: comma\n  header_rows: 1')
    found = read(tmp_path, 'a run of May\n' + ROWS.replace(' ', ','), mapping)
    assert len(found.displacement) == 3


BAD = {
    'no rows': ('', BY_NUMBER, 'holds no samples'),
    'nothing but a row without its end': ('0 1.0 2.0', BY_NUMBER, 'holds no samples'),
    'all skipped': (
        ROWS,
        BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  skip_rows: 9'),
        'holds no samples after those that are skipped',
    ),
    'no such column': (
        ROWS,
        BY_NUMBER.replace('column: 3', 'column: 4'),
        'has no column of the number that the mapping gives for the cylinder_a pressure: the first row has 3; '
        'check the delimiter in the mapping',
    ),
    'no such name': (
        'time pressure_kPa note\n' + ROWS,
        BY_NUMBER.replace('column: 3', 'column: Pressure').replace('unit: ms}', 'unit: ms}\n  header_rows: 1'),
        'has no column of the name that the mapping gives for the cylinder_a pressure: of its 3 columns '
        '“pressure_kPa” is the nearest; a column may be given by its number, too',
    ),
    'a name without a header': (
        ROWS,
        BY_NUMBER.replace('column: 3', 'column: d'),
        'has no column of the name that the mapping gives for the cylinder_a pressure: '
        'for columns by name set header_rows in the mapping',
    ),
    'later than any number': (
        '1e308 1 1\n',
        BY_NUMBER,
        'the times are far too large: check their column and their unit',
    ),
    'far too long': (
        '1 1 1\n' * 11,
        BY_NUMBER.replace('time: {column: 1, unit: ms}', 'sample_period: 1.0e+9'),
        'the times are far too large: check their column and their unit',
    ),
    'far too late': (
        '1e12 1 1\n',
        BY_NUMBER.replace('unit: ms', 'unit: s'),
        'the times are far too large: check their column and their unit',
    ),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(('rows', 'mapping', 'message'), BAD.values(), ids=BAD.keys())
def test_a_table_that_cannot_be_read(tmp_path, rows, mapping, message):
    with pytest.raises(InputError) as caught:
        read(tmp_path, rows, mapping)
    assert str(caught.value) == f'{tmp_path}/run.csv: {message}'


@pytest.mark.parametrize(
    ('row', 'line'),
    [
        ('30;1.0;high', 'line 5, column 3 holds “high”; write nan where there is no value, or check delimiter'),
        ('30;1.0;2 # high', 'line 5, column 3 holds “2 # high”'),
        ('30;1.0;1_000', 'line 5, column 3 holds “1_000”'),
        ('30;1.0;٣', 'line 5, column 3 holds “٣”'),
        (
            '30;1.0;1,701.5',
            'line 5, column 3 holds “1,701.5”; if commas group its digits, `table` needs `thousands: comma`',
        ),
        ('30;1.0;1.701,5', 'if points group its digits, `table` needs `decimal: comma` and `thousands: point`'),
        ('30;1.0;1,5', 'line 5, column 3 holds “1,5”; if that is a decimal comma, `table` needs `decimal: comma`'),
        (
            '30;1.0;1,701',
            'holds “1,701”; if commas group its digits, `table` needs `thousands: comma`; '
            'if that is a decimal comma, `table` needs `decimal: comma`',
        ),
        ('30;1.0;1.701.000', 'if points group its digits, `table` needs `decimal: comma` and `thousands: point`'),
        ('30;1.0;1 701.5', 'if spaces group its digits, `table` needs `thousands: space`'),
        ('30;1.0;1\u2019701.5', 'if apostrophes group its digits, `table` needs `thousands: apostrophe`'),
        (
            '1.701,5;1;2',
            'if points group its digits, `table` needs `decimal: comma` and `time` needs `thousands: point`',
        ),
        ('30;1.0;2 bar', 'holds “2 bar”; write the number alone, without a unit or another mark'),
        (
            '1.5.24 12:00;1;2',
            'if it is the time, write it as 2024-05-01 12:00:00.25 or 12:00:00.25 and set `unit: date`',
        ),
        ('Samples: 10001', 'line 5 has 1 field, but the first row has 3: “Samples: 10001”; delete the line if it is'),
        ('2024-05-01 12:00:00;1.0;2', 'column 1 holds “2024-05-01 12:00:00”; if it is the time, `unit: date` reads it'),
    ],
)
def test_a_row_that_is_not_numbers(tmp_path, row, line):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: semicolon')
    with pytest.raises(InputError) as caught:
        read(tmp_path, f'{ROWS.replace(" ", ";")}# a pause\n{row}\n', mapping)
    assert 'run.csv: ' in str(caught.value)
    assert line in str(caught.value)


def test_numbers_may_have_decimal_commas(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', "unit: ms, thousands: '.'}\n  decimal: comma\n  delimiter: semicolon")
    found = read(tmp_path, '0;1,0;2,0\n10,5;1,5;2,5\n1.010,5;2;3,0\n', mapping)
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.0105, 1.0105])
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])
    mapping = mapping.replace('semicolon', 'comma')
    found = read(tmp_path, '"0","1,0","2,0"\n"10,5","1,5","2,5"\n"1.010,5",2,"3,0"\n', mapping)
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])
    with pytest.raises(InputError, match='line 2 has 6 fields, but the first row has 3'):
        read(tmp_path, '"0","1,0","2,0"\n10,5,1,5,2,5\n', mapping)


@pytest.mark.parametrize(
    ('decimal', 'thousands', 'texts'),
    [
        ('comma', 'point', ['1.701,21', '999,5', '1.234.567', '-1.000,0']),
        ('point', 'comma', ['1,701.21', '999.5', '1,234,567', '-1,000.0']),
        ('comma', 'space', ['1 701,21', '999,5', '1 234 567', '-1 000,0']),
        ('point', 'apostrophe', ["1'701.21", '999.5', "1'234'567", "-1'000.0"]),
        ('comma', 'space', ['1\u00a0701,21', '999,5', '1\u00a0234\u00a0567', '-1\u00a0000,0']),
        ('comma', 'space', ['1\u202f701,21', '999,5', '1\u202f234\u202f567', '\u22121\u202f000,0']),
        ('point', 'apostrophe', ['1\u2019701.21', '999.5', '1\u2019234\u2019567', '-1\u2019000.0']),
    ],
)
def test_digits_may_be_grouped(tmp_path, decimal, thousands, texts):
    layout = f'unit: ms}}\n  decimal: {decimal}\n  thousands: {thousands}\n  delimiter: semicolon'
    mapping = BY_NUMBER.replace('unit: ms}', layout).replace('sign: -1', 'sign: 1')
    found = read(tmp_path, ''.join(f'{index};{text};2\n' for index, text in enumerate(texts)), mapping)
    np.testing.assert_allclose(found.displacement.values, [1.70121, 0.9995, 1234.567, -1.0])


@pytest.mark.parametrize(('name', 'mark'), [('space', b'\xa0'), ('apostrophe', b'\x92')])
def test_digits_may_be_grouped_by_the_characters_of_windows(tmp_path, name, mark):
    layout = f'unit: ms}}\n  decimal: comma\n  thousands: {name}\n  delimiter: semicolon'
    (tmp_path / 'mapping.yaml').write_text(BY_NUMBER.replace('unit: ms}', layout))
    (tmp_path / 'run.csv').write_bytes(b'0;1' + mark + b'701,21;2\n1;1;2\n')
    found = read_recording(tmp_path / 'run.csv', mapping=read_mapping(tmp_path / 'mapping.yaml'))
    np.testing.assert_allclose(found.displacement.values, [-1.70121, -1e-3])


@pytest.mark.parametrize(
    ('decimal', 'texts'),
    [('point', ['\u22121.5', '1.5D-01', '-1.5d+2', '.5D1']), ('comma', ['\u22121,5', '1,5D-01', '-1,5d+2', ',5D1'])],
)
def test_numbers_may_have_a_minus_sign_or_an_exponent_of_fortran(tmp_path, decimal, texts):
    mapping = BY_NUMBER.replace('unit: ms}', f'unit: ms}}\n  decimal: {decimal}\n  delimiter: semicolon')
    found = read(tmp_path, ''.join(f'{row};{text};2\n' for row, text in enumerate(texts)), mapping)
    np.testing.assert_allclose(found.displacement.values, [1.5e-3, -0.15e-3, 0.15, -5e-3])


@pytest.mark.parametrize('text', ['12D4', '1D', '1.5Dx'])
def test_letters_that_are_no_exponent_are_no_number(tmp_path, text):
    with pytest.raises(InputError, match=f'line 2, column 2 holds “{text}”'):
        read(tmp_path, f'0 1 2\n1 {text} 2\n')


@pytest.mark.parametrize('text', ['1.70,5', '17.0123', '1..701', '1.7011', '.701'])
def test_digits_that_are_not_grouped_by_threes_are_no_number(tmp_path, text):
    layout = 'unit: ms}\n  decimal: comma\n  thousands: point\n  delimiter: semicolon'
    with pytest.raises(InputError, match='line 1, column 2 holds'):
        read(tmp_path, f'0;{text};2\n1;1;2\n', BY_NUMBER.replace('unit: ms}', layout))


MISSING = [
    '',
    ' ',
    '-',
    'NaN',
    'NA',
    'n/a',
    '#N/A',
    '#DIV/0!',
    '#VALUE!',
    '1.#QNAN',
    '-1.#IND',
    '1.#INF',
    '-1.#IND00',
    '1.#QNAN0',
    '1.#QO',
    'NULL',
    'None',
]


@pytest.mark.parametrize('text', MISSING)
@pytest.mark.parametrize('column', [1, 2])
def test_what_says_that_there_is_no_number_is_left_out_with_a_note(tmp_path, text, column):
    fields = ['20', '1.0', '2.0']
    fields[column] = text
    rows = ''.join(f'{10 * index};1.{index};2.{index}\n' for index in range(2)) + ';'.join(fields) + '\n30;2;3\n'
    found = read(tmp_path, rows, BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: semicolon'))
    signal = found.displacement if column == 1 else found.cylinders['cylinder_a'].pressure
    np.testing.assert_allclose(signal.times, [0.0, 0.01, 0.03])
    assert any('dropped 1 sample not finite' in note for note in found.health)


def test_a_signal_that_ends_early_is_noted(tmp_path):
    rows = ''.join(f'{100 * row} {row} {2.0 if row < 50 else "nan"}\n' for row in range(201))
    assert read(tmp_path, rows).health == (
        'cylinder_a pressure: dropped 151 samples not finite',
        'cylinder_a pressure: samples from 0 to 4.9 s only, the recording is from 0 to 20 s: '
        'check its sensor and its source',
    )
    rows = ''.join(f'{100 * row} {row if row > 15 else "nan"} 2\n' for row in range(201))
    assert len(read(tmp_path, rows).health) == 1, 'less than a tenth is missing'


def test_a_row_without_a_time_is_left_out_with_a_note(tmp_path):
    found = read(tmp_path, '0;1;2\n;9;9\n10;2;3\n', BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: semicolon'))
    assert found.health == ('time: dropped 1 row not finite',)
    assert len(found.displacement) == 2


def test_a_table_may_have_a_sample_period_for_its_time(tmp_path):
    mapping = BY_NUMBER.replace('time: {column: 1, unit: ms}', 'sample_period: 2.0e-3')
    found = read(tmp_path, ROWS, mapping)
    np.testing.assert_allclose(found.displacement.times, [0.0, 2e-3, 4e-3])
    with pytest.raises(InputError, match='leave `time` out and give `sample_period`'):
        read(tmp_path, '\t1\t2\n\t2\t3\n', BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: tab'))
    with pytest.raises(InputError, match='needs either `time`, the column of the time, or `sample_period`'):
        read(tmp_path, ROWS, mapping.replace('sample_period: 2.0e-3', 'header_rows: 0'))
    with pytest.raises(InputError, match='sample_period must be above 0 s'):
        read(tmp_path, ROWS, mapping.replace('2.0e-3', '0'))


@pytest.mark.parametrize(
    ('unit', 'rows', 'step'),
    [
        ('unit: d', '45413.5 1 2\n45413.50001 2 3\n', 0.864),
        ('unit: d', '739373.5 1 2\n739373.50001 2 3\n', 0.864),  # MATLAB's datenum
        ('unit: us, scale: 0.1', '133800000000000000 1 2\n133800000005000000 2 3\n', 0.5),  # FILETIME of Windows
        ('unit: ns, scale: 100', '638502012000000000 1 2\n638502012005000000 2 3\n', 0.5),  # ticks of .NET
        ('unit: h', '0 1 2\n0.001 2 3\n', 3.6),
        ('unit: min', '0 1 2\n0.5 2 3\n', 30.0),
        ('unit: s, scale: 1/50', '100 1 2\n150 2 3\n', 1.0),
        ('unit: ms, scale: 2, offset: 1000', '0 1 2\n50 2 3\n', 0.1),
    ],
)
def test_times_may_be_in_any_unit_and_scale(tmp_path, unit, rows, step):
    found = read(tmp_path, rows, BY_NUMBER.replace('unit: ms', unit))
    np.testing.assert_allclose(np.diff(found.displacement.times), [step], atol=1e-5)
    write_recording(tmp_path / 'bag', found)  # the days of a spreadsheet are later than any stamp


@pytest.mark.parametrize(
    ('unit', 'size'),
    [('ms', 2**16), ('ms', 2**32), ('us', 2**32), ('ms', 86_400_000), ('s, scale: 1/50', 4_320_000), ('s', 86_400)],
)
@pytest.mark.parametrize('first', [-12, 0])
def test_a_counter_that_begins_again_is_counted_on(tmp_path, unit, size, first):
    counts = size + first + 5 * np.arange(6)
    rows = ''.join(f'{count % size} {row} 2\n' for row, count in enumerate(counts))
    found = read(tmp_path, rows, BY_NUMBER.replace('unit: ms', f'unit: {unit}'))
    assert len(np.unique(np.diff(found.displacement.times).round(9))) == 1
    assert any('the counter wraps' in note for note in found.health) == (first < 0)
    assert len(found.displacement) == 6


def test_a_counter_may_begin_again_several_times_and_below_zero(tmp_path):
    counts = (1000 * np.arange(300) + 2**15) % 2**16 - 2**15
    found = read(tmp_path, ''.join(f'{count} {row} 2\n' for row, count in enumerate(counts)))
    np.testing.assert_allclose(np.diff(found.displacement.times), 1.0)
    assert found.health[0] == 'time: the counter wraps after 65,536 (5 times): times continue'


def test_a_clock_that_was_set_back_is_no_counter_that_begins_again(tmp_path):
    rows = ''.join(f'{count} {row} 2\n' for row, count in enumerate([*range(60_000, 60_100), *range(100)]))
    with pytest.raises(InputError, match=r'time goes back by 60\.099 s at sample 101'):
        read(tmp_path, rows)


@pytest.mark.parametrize('comment', ['', '\tby hand'])
def test_a_header_may_have_a_name_for_comments_that_most_rows_lack(tmp_path, comment):
    """As LabVIEW writes it."""
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: tab\n  header_rows: 1')
    found = read(tmp_path, f't\tx\tp\tComment\n0\t1\t2\n10\t1.5\t2.5{comment}\n20\t2\t3\n', mapping)
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])
    with pytest.raises(InputError, match='line 3 has 2 fields, but the header has 4 names'):
        read(tmp_path, 't\tx\tp\tComment\n0\t1\t2\n10\t1.5\n', mapping)


@pytest.mark.parametrize(
    ('times', 'epoch'),
    [
        (('2024-05-01 12:00:00.000', '2024-05-01T12:00:00,25', '2024-05-01 12:00:01.5'), 1_714_564_800),
        (('2024-05-01T14:00:00+02:00', '2024-05-01T14:00:00.25+0200', '2024-05-01T12:00:01.5Z'), 1_714_564_800),
        (('12:00:00', '12:00:00.25', '12:00:01.5'), 43_200),
    ],
)
def test_times_may_be_dates_or_of_the_day(tmp_path, times, epoch):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: date}\n  delimiter: semicolon')
    found = read(tmp_path, ''.join(f'{time};{index};2\n' for index, time in enumerate(times)), mapping)
    assert found.epoch == epoch * 10**9
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.25, 1.5], rtol=0, atol=1e-6)


@pytest.mark.parametrize('time', ['01.05.2024 12:00:00', '2024-13-01 12:00:00', '0.5'])
def test_a_time_that_is_no_date_is_refused(tmp_path, time):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: date}\n  delimiter: semicolon')
    with pytest.raises(InputError, match=f'line 1, column 1 holds “{time}”; times must be such as 2024-05-01 12:00:00'):
        read(tmp_path, f'{time};1;2\n', mapping)


@pytest.mark.parametrize(('column', 'nearest'), [('P', 'p'), ('OIL', 'Oil'), ('Öl', 'öl')])
def test_the_nearest_name_may_differ_in_upper_and_lower_case(tmp_path, column, nearest):
    mapping = BY_NUMBER.replace('column: 3', f'column: {column}').replace('unit: ms}', 'unit: ms}\n  header_rows: 1')
    with pytest.raises(InputError, match=f'of its 5 columns “{nearest}” is the nearest'):
        read(tmp_path, 'T X p Oil öl\n0 1 2 3 4\n', mapping)


@pytest.mark.parametrize('encoding', ['utf-16-le', 'utf-16-be'])
def test_utf_16_needs_no_byte_order_mark(tmp_path, encoding):
    (tmp_path / 'mapping.yaml').write_text(BY_NUMBER)
    (tmp_path / 'run.csv').write_bytes(ROWS.encode(encoding))
    found = read_recording(tmp_path / 'run.csv', mapping=read_mapping(tmp_path / 'mapping.yaml'))
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'utf-16', 'utf-16-le', 'latin-1'])
def test_text_may_be_encoded_as_spreadsheets_do(tmp_path, encoding):
    (tmp_path / 'mapping.yaml').write_text(
        BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  header_rows: 1')
        .replace('column: 1', 'column: t')
        .replace('column: 3', 'column: Öldruck'),
        encoding='utf-8',
    )
    text = 't x Öldruck\r\n' + ROWS
    mark = b'\xff\xfe' if encoding == 'utf-16-le' else b''
    (tmp_path / 'run.csv').write_bytes(mark + text.encode(encoding))
    found = read_recording(tmp_path / 'run.csv', mapping=read_mapping(tmp_path / 'mapping.yaml'))
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -1.5e-3, -2e-3])


def test_times_that_lack_digits_are_noted_and_one_time_alone_is_refused(tmp_path):
    rows = ''.join(f'{10 * (index // 5)} {index} 2\n' for index in range(50))
    assert read(tmp_path, rows).health[0].startswith('time: 40 of 50 rows have the time of the row before')
    with pytest.raises(InputError, match='the time never changes: is its column the time, with all its digits'):
        read(tmp_path, '5 1 2\n' * 20)


def test_of_many_columns_one_is_shown(tmp_path):
    mapping = BY_NUMBER.replace('column: 3', 'column: d').replace('unit: ms}', 'unit: ms}\n  header_rows: 1')
    with pytest.raises(InputError, match=r'of its 100,000 columns “c\d+” is the nearest') as caught:
        read(tmp_path, ' '.join(f'c{index}' for index in range(100_000)) + '\n' + '1 ' * 100_000 + '\n', mapping)
    assert len(str(caught.value)) < 500
    with pytest.raises(InputError, match=r'its header has one name; check the delimiter in the mapping'):
        read(tmp_path, 't,x,p\n1,2,3\n', mapping.replace('column: 2', 'column: x'))


def test_a_table_that_is_not_there_or_not_text(tmp_path):
    (tmp_path / 'mapping.yaml').write_text(BY_NUMBER)
    mapping = read_mapping(tmp_path / 'mapping.yaml')
    with pytest.raises(InputError, match=r'none.csv: cannot be read: No such file or directory$'):
        read_recording(tmp_path / 'none.csv', mapping=mapping)
    (tmp_path / 'bag.mcap').write_bytes(b'\x89MCAP0\r\n\xff\xfe')
    with pytest.raises(InputError, match=r'bag.mcap: is not a text file, and the mapping is for tables$'):
        read_recording(tmp_path / 'bag.mcap', mapping=mapping)


def test_a_line_without_an_end(tmp_path):
    (tmp_path / 'mapping.yaml').write_text(BY_NUMBER)
    (tmp_path / 'run.csv').touch()
    os.truncate(tmp_path / 'run.csv', 2**25)
    with pytest.raises(InputError, match=r'run.csv: has a line of more than 16,777,216 characters: is it a table\?'):
        read_recording(tmp_path / 'run.csv', mapping=read_mapping(tmp_path / 'mapping.yaml'))


def test_a_table_without_a_mapping(tmp_path):
    (tmp_path / 'run.csv').write_text(ROWS)
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / 'run.csv')
    assert str(caught.value) == (
        f'{tmp_path}/run.csv: is not a bag: give the folder of a ROS 2 bag, a .mcap, .db3 or ROS 1 .bag file, '
        'or a table together with its mapping file, `--mapping FILE`; `csv_to_bag --help` shows one'
    )


MEASURED_RUNS = sorted(MEASURED.glob('friction/*.csv'))


@pytest.mark.skipif(not MEASURED_RUNS, reason='the measured data are not there: set CFD_PNEUMATIC_DATA to their folder')
def test_the_measured_runs_come_out_of_a_bag_as_they_went_in(tmp_path):
    mapping = read_mapping(ROOT / 'config' / 'pneumatic_actuator.yaml')
    for run in MEASURED_RUNS[:3]:
        measured = read_recording(run, mapping=mapping)
        write_recording(tmp_path / run.stem, measured)
        assert_same(read_recording(tmp_path / run.stem), measured)
        rows = np.loadtxt(run)[15:]
        pressure = measured.cylinders['cylinder_a'].pressure
        np.testing.assert_allclose(measured.displacement.values, -1e-3 * rows[:, 4], rtol=0, atol=1e-15)
        np.testing.assert_allclose(pressure.values, 1e5 * rows[:, 5] + 101_325, rtol=1e-15)
        np.testing.assert_allclose(measured.force.values, rows[:, 6])
        np.testing.assert_allclose(pressure.times, 1e-3 * (rows[:, 0] - rows[0, 0]), rtol=0, atol=1e-9)
        # The pressure rises while the laser's reading does, because the chamber shrinks.
        assert np.corrcoef(measured.displacement.values, pressure.values)[0, 1] < 0


def test_times_of_the_day_go_on_past_midnight(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: date}\n  delimiter: comma')
    found = read(tmp_path, '23:59:59.50,1,2\n23:59:59.75,2,2\n00:00:00.00,3,2\n00:00:00.25,4,2\n', mapping)
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.25, 0.5, 0.75])


def test_points_beside_decimal_commas_group_digits_and_are_refused(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: semicolon\n  decimal: comma')
    with pytest.raises(InputError, match=r'line 1, column 3 holds “101\.325”'):
        read(tmp_path, '0,0;1,5;101.325\n1,0;1,5;101.325\n', mapping)


@pytest.mark.parametrize('text', ['0.00155 mm', '(0.123)', '< 0.5', '$5.00'])
def test_a_first_number_with_a_mark_is_not_taken_for_a_unit(tmp_path, text):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: comma\n  header_rows: 1')
    with pytest.raises(InputError) as caught:
        read(tmp_path, f't,x,p\n0,{text},2\n1,2,3\n', mapping)
    assert f'line 2, column 2 holds “{text}”; write the number alone, without a unit' in str(caught.value)


def test_points_group_the_digits_of_a_first_row(tmp_path):
    layout = 'unit: ms}\n  delimiter: semicolon\n  decimal: comma\n  header_rows: 1'
    with pytest.raises(InputError, match=r'“170\.121”; if points group its digits, `table` needs `thousands: point`; '):
        read(tmp_path, 't;x;p\n0,0;1,5;170.121\n1,0;1,5;170.121\n', BY_NUMBER.replace('unit: ms}', layout))


def test_the_digits_of_times_may_be_grouped_by_a_named_character(tmp_path):
    layout = 'unit: ms, thousands: space}\n  delimiter: semicolon'
    found = read(tmp_path, '990;1;2\n1 000;1;2\n1\u00a0010;1;2\n', BY_NUMBER.replace('unit: ms}', layout))
    np.testing.assert_allclose(found.displacement.times, [0.0, 0.01, 0.02])


def test_a_row_of_units_below_the_names_is_told(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: comma\n  header_rows: 1')
    with pytest.raises(
        InputError, match=r'line 2, column 1 holds “ms”; if the line has names or units, .* needs `header_rows: 2`'
    ):
        read(tmp_path, 't,x,p\nms,mm,bar\n0,1,2\n1,2,3\n', mapping)


def test_a_title_above_columns_by_number_is_no_name(tmp_path):
    mapping = BY_NUMBER.replace('unit: ms}', 'unit: ms}\n  delimiter: comma\n  header_rows: 2')
    found = read(tmp_path, 'Recorded by Bob, lab 3\n\n0,1,2\n1,2,3\n', mapping)
    np.testing.assert_allclose(found.displacement.values, [-1e-3, -2e-3])
