# SPDX-License-Identifier: Apache-2.0
"""Jobs on real workers, some of which die."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import dask
import pytest
from distributed import KilledWorker

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.plant import existing_cluster, local_cluster
from cfd_pneumatic.plant.cluster import results


def work(job):
    """Return a job doubled; 'die' kills the worker, a path does so the first time, 'odd' is an error."""
    if job == 'die':
        os.kill(os.getpid(), signal.SIGKILL)
    if isinstance(job, Path) and not job.exists():
        job.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if job == 'odd':
        raise ZeroDivisionError('by nought')
    return 2 * str(job)


def limit(_):
    return os.environ.get('OMP_NUM_THREADS')


@pytest.fixture(scope='module')
def client():
    # a job is given up after it has killed two workers, not four
    with dask.config.set({'distributed.scheduler.allowed-failures': 1}), local_cluster(2) as one:
        one.run(os.getpid)
        yield one


@pytest.mark.slow
def test_only_the_job_that_kills_every_worker_is_given_up(client):
    jobs = ['die', *range(20)]
    done = dict(results(client, work, jobs))
    assert isinstance(done.pop('die'), KilledWorker)
    assert done == {job: 2 * str(job) for job in range(20)}


@pytest.mark.slow
def test_a_dead_worker_is_waited_for_longer_than_dask_does_and_its_job_done_again(tmp_path):
    def is_kept():
        assert slow.cluster.workers, 'it was given up for good'

    # by Dask's own settings it waits for 15 s
    with dask.config.set({'distributed.deploy.lost-worker-timeout': '0.1s'}), local_cluster(1) as slow:
        slow.run(os.getpid)
        with dask.config.set({'distributed.worker.preload': ['import time; time.sleep(1)\n']}):
            jobs = [tmp_path / 'once', 1]
            assert dict(results(slow, work, jobs, is_kept)) == {job: 2 * str(job) for job in jobs}


def test_an_error_is_the_result_of_its_job_alone(client):
    done = dict(results(client, work, ['odd', 1]))
    assert repr(done['odd']) == "ZeroDivisionError('by nought')"
    assert done[1] == '11'


def test_a_worker_uses_one_thread(client):
    assert dict(results(client, limit, [1])) == {1: '1'}


def test_workers_leave_interrupts_to_the_program(client, tmp_path):
    for pid in client.run(os.getpid).values():
        os.kill(pid, signal.SIGINT)
    assert dict(results(client, work, [1, 2])) == {1: '11', 2: '22'}


def test_two_clusters_on_one_computer_do_not_complain(client, recwarn):
    with local_cluster(1) as other:
        assert dict(results(other, work, [1])) == dict(results(client, work, [1]))
    assert [str(one.message) for one in recwarn if 'already in use' in str(one.message)] == []


def test_no_scheduler_at_the_address(monkeypatch):
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        address = f'tcp://127.0.0.1:{free.getsockname()[1]}'
    monkeypatch.setattr('cfd_pneumatic.plant.cluster._PATIENCE', '1s')
    with pytest.raises(InputError, match='dask scheduler'), existing_cluster(address):
        pass
