"""Work that is shared among the processor's cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

THREADS = 'CFD_PNEUMATIC_THREADS'
"""Environment variable: how many threads work side by side; by default one for each core that may be used."""

Item = TypeVar('Item')
Result = TypeVar('Result')


def threads() -> int:
    """Return how many threads work side by side."""
    wanted = os.environ.get(THREADS, '')
    if wanted.isdigit():
        return max(1, int(wanted))
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the work's results in the order of its items; compiled functions let other threads run meanwhile."""
    pending = list(items)
    workers = min(threads(), len(pending))
    if workers < 2:
        return [work(item) for item in pending]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, pending))
