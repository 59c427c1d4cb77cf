"""Rests: stretches in which neither the piston nor the set-point moves, and a residual is noise alone."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from cfd_pneumatic.arrays import Array

_SETTLING = 0.15  # after which a pressure is at rest [s]
_SHORTEST_REST = 30  # samples


def runs_at_rest(times: Array, x: Array, setpoint: Array, slack: float, values: Array) -> list[Array]:
    """Return the runs of values while a displacement has stayed within some slack, and a set-point, for a while."""
    period = float(np.median(np.diff(times)))
    window = max(int(_SETTLING / period), 2)
    if window >= times.size:
        return []
    reach = x.max() - x.min()
    spread = maximum_filter1d(x, window, origin=(window - 1) // 2) - minimum_filter1d(
        x, window, origin=(window - 1) // 2
    )
    steps = maximum_filter1d(setpoint, window, origin=(window - 1) // 2) - minimum_filter1d(
        setpoint, window, origin=(window - 1) // 2
    )
    still = (spread <= max(slack, 1e-3 * reach)) & (steps == 0.0)
    runs = np.split(values, np.flatnonzero(np.diff(still.astype(np.int8)) != 0) + 1)
    flags = np.split(still, np.flatnonzero(np.diff(still.astype(np.int8)) != 0) + 1)
    return [run for run, flag in zip(runs, flags) if flag[0] and run.size >= _SHORTEST_REST]
