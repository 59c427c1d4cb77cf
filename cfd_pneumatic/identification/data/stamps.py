# SPDX-License-Identifier: Apache-2.0
"""Stamps that jitter about a regular clock, and the clock behind them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data.thresholds import (
    CLOCK_WINDOW,
    FEWEST_STAMPS,
    LARGEST_JITTER,
    LARGEST_STEP_CORRELATION,
    STAMP_RESOLUTION,
    STAMPS_TOGETHER,
)


def overlapping(count: int, size: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices that cover an array one after the other, of about some size, and each with a margin around it."""
    edges = np.linspace(0, count, max(1, round(count / size)) + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        yield slice(begin, end), slice(max(begin - margin, 0), min(end + margin, count))


def regular_clock(stamps: Array) -> Array | None:
    """
    Return when samples were taken if their stamps jitter about a regular clock, missed samples allowed, shape (n,) [s].

    None where there is no jitter, or the sampling itself is irregular: then neighbouring steps aren't anticorrelated.
    """
    if stamps.size < FEWEST_STAMPS:
        return None
    taken = []
    for own, window in overlapping(stamps.size, STAMPS_TOGETHER, CLOCK_WINDOW):
        clock = _clock(stamps[window])
        if clock is None:
            return None
        taken.append(clock[own.start - window.start : own.stop - window.start])
    return np.concatenate(taken)


def _clock(stamps: Array) -> Array | None:
    steps = np.diff(stamps)
    period = float(np.median(steps))
    ticks = np.concatenate([[0.0], np.cumsum(np.round(steps / period))])
    if np.any(np.diff(ticks) < 1.0):
        return None
    slope, begin = np.polyfit(ticks, stamps, 1)
    late = stamps - (begin + slope * ticks)
    drift = uniform_filter1d(late, min(CLOCK_WINDOW, stamps.size // 4), mode='nearest')
    jitter = late - drift
    changes = np.diff(jitter)
    power = float(changes @ changes)
    if not STAMP_RESOLUTION < np.std(jitter) <= LARGEST_JITTER * period:
        return None
    if float(changes[1:] @ changes[:-1]) > LARGEST_STEP_CORRELATION * power:
        return None
    clock: Array = stamps - jitter
    return clock if np.all(np.diff(clock) > 0.0) else None
