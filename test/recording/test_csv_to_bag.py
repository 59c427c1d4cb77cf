# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
import subprocess
import sys
from typing import NamedTuple

import pytest
from recording_cases import ROOT, assert_same

from cfd_pneumatic.commands import program
from cfd_pneumatic.commands.csv_to_bag import main
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_mapping, read_recording

MAPPING = """\
table: {time: {column: 1, unit: ms}}
displacement: {column: 2, unit: mm, sign: -1}
cylinder_a:
  pressure: {column: 3, unit: bar, reference: gauge}
  setpoint: {column: 4, unit: bar, reference: gauge}
force: {column: 5, unit: N}
"""

TALK = """\
import sys
from cfd_pneumatic.commands import program

def talk(arguments):
    for _ in range(99_999):
        print('word ' * 20)

sys.exit(program.run('talk', talk))
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'run.csv').write_text(''.join(f'{10 * i} {i % 7} {2 + i % 5} {2 + i // 25} {i}\n' for i in range(50)))
    (tmp_path / 'mapping.yaml').write_text(MAPPING)
    return tmp_path


class Done(NamedTuple):
    """How the program ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def csv_to_bag(folder, monkeypatch, capsys):
    """Return the program, run in the folder and in this process."""
    monkeypatch.chdir(folder)

    def run(*arguments):
        capsys.readouterr()
        return Done(main(arguments), *capsys.readouterr())

    return run


def in_a_process(folder, *arguments):
    return subprocess.run(
        [sys.executable, '-m', 'cfd_pneumatic.commands.csv_to_bag', *arguments],
        cwd=folder,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_table_becomes_a_bag_that_says_the_same(folder, storage):
    done = in_a_process(folder, 'run.csv', '--mapping', 'mapping.yaml', '--output', 'out/bag', '--storage', storage)
    assert (done.returncode, done.stderr) == (0, '')
    said = done.stdout.splitlines()
    assert (said[0], said[-1]) == ('run.csv:', 'bag written to the folder out/bag')
    assert [line.partition(':')[0].strip() for line in said[1:5]] == [
        'displacement',
        'cylinder_a pressure',
        'cylinder_a setpoint',
        'force',
    ]
    assert said[1].endswith('; 50 samples at 100 Hz in 0.49 s')
    direct = read_recording(folder / 'run.csv', mapping=read_mapping(folder / 'mapping.yaml'))
    bag = read_recording(folder / 'out' / 'bag')
    assert_same(bag, direct, setpoint_error=1e-9)
    said = [(one.unit, one.reference) for *_, one in bag.signals()]
    assert said == [('mm', None), ('bar', 'gauge'), ('bar', 'gauge'), ('N', None)]


def test_a_unit_that_is_none_is_no_unit_of_a_bag(folder, csv_to_bag):
    assert csv_to_bag('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag').returncode == 0
    metadata = folder / 'bag' / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('bar gauge', 'furlong upside down'))
    assert [one.unit for *_, one in read_recording(folder / 'bag').signals()] == ['mm', None, None, 'N']


def test_bad_input_ends_with_one_line_and_earlier_output_stays(folder):
    (folder / 'out').mkdir()
    (folder / 'out' / 'metadata.yaml').write_text('of an earlier run')
    with (folder / 'run.csv').open('a') as rows:
        rows.write('500 x 1 1 1\n')
    done = in_a_process(folder, 'run.csv', '--mapping', 'mapping.yaml', '--output', 'out', '--overwrite')
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.startswith('csv_to_bag: error: run.csv: cannot be read as a table of numbers: ')
    assert done.stderr.count('\n') == 1
    assert (folder / 'out' / 'metadata.yaml').read_text() == 'of an earlier run'
    assert sorted(os.listdir(folder)) == ['mapping.yaml', 'out', 'run.csv']


NAMED = """\
table: {time: {column: t, unit: ms}, delimiter: comma, header_rows: 1}
displacement: {column: x, unit: mm}
cylinder_a:
  pressure: {column: p, unit: bar, reference: gauge}
"""
CHECK = 'check delimiter and header_rows in the mapping; numbers with decimal commas need `decimal: comma`'
BY_NUMBER = NAMED.replace('column: t', 'column: 1').replace('column: x', 'column: 2').replace('column: p', 'column: 3')
REFUSED = {
    'decimal commas': (
        NAMED,
        't,x,p,f\n0,000,0,000,2,000,1\n2,000,0,001,2,011,1\n',
        f'run.csv: line 2 has 7 fields, but the header has 4 names: {CHECK}',
    ),
    'decimal commas, columns by number': (
        BY_NUMBER,
        't,x,p\n0,000,0,000,2,000\n2,000,0,001,2,011\n',
        f'run.csv: line 2 has 6 fields, but the header has 3 names: {CHECK}',
    ),
    'decimal commas in some rows, no header': (
        BY_NUMBER.replace('header_rows: 1', 'header_rows: 0'),
        '0,1,2\n10,1,5,2\n20,2,2\n',
        f'run.csv: line 2 has 4 fields, but the first row has 3: {CHECK}',
    ),
    'a field too few': (
        NAMED,
        't,x,p,f\n0,1,2,3\n\n# a remark\n10,1,3\n20,1,2,3\n',
        'run.csv: line 5 has 3 fields, but the header has 4 names: “10,1,3”; delete the line if it is a footer, '
        f'or {CHECK}',
    ),
    'a name too few': (
        NAMED,
        't,x,p\n1,0,1,2\n2,10,1,2\n',  # as R writes the names of rows
        f'run.csv: line 2 has 4 fields, but the header has 3 names: {CHECK}',
    ),
    'two rows in one line': (
        MAPPING,
        '0 1 2 2 0\n10 1 2 2 020 1 2 2 0\n',
        f'run.csv: line 2 has 9 fields, but the first row has 5: {CHECK}',
    ),
    'a name twice': (
        NAMED,
        't,x,p,p\n0,1,2,3\n10,1,2,3\n',
        'run.csv: has 2 columns of the name that the mapping gives for the cylinder_a pressure: '
        'give the number of the column',
    ),
    'a key twice': (
        f'{NAMED}displacement: {{column: x, unit: m}}\n',
        't,x,p\n0,1,2\n10,1,2\n',
        'mapping.yaml: line 5: the key is already in line 2: remove one of the two',
    ),
    'scale 0': (
        NAMED.replace('unit: mm', 'unit: mm, scale: 0'),
        't,x,p\n0,1,2\n10,1,2\n',
        'mapping.yaml: line 2: displacement: scale must not be 0: it is the value of one raw unit in `unit`',
    ),
    'a name that csv does not take': (
        NAMED,
        f't,x,p,{"f" * 200_000}\n0,1,2,3\n',
        f'run.csv: cannot be read as a table; {CHECK}',
    ),
}


