# SPDX-License-Identifier: Apache-2.0
"""Results take their place whole, what was left aside goes, and two runs don't mix."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cfd_pneumatic.device import Device
from cfd_pneumatic.device.file import run_line
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import staging as files
from cfd_pneumatic.files.staging import check_folder, exclusive_access, staged_output, write_text
from cfd_pneumatic.recording import BagWriter
from studies.trials.crashes import SCENARIOS, calls_of, try_scenario

TABLE_1 = Path(__file__).parents[1] / 'config' / 'table_1.yaml'

HOLDS = """
import sys, time
from pathlib import Path
from cfd_pneumatic.files.staging import staged_output
with staged_output(Path(sys.argv[1])) as made:
    made.mkdir()
    print('made', flush=True)
    time.sleep(60)
"""


def names(folder):
    return sorted(os.listdir(folder))


@pytest.fixture
def holder(tmp_path):
    """Start somebody who is making a folder staging."""
    with subprocess.Popen([sys.executable, '-c', HOLDS, str(tmp_path / 'made')], stdout=subprocess.PIPE) as running:
        running.stdout.readline()
        yield running
        running.kill()


def test_a_folder_takes_the_place_of_another_whole(tmp_path):
    (tmp_path / 'made').mkdir()
    (tmp_path / 'made' / 'old').touch()
    with staged_output(tmp_path / 'made', is_any) as made:
        made.mkdir()
        (made / 'new').touch()
        assert names(tmp_path / 'made') == ['old']
    assert names(tmp_path / 'made') == ['new']
    assert names(tmp_path) == ['made']


def is_any(_):
    return True


def place_three_files(folder):
    """Let the files `a`, `b` and `old` take their places, `a` last, and return which were moved one by one."""
    (folder / 'old').write_text('old')
    moves, replace = [], os.replace
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, 'replace', lambda one, other: (moves.append(one.name), replace(one, other)))
        with staged_output(folder, is_any, ['old', 'b', 'a'].index) as made:
            made.mkdir()
            for name in ('a', 'b', 'old'):
                (made / name).write_text('new')
    assert [(folder / name).read_text() for name in ('a', 'b', 'old')] == ['new'] * 3
    return moves


def test_a_folder_is_exchanged_in_one_step(tmp_path):
    (tmp_path / 'made').mkdir()
    before = (tmp_path / 'made').stat().st_ino
    assert place_three_files(tmp_path / 'made') == []
    assert (tmp_path / 'made').stat().st_ino != before
    assert names(tmp_path) == ['made']


@pytest.mark.parametrize('why', ['no exchange', 'another mode', 'something else in it', 'the working folder'])
def test_files_take_their_places_one_by_one_in_a_folder_that_is_not_exchanged(tmp_path, monkeypatch, why):
    folder = tmp_path / 'made'
    folder.mkdir()
    if why == 'no exchange':
        monkeypatch.setattr(files, '_exchange', lambda *_: False)
    elif why == 'another mode':
        folder.chmod(0o711)
    elif why == 'something else in it':
        (folder / 'mine').mkdir()
        monkeypatch.setattr(sys.modules[__name__], 'is_any', Path.is_file)
    else:
        monkeypatch.chdir(folder)
    before = folder.stat()
    assert place_three_files(folder) == ['old', 'b', 'a']
    assert (folder.stat().st_ino, folder.stat().st_mode) == (before.st_ino, before.st_mode)
    assert set(names(folder)) - {'mine'} == {'a', 'b', 'old'}
    assert names(tmp_path) == ['made']


@pytest.mark.parametrize('way', ['out', 'new/out', 'new/../new/deep/out', '.', 'there', 'link', 'there/../out'])
def test_a_folder_that_can_be_written_is_left_as_it_was(tmp_path, monkeypatch, way):
    (tmp_path / 'there').mkdir()
    (tmp_path / 'link').symlink_to('there')
    monkeypatch.chdir(tmp_path)
    check_folder(Path(way))
    assert sorted(path.name for path in tmp_path.rglob('*')) == ['link', 'there']


@pytest.mark.parametrize(
    ('way', 'message'),
    [
        ('file', 'Not a directory'),
        ('file/out', 'Not a directory'),
        ('pipe', 'Not a directory'),
        ('nowhere', 'No such file'),
        ('loop', 'Too many levels of symbolic links'),
        ('loop/out', 'Too many levels of symbolic links'),
        ('o' * 256, 'File name too long'),
        ('o' * 250, 'File name too long'),  # there is no room for the name of an aside
        (f'new/{"o" * 256}', 'File name too long'),
        ('/dev/null', 'Not a directory'),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused(tmp_path, monkeypatch, way, message):
    (tmp_path / 'file').touch()
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'nowhere').symlink_to('gone')
    (tmp_path / 'loop').symlink_to('loop')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f'^cannot write {re.escape(way)}: {message}'):
        check_folder(Path(way))
    assert names(tmp_path) == ['file', 'loop', 'nowhere', 'pipe']


def test_a_file_does_not_take_the_place_of_a_folder(tmp_path):
    (tmp_path / 'made').mkdir()
    (tmp_path / 'made' / 'mine').touch()
    with pytest.raises(InputError, match='cannot write'):
        write_text(tmp_path / 'made', 'text')
    assert names(tmp_path / 'made') == ['mine']


def test_after_an_error_what_was_there_stays(tmp_path):
    write_text(tmp_path / 'made', 'old')

    def write_half():
        with staged_output(tmp_path / 'made') as made:
            made.write_text('half')
            raise OSError(28, 'No space left on device')

    with pytest.raises(InputError, match='No space left on device; make room'):
        write_half()
    assert (tmp_path / 'made').read_text() == 'old'
    assert names(tmp_path) == ['made']


def test_what_a_killed_run_left_is_taken_away_by_the_next(tmp_path, holder):
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert [name[:6] for name in names(tmp_path)] == ['.made~']
    write_text(tmp_path / 'other', 'leaves it')
    assert len(names(tmp_path)) == 2
    write_text(tmp_path / 'made', 'new')
    assert names(tmp_path) == ['made', 'other']


def test_what_somebody_is_making_stays(tmp_path, holder):
    assert holder.poll() is None
    write_text(tmp_path / 'made', 'new')
    assert [name[:6] for name in names(tmp_path)] == ['.made~', 'made']


def test_names_with_wildcards_take_away_their_own_only(tmp_path):
    (tmp_path / '.ab~left0000').mkdir()
    write_text(tmp_path / '[a-z]b', 'x')
    write_text(tmp_path / '*', 'x')
    assert '.ab~left0000' in names(tmp_path)


@pytest.mark.parametrize('name', ['.made~', '.made~old', '.made~2026-11-28', '.other~12345678'])
def test_a_folder_that_is_called_otherwise_is_not_taken_for_one_that_was_left(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / 'mine').touch()
    os.mkfifo(tmp_path / '.made~12345678')
    write_text(tmp_path / 'made', 'new')
    assert set(names(tmp_path)) == {name, '.made~12345678', 'made'}
    assert names(tmp_path / name) == ['mine']


def test_two_runs_into_one_folder_are_one_too_many(tmp_path):
    with (
        exclusive_access(tmp_path),
        pytest.raises(InputError, match='is being written by another run'),
        exclusive_access(tmp_path),
    ):
        pass
    with exclusive_access(tmp_path):
        pass


def test_a_bag_is_not_written_through_a_link(tmp_path):
    (tmp_path / 'elsewhere').mkdir()
    (tmp_path / 'bag').symlink_to(tmp_path / 'elsewhere')
    with pytest.raises(InputError, match='is a symbolic link'):
        BagWriter(tmp_path / 'bag', overwrite=True)


@pytest.mark.parametrize('other', ['b', 'a', None])
def test_parameters_and_the_report_of_another_run_are_refused(tmp_path, other):
    write_text(tmp_path / 'parameters.yaml', f'{run_line("a")}\n{TABLE_1.read_text()}')
    if other:
        write_text(tmp_path / 'report.json', f'{{"run": "{other}"}}')
    if other == 'b':
        with pytest.raises(InputError, match='are of different runs of identify_bag: identify again'):
            Device.load(tmp_path / 'parameters.yaml')
    else:
        Device.load(tmp_path / 'parameters.yaml')


@pytest.mark.slow
@pytest.mark.skipif(shutil.which('strace') is None, reason='strace is not to be had here')
@pytest.mark.parametrize('where', ['over a bag', 'in a folder that cannot be exchanged'])
def test_killed_anywhere_or_without_room_a_program_leaves_the_old_or_the_new(tmp_path, where):
    """`make crash` tries all."""
    (scenario,) = (one for one in SCENARIOS if one.name == f'csv_to_bag --overwrite {where}')
    scenario.prepare(tmp_path)
    calls = random.Random(17).sample(calls_of(scenario, tmp_path), 3)
    outcome = try_scenario(scenario, calls, sizes=[1000])
    assert outcome.faults == []
    assert outcome.kills == 3


def test_a_program_that_is_interrupted_while_it_writes_leaves_nothing(tmp_path, holder):
    time.sleep(0.1)
    holder.send_signal(signal.SIGINT)
    holder.wait()
    assert names(tmp_path) == []
