# SPDX-License-Identifier: Apache-2.0
"""Find rests: periods without motion of piston or set-point, in which a residual is noise alone."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.thresholds import (
    FEWEST_REST_SAMPLES,
    LARGEST_REST_MOTION,
    REST_SETTLING_TIME,
)


def runs_at_rest(times: Array, x: Array, setpoint: Array, slack: float, values: Array) -> list[Array]:
    """Return the runs of values while the displacement stays within `slack` [m] and the set-point is constant."""
    period = float(np.median(np.diff(times)))
    window = max(int(REST_SETTLING_TIME / period), 2)
    if window >= times.size:
        return []

    def span(series: Array) -> Array:
        """Return the range of the series in a window that ends at each sample."""
        most = maximum_filter1d(series, window, origin=(window - 1) // 2)
        return np.asarray(most - minimum_filter1d(series, window, origin=(window - 1) // 2))

    is_at_rest = (span(x) <= max(slack, LARGEST_REST_MOTION * float(np.ptp(x)))) & (span(setpoint) == 0.0)
    cuts = np.flatnonzero(np.diff(is_at_rest)) + 1
    runs = zip(np.split(values, cuts), np.split(is_at_rest, cuts))
    return [run for run, flags in runs if flags[0] and run.size >= FEWEST_REST_SAMPLES]
