# SPDX-License-Identifier: Apache-2.0
"""Jobs on real workers, some of which die."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
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


IN_A_FOLDER = """
import os, sys
from cfd_pneumatic.plant import local_cluster
from cfd_pneumatic.plant.cluster import results

if __name__ == '__main__':
    with local_cluster(1) as client:
        print(dict(results(client, str, [1])))
        print(*{path for paths in client.run(eval, 'sys.path', {'sys': sys}).values() for path in paths}, sep='\\n')
"""


def test_workers_import_nothing_from_the_working_folder_or_from_one_that_others_may_have_made(tmp_path):
    program = tmp_path / 'program.py'
    program.write_text(IN_A_FOLDER)
    working, shared = tmp_path / 'working', tmp_path / 'shared'
    for folder in (working, shared / 'dask-scratch-space'):
        folder.mkdir(parents=True)
        for name in {*sys.stdlib_module_names, 'numpy', 'dask', 'distributed', 'tornado', 'sitecustomize'}:
            (folder / f'{name}.py').write_text(f'open({str(tmp_path / "seen")!r}, "a").write("{name} ")\n')
    environment = os.environ | {'TMPDIR': str(shared), 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
    run = subprocess.run(
        [sys.executable, program], cwd=working, env=environment, capture_output=True, text=True, check=True
    )
    result, *paths = run.stdout.splitlines()
    assert result == "{1: '1'}"
    assert not {str(working), str(shared / 'dask-scratch-space')} & set(paths)
    assert not (tmp_path / 'seen').exists()
    assert os.listdir(shared) == ['dask-scratch-space'], 'nothing is left'


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
