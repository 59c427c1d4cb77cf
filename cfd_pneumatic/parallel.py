"""Work that is shared among the processor's cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Event, current_thread, main_thread
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


_interrupted = Event()


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """
    Return the work's results in the order of its items; compiled functions let other threads run meanwhile.

    Work may share out its own. An interrupt comes to the main thread alone: the others end before their next item.
    """
    pending = list(items)
    workers = min(threads(), len(pending))

    def unless_interrupted(item: Item) -> Result:
        if _interrupted.is_set():
            raise KeyboardInterrupt
        return work(item)

    if workers < 2:
        return list(map(unless_interrupted, pending))
    try:
        with ThreadPoolExecutor(workers) as pool:
            futures: list[Future[Result]] = []
            try:
                futures += [pool.submit(unless_interrupted, item) for item in pending]
                return [_result_of(future) for future in futures]
            except KeyboardInterrupt:
                _interrupted.set()
                raise
            finally:
                for future in futures:
                    future.cancel()
    finally:
        if current_thread() is main_thread():
            _interrupted.clear()


def _result_of(future: Future[Result]) -> Result:
    while not future.done():
        wait([future], _GLANCE)
    return future.result()
