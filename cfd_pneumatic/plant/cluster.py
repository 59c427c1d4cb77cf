# SPDX-License-Identifier: Apache-2.0
"""Execution of jobs on the workers of a Dask cluster, with retries if a worker dies."""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.plant.certificate import load_tls
from cfd_pneumatic.runtime import WARNED_FOLDER, guard_multiprocessing

Work = TypeVar('Work')
Result = TypeVar('Result')

_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), 1)

_WORKER_TIMEOUT = {'distributed.deploy.lost-worker-timeout': '1h'}
"""Time in which a lost worker may restart. Dask's default, 15 s, is too short on a busy machine."""

_PATIENCE = '10s'  # for the answer of a scheduler
_LOCAL = ('127.', 'localhost', '[::1]')
_BATCH = 500  # jobs that are sent at once
_CHECK_INTERVAL = 5.0  # interval between checks for workers while no result arrives [s]


@contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """Yield the client of a new local cluster; its workers have one thread each and restart if they die."""
    _silence()
    guard_multiprocessing()
    with TemporaryDirectory(prefix='cfd_pneumatic-', ignore_cleanup_errors=True) as scratch:
        # A terminal sends interrupts to the workers, too, which would print tracebacks.
        with dask.config.set(_settings(scratch)), _without_interrupts():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address='127.0.0.1:0',  # any free port: another local cluster may use the default port
                silence_logs=logging.CRITICAL,
            )
        with dask.config.set(_WORKER_TIMEOUT), cluster, Client(cluster) as client:
            yield client


def _settings(scratch: str) -> dict[str, object]:
    """Return the settings of Dask for workers that use a scratch folder."""
    return {
        # Dask's default returns memory after each array, which takes a fifth of a worker's time
        'distributed.nanny.pre-spawn-environ': {**_ONE_THREAD, WARNED_FOLDER: scratch},
        'distributed.worker.profile.enabled': False,
        # workers import modules from this folder; another user may have created Dask's default folder
        'temporary-directory': scratch,
    }


def _silence() -> None:
    """Keep Dask's logs from the terminal: the caller of the client reports the errors."""
    for name in ('distributed', 'distributed.client'):
        logging.getLogger(name).setLevel(logging.CRITICAL)


class _Client(Client):
    """A client that closes if it cannot start; Dask leaves its client to the garbage collector, which may block."""

    def start(self, **options: object) -> None:
        try:
            super().start(**options)
        except BaseException:
            self.close()
            self._loop_runner.stop()
            raise


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block interrupts for all threads and processes that start in this context, and for their children."""
    resource_tracker.ensure_running()  # if it started in the context, it would unblock interrupts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def existing_cluster(address: str, certificate: Path | None = None) -> Iterator[Client]:
    """
    Yield the client of a running cluster.

    Parameters
    ----------
    address
        Address of the scheduler.
    certificate
        Folder of the certificate of the cluster. By default Dask's configuration names the certificate, if any.

    Raises
    ------
    InputError
        If no scheduler answers at the address, or the certificate is invalid.

    """
    _silence()
    security = None if certificate is None else load_tls(certificate)
    try:
        client = _Client(address, timeout=_PATIENCE, security=security)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # Dask raises these; it has no specific exception
        raise InputError(
            f'no Dask scheduler answers at {address}. Start it with `dask scheduler`. Give the address that it prints, '
            'with --certificate if it requires a certificate'
        ) from error
    with client:
        yield client


def is_open(address: str) -> bool:
    """Return whether other computers can reach a scheduler without a certificate."""
    protocol, _, host = address.rpartition('://')
    return protocol != 'tls' and not host.startswith(_LOCAL)


def results(
    client: Client,
    function: Callable[[Work], Result],
    jobs: Sequence[Work],
    no_workers: Callable[[], None] = lambda: None,
) -> Iterator[tuple[Work, Result | Exception]]:
    """
    Yield each job with the function's result or exception, in the order of completion.

    If a worker dies, another worker repeats its jobs. Jobs with several dead workers are repeated alone at the end, to
    find the job that kills its worker.

    Parameters
    ----------
    client
        Client of the cluster.
    function, jobs
        Function to call with each job. Both are sent to the workers.
    no_workers
        Called repeatedly while there are no workers.

    Raises
    ------
    InputError
        If the connection to the scheduler is lost.

    """
    retried = []
    for job, result in _completed_jobs(client, function, jobs, no_workers):
        if isinstance(result, KilledWorker):
            retried.append(job)
        else:
            yield job, result
    for job in retried:
        yield from _completed_jobs(client, function, [job], no_workers)


def _completed_jobs(
    client: Client, function: Callable[[Work], Result], jobs: Sequence[Work], no_workers: Callable[[], None]
) -> Iterator[tuple[Work, Result | Exception]]:
    done: SimpleQueue[Future[Any]] = SimpleQueue()
    waiting = dict(zip(client.map(function, jobs, pure=False, batch_size=_BATCH), jobs))
    for future in waiting:
        future.add_done_callback(done.put)
    while waiting:
        try:
            future = done.get(timeout=_CHECK_INTERVAL)
        except Empty:
            if not client.nthreads():
                no_workers()
            continue
        if future.status == 'lost':  # its worker died; another worker repeats the job
            future.add_done_callback(done.put)
            continue
        if future.cancelled():
            raise InputError('the connection to the Dask scheduler was lost. Run the same command again to continue')
        yield waiting.pop(future), future.exception() or future.result()
