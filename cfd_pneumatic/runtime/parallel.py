# SPDX-License-Identifier: Apache-2.0
"""Work that is shared among the processor's cores."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import length_hint
from threading import Event, Lock, Thread, local
from typing import Any, TypeVar

LIMIT = 'OMP_NUM_THREADS'
"""Environment variable that NumPy's and SciPy's libraries keep to as well; Dask sets it to 1 on its workers."""

Item = TypeVar('Item')
Result = TypeVar('Result')

_GLANCE = 0.2  # between looks for an interrupt: one just before a wait without end is not seen until it ends [s]


def threads() -> int:
    """Return how many threads work side by side: what the environment allows, or one for each core that may be used."""
    limit = os.environ.get(LIMIT, '').partition(',')[0]  # further numbers are for nested loops
    if limit.isdecimal() and int(limit):
        return int(limit)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


class _Crew:
    """The threads that are at work."""

    def __init__(self) -> None:
        self._size = 1
        self._lock = Lock()

    @property
    def idle(self) -> int:
        """How many cores have nothing to do."""
        return max(threads() - self._size, 0)

    @contextmanager
    def with_more(self, number: int) -> Iterator[None]:
        """Count so many more threads meanwhile."""
        with self._lock:
            self._size += number
        try:
            yield
        finally:
            with self._lock:
                self._size -= number


_crew = _Crew()
_here = local()  # `stop`: the event that ends the work that this thread has a share in


class _Job:
    """Items that are worked on by whoever has nothing else to do."""

    def __init__(self, work: Callable[[Any], Any], items: Sequence[Any]) -> None:
        self.left = iter(range(len(items)))  # that nobody has begun
        self.results: dict[int, Any] = {}
        self._work = work
        self._items = items
        self._stop: Event = getattr(_here, 'stop', None) or Event()
        self._error: BaseException | None = None
        self._hands = 0
        self._lock = Lock()
        self._ended = Event()

    def share(self) -> None:
        """Work on one item after another until none is left; after an error nobody goes on."""
        before, _here.stop = getattr(_here, 'stop', None), self._stop
        self._count(1)
        try:
            for place in self.left:
                if self._stop.is_set():
                    raise KeyboardInterrupt
                self.results[place] = self._work(self._items[place])
        except BaseException as error:  # raised where the job is waited for
            deque(self.left, maxlen=0)
            self._error = error
        finally:
            _here.stop = before
            self._count(-1)

    def _count(self, by: int) -> None:
        with self._lock:
            self._hands += by
            if not self._hands:
                self._ended.set()

    def wait(self) -> None:
        """Wait for all who work on it, and raise what one of them met with."""
        while not self._ended.wait(_GLANCE):
            pass
        if self._error is not None:
            raise self._error

    def end(self) -> None:
        """Wait for the items that somebody has begun; nobody begins another one."""
        self._stop.set()
        self._count(0)  # there may be none
        self._ended.wait()


_jobs: list[_Job] = []  # that are not done, the innermost last


def _help(job: _Job | None) -> None:
    """Work on a job, and then on what others have left to do."""
    with _crew.with_more(1):
        while job is not None:
            job.share()
            job = next((one for one in reversed(_jobs) if length_hint(one.left)), None)


def map_in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """
    Return the work's results in the order of its items; compiled functions let other threads run meanwhile.

    Work may share out its own, to cores that are idle or will be. An interrupt comes to the main thread alone: the
    others end before their next item.
    """
    job = _Job(work, pending := list(items))
    helpers = min(len(pending), _crew.idle + 1)
    _jobs.append(job)
    try:
        if helpers < 2:
            job.share()
            job.wait()
        else:
            with _crew.with_more(-1):  # this thread only waits
                for _ in range(helpers):
                    Thread(target=_help, args=(job,)).start()
                job.wait()
    except KeyboardInterrupt:
        job.end()
        raise
    finally:
        _jobs.remove(job)
    return [job.results[place] for place in range(len(pending))]