@pytest.mark.parametrize(('mapping', 'rows', 'message'), REFUSED.values(), ids=REFUSED.keys())
def test_what_would_be_read_wrongly_is_refused_with_one_line(csv_to_bag, folder, mapping, rows, message):
    (folder / 'run.csv').write_text(rows)
    (folder / 'mapping.yaml').write_text(mapping)
    done = csv_to_bag('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag')
    assert (done.returncode, done.stdout, done.stderr) == (2, '', f'csv_to_bag: error: {message}\n')
    assert sorted(os.listdir(folder)) == ['mapping.yaml', 'run.csv']


def test_rows_that_are_left_out_are_said(csv_to_bag, folder):
    """Without a time, and cut off where the logger was: 130 bar may have been 1300."""
    with (folder / 'run.csv').open('a') as rows:
        rows.write('nan 1 1 1 1\ninf 1 1 1 1\n500 1 1 1 1\n510 1 130')
    done = csv_to_bag('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag')
    assert (done.returncode, done.stderr) == (0, '')
    said = done.stdout.splitlines()
    assert said[5:7] == ['  the last row has no line end and may be cut: left out', '  time: dropped 2 rows not finite']


def test_a_bag_that_is_there_is_kept_or_replaced(csv_to_bag, folder):
    arguments = ('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag')
    assert csv_to_bag(*arguments).returncode == 0
    done = csv_to_bag(*arguments)
    assert done.returncode == 2
    assert done.stderr == (
        'csv_to_bag: error: bag exists already: choose another name, or replace it with --overwrite '
        '(in Python: overwrite=True)\n'
    )
    for option in ('--overwrite', '--force'):  # its former name
        assert csv_to_bag(*arguments, option, '--namespace', f'/{option[2:]}').returncode == 0
        assert len(read_recording(folder / 'bag', namespace=f'/{option[2:]}').displacement) == 50


def test_a_bag_that_holds_something_else_is_not_replaced(csv_to_bag, folder):
    arguments = ('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag', '--overwrite')
    assert csv_to_bag(*arguments).returncode == 0
    os.replace(folder / 'run.csv', folder / 'bag' / 'run.csv')
    done = csv_to_bag('bag/run.csv', *arguments[1:])
    assert done.stderr == (
        'csv_to_bag: error: bag holds run.csv in addition to a bag and is not overwritten: move run.csv\n'
    )
    assert (folder / 'bag' / 'run.csv').exists()


@pytest.mark.parametrize('closed', ['>&-', '2>&-', '<&- >&- 2>&-'])
def test_streams_that_are_closed_are_no_error(folder, closed):
    """A file would get the number of one, and what is printed with it."""
    begin = 'import sys; from cfd_pneumatic.runtime.start import csv_to_bag; sys.exit(csv_to_bag())'
    arguments = [sys.executable, '-c', begin, 'run.csv', '--mapping', 'mapping.yaml', '--output', 'bag']
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    done = subprocess.run(
        ['sh', '-c', f'exec "$@" {closed}', 'sh', *arguments], cwd=folder, env=environment, check=False
    )
    assert done.returncode == 0
    assert len(read_recording(folder / 'bag').displacement) == 50


def test_a_mapping_for_bags_does_not_do(csv_to_bag, folder):
    (folder / 'mapping.yaml').write_text(
        'displacement: {topic: a, unit: m}\ncylinder_a: {pressure: {topic: b, unit: Pa, reference: gauge}}\n'
    )
    done = csv_to_bag('run.csv', '--mapping', 'mapping.yaml', '--output', 'bag')
    assert done.stderr == (
        'csv_to_bag: error: mapping.yaml maps the topics of a bag. For a table, add the entry `table`\n'
    )


@pytest.mark.parametrize(
    ('error', 'code', 'line'),
    [(InputError('no'), 2, 'name: error: no\n'), (KeyboardInterrupt(), 130, ''), (None, 0, '')],
)
def test_how_a_program_ends(capsys, error, code, line):
    def main(arguments):
        if error:
            raise error

    assert program.run('name', main, []) == code
    assert capsys.readouterr().err == line


def test_an_error_of_ours_is_not_hidden():
    def main(arguments):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        program.run('name', main, [])


def test_a_reader_that_has_gone_is_no_error():
    with subprocess.Popen(
        [sys.executable, '-c', TALK],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b''
    assert process.returncode == 141
