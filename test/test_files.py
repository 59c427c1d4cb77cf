# SPDX-License-Identifier: Apache-2.0
"""Results take their place whole, what was left aside goes, and two runs don't mix."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cfd_pneumatic import files
from cfd_pneumatic.device import Device
from cfd_pneumatic.device.file import run_line
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import alone_in, made_aside, write_text
from cfd_pneumatic.recording import BagWriter
from studies.crashes import SCENARIOS, calls_of, tried

TABLE_1 = Path(__file__).parents[1] / 'config' / 'table_1.yaml'

HOLDS = """
import sys, time
from pathlib import Path
from cfd_pneumatic.files import made_aside
with made_aside(Path(sys.argv[1])) as made:
    made.mkdir()
    print('made', flush=True)
    time.sleep(60)
"""


def names(folder):
    return sorted(os.listdir(folder))


@pytest.fixture
def holder(tmp_path):
    """Start somebody who is making a folder aside."""
    with subprocess.Popen([sys.executable, '-c', HOLDS, str(tmp_path / 'made')], stdout=subprocess.PIPE) as running:
        running.stdout.readline()
        yield running
        running.kill()


def test_a_folder_takes_the_place_of_another_whole(tmp_path):
    (tmp_path / 'made').mkdir()
    (tmp_path / 'made' / 'old').touch()
    with made_aside(tmp_path / 'made') as made:
        made.mkdir()
        (made / 'new').touch()
        assert names(tmp_path / 'made') == ['old']
    assert names(tmp_path / 'made') == ['new']
    assert names(tmp_path) == ['made']


@pytest.mark.parametrize('can_exchange', [True, False])
def test_there_is_never_nothing_where_folders_can_be_exchanged(tmp_path, monkeypatch, can_exchange):
    if not can_exchange:
        monkeypatch.setattr(files, '_exchanged', lambda *_: False)
    (tmp_path / 'made').mkdir()
    moves = []
    replace = os.replace
    monkeypatch.setattr(os, 'replace', lambda one, other: (moves.append(one), replace(one, other)))
    with made_aside(tmp_path / 'made') as made:
        made.mkdir()
    assert len(moves) == (0 if can_exchange else 2)
    assert names(tmp_path) == ['made']


def test_after_an_error_what_was_there_stays(tmp_path):
    write_text(tmp_path / 'made', 'old')

    def write_half():
        with made_aside(tmp_path / 'made') as made:
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
    (tmp_path / '.ab~left').mkdir()
    write_text(tmp_path / '[a-z]b', 'x')
    write_text(tmp_path / '*', 'x')
    assert '.ab~left' in names(tmp_path)


def test_two_runs_into_one_folder_are_one_too_many(tmp_path):
    with alone_in(tmp_path), pytest.raises(InputError, match='is being written by another run'), alone_in(tmp_path):
        pass
    with alone_in(tmp_path):
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
def test_killed_anywhere_or_without_room_a_program_leaves_the_old_or_the_new(tmp_path):
    """`make crash` tries all."""
    (scenario,) = (one for one in SCENARIOS if one.name == 'csv_to_bag --force over a bag')
    scenario.prepare(tmp_path)
    calls = random.Random(17).sample(calls_of(scenario, tmp_path), 3)
    outcome = tried(scenario, calls, sizes=[1000])
    assert outcome.faults == []
    assert outcome.kills == 3


def test_a_program_that_is_interrupted_while_it_writes_leaves_nothing(tmp_path, holder):
    time.sleep(0.1)
    holder.send_signal(signal.SIGINT)
    holder.wait()
    assert names(tmp_path) == []
