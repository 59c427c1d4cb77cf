# SPDX-License-Identifier: Apache-2.0
"""Jobs done by the workers of a Dask cluster, some of which may die over them."""

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
from cfd_pneumatic.plant.certificate import security_of
from cfd_pneumatic.runtime import WARNED_FOLDER, guard_multiprocessing

Work = TypeVar('Work')
Result = TypeVar('Result')

_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), 1)

_LASTING = {'distributed.deploy.lost-worker-timeout': '1h'}
"""So long a worker may take to begin anew; by default it is given up after 15 s, which a busy machine needs."""

_PATIENCE = '10s'
_LOCAL = ('127.', 'localhost', '[::1]')
_BATCH = 500  # jobs that are sent at once
_LOOK = 5.0  # how often workers are looked for while nothing comes back [s]


@contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """Yield a client of a cluster of our own: processes with one thread each, replaced where they die."""
    _silence()
    guard_multiprocessing()
    with TemporaryDirectory(prefix='cfd_pneumatic-', ignore_cleanup_errors=True) as scratch:
        # A terminal sends interrupts to the workers, too, which would complain of them.
        with dask.config.set(_settings(scratch)), _without_interrupts():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address='127.0.0.1:0',  # any free port: another cluster here may have the usual one
                silence_logs=logging.CRITICAL,
            )
        with dask.config.set(_LASTING), cluster, Client(cluster) as client:
            yield client


def _settings(scratch: str) -> dict[str, object]:
    """Return settings of Dask for workers that use a scratch folder."""
    return {
        # by default memory is given back after each array, which takes a fifth of a worker's time
        'distributed.nanny.pre-spawn-environ': {**_ONE_THREAD, WARNED_FOLDER: scratch},
        'distributed.worker.profile.enabled': False,
        # workers import what is in this folder; the default is one that another user may have made
        'temporary-directory': scratch,
    }


def _silence() -> None:
    """Keep Dask's logs from the terminal: what went wrong is said by whoever uses the client."""
    for name in ('distributed', 'distributed.client'):
        logging.getLogger(name).setLevel(logging.CRITICAL)


class _Client(Client):
    """A client that ends where it can't begin: Dask's own is left to the garbage, whose collector may wait for ever."""

    def start(self, **options: object) -> None:
        try:
            super().start(**options)
        except BaseException:
            self.close()
            self._loop_runner.stop()
            raise


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Keep interrupts from all threads and processes that begin meanwhile, and from theirs."""
    resource_tracker.ensure_running()  # or it begins among them and lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def existing_cluster(address: str, certificate: Path | None = None) -> Iterator[Client]:
    """
    Yield a client of a cluster that runs.

    Parameters
    ----------
    address
        Of its scheduler.
    certificate
        Folder of the certificate by which it knows its clients; by default that of Dask's own configuration, if any.

    Raises
    ------
    InputError
        If no scheduler answers at the address, or the certificate is none.

    """
    _silence()
    security = None if certificate is None else security_of(certificate)
    try:
        client = _Client(address, timeout=_PATIENCE, security=security)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # Dask's, for want of one of its own
        raise InputError(
            f'no Dask scheduler answers at {address}: start one with `dask scheduler` and give the address it prints, '
            'and its certificate where it wants one'
        ) from error
    with client:
        yield client


def is_open(address: str) -> bool:
    """Return whether others than this computer may reach a scheduler, and need no certificate."""
    protocol, _, place = address.rpartition('://')
    return protocol != 'tls' and not place.startswith(_LOCAL)


def results(
    client: Client,
    function: Callable[[Work], Result],
    jobs: Sequence[Work],
    no_workers: Callable[[], None] = lambda: None,
) -> Iterator[tuple[Work, Result | Exception]]:
    """
    Yield each job with what the function returned or raised, in the order in which they end.

    What a worker was doing when it died is done again by another. Jobs that several workers died over are done again
    one by one, so that none is blamed for another's doing.

    Parameters
    ----------
    client
        Of the cluster.
    function, jobs
        What to do, and what with; both are sent to the workers.
    no_workers
        Called now and then while there are no workers: they may come.

    Raises
    ------
    InputError
        If the scheduler is lost.

    """
    suspects = []
    for job, result in _done(client, function, jobs, no_workers):
        if isinstance(result, KilledWorker):
            suspects.append(job)
        else:
            yield job, result
    for suspect in suspects:
        yield from _done(client, function, [suspect], no_workers)


def _done(
    client: Client, function: Callable[[Work], Result], jobs: Sequence[Work], no_workers: Callable[[], None]
) -> Iterator[tuple[Work, Result | Exception]]:
    done: SimpleQueue[Future[Any]] = SimpleQueue()
    waiting = dict(zip(client.map(function, jobs, pure=False, batch_size=_BATCH), jobs))
    for future in waiting:
        future.add_done_callback(done.put)
    while waiting:
        try:
            future = done.get(timeout=_LOOK)
        except Empty:
            if not client.nthreads():
                no_workers()
            continue
        if future.status == 'lost':  # with a worker that had it; it comes again
            future.add_done_callback(done.put)
            continue
        if future.cancelled():
            raise InputError('the Dask scheduler was lost: give the same command again to go on')
        yield waiting.pop(future), future.exception() or future.result()
