"""Work that is shared among the processor's cores."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import contextmanager
from threading import Event, Lock, local
from typing import TypeVar

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
        self._change(number)
        try:
            yield
        finally:
            self._change(-number)

    def _change(self, by: int) -> None:
        with self._lock:
            self._size += by


_crew = _Crew()
_here = local()  # `stop`: the event that ends the work that this thread has a share in


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """
    Return the work's results in the order of its items; compiled functions let other threads run meanwhile.

    Work may share out its own, to cores that are idle by then. An interrupt comes to the main thread alone: the others
    end before their next item.
    """
    pending = list(items)
    results: dict[int, Result] = {}
    left = iter(range(len(pending)))
    stop: Event = getattr(_here, 'stop', None) or Event()

    def share() -> None:
        for place in left:
            if stop.is_set():
                raise KeyboardInterrupt
            results[place] = work(pending[place])

    def help_out() -> None:
        _here.stop = stop
        with _crew.with_more(1):
            share()

    helpers = min(len(pending), _crew.idle + 1)
    if helpers < 2:
        share()
        return list(results.values())
    with _crew.with_more(-1), ThreadPoolExecutor(helpers) as pool:  # this thread only waits
        try:
            shares = [pool.submit(help_out) for _ in range(helpers)]
            while (waited := wait(shares, _GLANCE, FIRST_EXCEPTION)).not_done:
                if any(one.exception() for one in waited.done):
                    break
            deque(left, maxlen=0)  # after an error nobody goes on
            for one in shares:
                one.result()
        except KeyboardInterrupt:
            stop.set()
            raise
    return [results[place] for place in range(len(pending))]
