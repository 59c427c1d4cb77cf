# SPDX-License-Identifier: Apache-2.0
"""The process in which the loop is closed: it answers, and ends with the process that started it."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from patience import allowed, wait_until

from cfd_pneumatic.identification import Options
from cfd_pneumatic.monitoring import Finding, Worker
from cfd_pneumatic.monitoring import worker as worker_module
from cfd_pneumatic.recording import Recording, Signal, recording_of
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


@pytest.fixture
def worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.end()


def kill(worker: Worker) -> None:
    assert worker.pid is not None
    os.kill(worker.pid, signal.SIGKILL)
    wait_until_gone(worker.pid)


@cache
def recording() -> Recording:
    return recording_of(record(out_and_back(), seed=1))


def diagnosed(worker: Worker) -> Finding:
    return worker.diagnose(recording(), Options()).result(allowed())


def test_one_that_is_killed_over_a_diagnosis_is_started_again(worker: Worker) -> None:
    answer = worker.diagnose(recording(), Options(close_loop=True))
    time.sleep(0.3)
    kill(worker)
    finding = answer.result(allowed())
    assert finding.failure == 'the diagnosis ended early: its process was ended by signal 9 (Killed)'
    assert finding.ended_early
    assert diagnosed(worker).failure is None
    assert worker.restarts == 1


def test_one_that_is_killed_while_it_is_sent_to_is_started_again(worker: Worker) -> None:
    assert diagnosed(worker).failure is None
    assert worker.pid is not None
    os.kill(worker.pid, signal.SIGSTOP)
    times = np.arange(1_000_000) * 1e-3
    much = replace(recording(), displacement=Signal(times, times))  # more than a pipe takes
    answer = worker.diagnose(much, Options())
    time.sleep(0.3)
    assert not answer.done()
    kill(worker)
    assert answer.result(allowed()).ended_early
    assert diagnosed(worker).failure is None


def test_one_that_is_killed_again_and_again_is_started_once_in_a_while(
    worker: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert worker.fault is None
    kill(worker)
    worker.restart_if_ended()
    assert worker.is_running
    assert worker.fault == 'the diagnosis process was ended by signal 9 (Killed) and was started again'
    kill(worker)
    worker.restart_if_ended()
    assert not worker.is_running
    finding = worker.diagnose(recording(), Options()).result(5.0)
    assert re.fullmatch(r'the diagnosis process was ended .*: the next start is in \d+ s', str(finding.failure))
    assert finding.ended_early
    monkeypatch.setattr(worker_module, '_RESTART_PAUSE', 0.0)
    assert diagnosed(worker).failure is None
    assert (worker.fault, worker.restarts) == (None, 2)


def test_one_that_cannot_be_started_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    recording()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
    try:
        worker = Worker()
        finding = diagnosed(worker)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    try:
        assert not worker.is_running
        reason = 'the diagnosis process cannot be started (Too many open files): the next start is in '
        assert str(finding.failure).startswith(reason)
        assert finding.ended_early
        monkeypatch.setattr(worker_module, '_RESTART_PAUSE', 0.0)
        worker.restart_if_ended()
        assert worker.is_running
        assert diagnosed(worker).failure is None
    finally:
        worker.end()


def test_it_ends_with_the_process_that_started_it_even_where_that_is_killed(tmp_path) -> None:
    program = tmp_path / 'parent.py'
    program.write_text(PARENT)
    with subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True) as parent:
        pid = int(parent.stdout.readline())
        os.kill(parent.pid, signal.SIGKILL)
    wait_until_gone(pid)
