# SPDX-License-Identifier: Apache-2.0
"""The process in which the loop is closed: it answers, and ends with the process that started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from patience import allowed, wait_until

from cfd_pneumatic.identification import Options
from cfd_pneumatic.monitoring import Worker
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import out_and_back, record

PARENT = """
import os, time
from cfd_pneumatic.monitoring import Worker
if __name__ == '__main__':
    print(Worker().pid, flush=True)
    time.sleep(600.0)
"""


def is_gone(pid: int) -> bool:
    """Return whether a process has ended, perhaps with nobody to take note of it."""
    try:
        with open(f'/proc/{pid}/stat', encoding='ascii') as stat:
            return stat.read().rpartition(')')[2].split()[0] == 'Z'
    except FileNotFoundError:
        return True


def wait_until_gone(pid: int) -> None:
    wait_until(lambda: is_gone(pid))


def test_it_closes_the_loop_and_says_what_it_cannot_close_it_on() -> None:
    worker, options = Worker(), Options()
    try:
        got = record(out_and_back(), seed=1)
        still = record(out_and_back(amplitude=1e-9), seed=1)
        answers = [worker.diagnose(recording_of(one), options) for one in (got, still)]
        failures = [answer.result(allowed()).failure for answer in answers]
        assert failures.count(None) == 1
        assert 'the piston does not move' in str(failures)
    finally:
        worker.end()


def test_one_that_is_ended_answers_that_it_is_gone() -> None:
    worker = Worker()
    answer = worker.diagnose(recording_of(record(out_and_back(), seed=1)), Options(close_loop=True))
    worker.end()
    assert 'the diagnosis ended early' in answer.result(allowed()).failure
    assert worker.pid is not None
    assert is_gone(worker.pid)


def test_it_ends_with_the_process_that_started_it_even_where_that_is_killed(tmp_path) -> None:
    program = tmp_path / 'parent.py'
    program.write_text(PARENT)
    with subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True) as parent:
        pid = int(parent.stdout.readline())
        os.kill(parent.pid, signal.SIGKILL)
    wait_until_gone(pid)
