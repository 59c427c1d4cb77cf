"""How many threads a search may use."""

from __future__ import annotations

import os

LIMIT = 'OMP_NUM_THREADS'
"""Environment variable that NumPy's and SciPy's libraries keep to as well; Dask sets it to 1 on its workers."""


def threads() -> int:
    """Return the number of threads that the environment allows; where it says nothing, that of the cores."""
    limit = os.environ.get(LIMIT, '').partition(',')[0]  # further numbers are for nested loops
    return int(limit) if limit.isdecimal() and int(limit) else os.cpu_count() or 1
