"""Work that is shared among the processor's cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

LIMIT = 'OMP_NUM_THREADS'
"""Environment variable that NumPy's and SciPy's libraries keep to as well; Dask sets it to 1 on its workers."""

Item = TypeVar('Item')
Result = TypeVar('Result')


def threads() -> int:
    """Return how many threads work side by side: what the environment allows, or one for each core that may be used."""
    limit = os.environ.get(LIMIT, '').partition(',')[0]  # further numbers are for nested loops
    if limit.isdecimal() and int(limit):
        return int(limit)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the work's results in the order of its items; compiled functions let other threads run meanwhile."""
    pending = list(items)
    workers = min(threads(), len(pending))
    if workers < 2:
        return [work(item) for item in pending]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, pending))
