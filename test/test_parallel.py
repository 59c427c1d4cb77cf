# SPDX-License-Identifier: Apache-2.0
"""Work is shared among as many threads as are allowed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from patience import allowed

from cfd_pneumatic.runtime.parallel import LIMIT, map_in_threads, threads


@pytest.mark.parametrize(('limit', 'count'), [('1', 1), ('3', 3), ('4,2', 4)])
def test_as_many_as_the_environment_allows(monkeypatch, limit, count):
    monkeypatch.setenv(LIMIT, limit)
    assert threads() == count


@pytest.mark.parametrize('limit', ['', '0', '-1', 'many', None])
def test_as_many_as_there_are_cores_where_it_says_nothing(monkeypatch, limit):
    monkeypatch.delenv(LIMIT, raising=False)
    if limit is not None:
        monkeypatch.setenv(LIMIT, limit)
    assert threads() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize('limit', ['1', '3'])
def test_results_come_in_the_order_of_the_items(monkeypatch, limit):
    monkeypatch.setenv(LIMIT, limit)
    meeting = threading.Barrier(int(limit), timeout=allowed(30.0))

    def work(item):
        meeting.wait()  # all of them work at once
        return item, threading.get_ident()

    results = map_in_threads(work, range(3))
    assert [item for item, _ in results] == [0, 1, 2]
    assert len({thread for _, thread in results}) == int(limit)
    assert map_in_threads(work, []) == []


def test_who_has_no_work_left_helps_others(monkeypatch):
    monkeypatch.setenv(LIMIT, '2')
    both_at_work, begun, meeting = threading.Barrier(2, timeout=allowed(30.0)), threading.Event(), threading.Barrier(2)

    def inner(item):
        begun.set()
        meeting.wait(allowed(30.0))  # two work at once
        return item

    def outer(item):
        both_at_work.wait()  # no core is idle when the inner work is shared out
        if item == 0:
            return map_in_threads(inner, range(2))
        assert begun.wait(allowed(30.0))
        return item

    assert map_in_threads(outer, range(2)) == [[0, 1], 1]


def test_an_error_in_the_work_is_raised(monkeypatch):
    monkeypatch.setenv(LIMIT, '2')
    with pytest.raises(ZeroDivisionError):
        map_in_threads(lambda item: 1 / item, [1, 0, 2])


def test_after_an_error_nobody_goes_on(monkeypatch):
    monkeypatch.setenv(LIMIT, '2')
    done = []

    def work(item):
        if item == 1:
            raise ZeroDivisionError
        time.sleep(0.02)
        done.append(item)

    with pytest.raises(ZeroDivisionError):
        map_in_threads(work, range(500))
    assert len(done) < 100


SHARED = """
import time
from cfd_pneumatic.runtime.parallel import map_in_threads

def wait(number):
    print(f'{number}\\n', end='', flush=True)  # in one piece
    time.sleep(0.2)

try:
    map_in_threads(lambda _: map_in_threads(wait, range(1000)), range(2))
except KeyboardInterrupt:
    print('interrupted')
print(map_in_threads(abs, [-1, -2]))
"""


def test_an_interrupt_ends_shared_work_before_its_next_item():
    process = subprocess.Popen(
        [sys.executable, '-c', SHARED], stdout=subprocess.PIPE, text=True, env=os.environ | {LIMIT: '2'}
    )
    assert process.stdout.readline() in ('0\n', '1\n')
    process.send_signal(signal.SIGINT)
    *numbers, interrupted, after = process.communicate()[0].splitlines()
    assert (interrupted, after, process.returncode) == ('interrupted', '[1, 2]', 0)
    assert len(numbers) < 20


ASKED = """
import os, sys
from cfd_pneumatic.commands import identify_bag, plan_experiment, program
assert 'numpy' not in sys.modules
program.run('asked', lambda _: print(os.environ['OPENBLAS_NUM_THREADS']))
"""


@pytest.mark.parametrize(('wanted', 'told'), [(None, '1\n'), ('2', '2\n')])
def test_programs_leave_the_cores_to_their_own_threads_unless_told_otherwise(monkeypatch, wanted, told):
    monkeypatch.delenv('OPENBLAS_NUM_THREADS', raising=False)
    if wanted is not None:
        monkeypatch.setenv('OPENBLAS_NUM_THREADS', wanted)
    assert subprocess.run([sys.executable, '-c', ASKED], capture_output=True, text=True, check=True).stdout == told
