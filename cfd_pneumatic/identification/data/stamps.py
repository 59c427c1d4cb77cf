# SPDX-License-Identifier: Apache-2.0
"""Estimate the regular clock about which stamps jitter."""

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


def overlapping_windows(count: int, size: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Yield consecutive slices of about a size that cover an array, each with the slice that adds a margin around."""
    edges = np.linspace(0, count, max(1, round(count / size)) + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        yield slice(begin, end), slice(max(begin - margin, 0), min(end + margin, count))


def regular_clock(stamps: Array) -> Array | None:
    """
    Return the times of the regular clock about which the stamps jitter, shape (n,) [s]; None if there is none.

    Samples may be missing. None if there is no jitter, or if the sampling is irregular: steps between the stamps of
    irregular samples are not anticorrelated.
    """
    if stamps.size < FEWEST_STAMPS:
        return None
    pieces = []
    for inner, window in overlapping_windows(stamps.size, STAMPS_TOGETHER, CLOCK_WINDOW):
        clock = _clock(stamps[window])
        if clock is None:
            return None
        pieces.append(clock[inner.start - window.start : inner.stop - window.start])
    return np.concatenate(pieces)


def _clock(stamps: Array) -> Array | None:
    steps = np.diff(stamps)
    period = float(np.median(steps))
    ticks = np.concatenate([[0.0], np.cumsum(np.round(steps / period))])
    if np.any(np.diff(ticks) < 1.0):
        return None
    slope, offset = np.polyfit(ticks, stamps, 1)
    delays = stamps - (offset + slope * ticks)
    drift = uniform_filter1d(delays, min(CLOCK_WINDOW, stamps.size // 4), mode='nearest')
    jitter = delays - drift
    changes = np.diff(jitter)
    power = float(changes @ changes)
    if not STAMP_RESOLUTION < np.std(jitter) <= LARGEST_JITTER * period:
        return None
    if float(changes[1:] @ changes[:-1]) > LARGEST_STEP_CORRELATION * power:
        return None
    clock: Array = stamps - jitter
    return clock if np.all(np.diff(clock) > 0.0) else None
