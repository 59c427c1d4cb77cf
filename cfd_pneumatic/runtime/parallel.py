# SPDX-License-Identifier: Apache-2.0
"""Share work among the processor's cores."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import length_hint
from threading import Event, Lock, Thread, local
from typing import Any, TypeVar

LIMIT = 'OMP_NUM_THREADS'
"""Environment variable for the number of threads, also of NumPy and SciPy; Dask sets it to 1 on its workers."""

Item = TypeVar('Item')
Result = TypeVar('Result')

_POLL_INTERVAL = 0.2  # between checks for an interrupt, which an endless wait would delay until its end [s]


def threads() -> int:
    """Return the number of parallel threads: the limit of the environment, or the number of usable cores."""
    limit = os.environ.get(LIMIT, '').partition(',')[0]  # further numbers apply to nested loops
    if limit.isdecimal() and int(limit):
        return int(limit)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


class _ThreadCount:
    """Count of the threads that are at work."""

    def __init__(self) -> None:
        self._size = 1
        self._lock = Lock()

    @property
    def idle(self) -> int:
        """Number of idle cores."""
        return max(threads() - self._size, 0)

    @contextmanager
    def with_more(self, number: int) -> Iterator[None]:
        """Add a number to the count within the context."""
        with self._lock:
            self._size += number
        try:
            yield
        finally:
            with self._lock:
                self._size -= number


_thread_count = _ThreadCount()
_thread_local = local()  # `stop`: the event that ends the job on which this thread works


class _Job:
    """Items that several threads process."""

    def __init__(self, work: Callable[[Any], Any], items: Sequence[Any]) -> None:
        self.pending = iter(range(len(items)))
        self.results: dict[int, Any] = {}
        self._work = work
        self._items = items
        self._stop: Event = getattr(_thread_local, 'stop', None) or Event()
        self._error: BaseException | None = None
        self._workers = 0
        self._lock = Lock()
        self._ended = Event()

    def process_items(self) -> None:
        """Process pending items until none remain; an error in any thread ends the job."""
        outer, _thread_local.stop = getattr(_thread_local, 'stop', None), self._stop
        self._add_workers(1)
        try:
            for index in self.pending:
                if self._stop.is_set():
                    raise KeyboardInterrupt
                self.results[index] = self._work(self._items[index])
        except BaseException as error:  # `wait` raises the error
            deque(self.pending, maxlen=0)
            self._error = error
        finally:
            _thread_local.stop = outer
            self._add_workers(-1)

    def _add_workers(self, number: int) -> None:
        with self._lock:
            self._workers += number
            if not self._workers:
                self._ended.set()

    def wait(self) -> None:
        """Wait for all threads of the job, and raise an error that a thread met."""
        while not self._ended.wait(_POLL_INTERVAL):
            pass
        if self._error is not None:
            raise self._error

    def end(self) -> None:
        """Stop the job, and wait for the items that are in progress."""
        self._stop.set()
        self._add_workers(0)  # ends a job without workers
        self._ended.wait()


_jobs: list[_Job] = []  # unfinished jobs, the innermost last


def _process_jobs(job: _Job | None) -> None:
    """Process the items of a job, and then those of other unfinished jobs."""
    with _thread_count.with_more(1):
        while job is not None:
            job.process_items()
            job = next((candidate for candidate in reversed(_jobs) if length_hint(candidate.pending)), None)


def map_in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """
    Apply a function to items in parallel threads; return the results in the order of the items.

    Compiled functions run truly in parallel. The function may call `map_in_threads` itself. An interrupt reaches only
    the main thread; the other threads end before their next item.
    """
    job = _Job(work, work_items := list(items))
    helpers = min(len(work_items), _thread_count.idle + 1)
    _jobs.append(job)
    try:
        if helpers < 2:
            job.process_items()
            job.wait()
        else:
            with _thread_count.with_more(-1):  # this thread only waits
                for _ in range(helpers):
                    Thread(target=_process_jobs, args=(job,)).start()
                job.wait()
    except KeyboardInterrupt:
        job.end()
        raise
    finally:
        _jobs.remove(job)
    return [job.results[index] for index in range(len(work_items))]
