# SPDX-License-Identifier: Apache-2.0
"""
How a seal sees the piston travel: reversals that may be noise left out, those between samples put in.

A seal that is stretched forgets it within a few reversals, of noise as of motion: at rest a converter's last bit is
enough.
"""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.thresholds import LEAST_REVERSAL
from cfd_pneumatic.runtime import compiler

_DIFFERENCES = 70.0**0.5  # standard deviation of fourth differences of white noise of unit variance
_MEDIAN_OF_NORMAL = 0.6745  # of its absolute value


def reversals(motion: Motion) -> Array:
    """Return when the piston turns round between samples, where the motion is known there [s]."""
    if not _is_smooth(motion):
        return np.empty(0)
    before, after = motion.rate[:-1], motion.rate[1:]
    turns = np.flatnonzero(before * after < 0.0)
    share = before[turns] / (before[turns] - after[turns])
    return motion.times[turns] + share * np.diff(motion.times)[turns]


def travelled(motion: Motion, measured: Array, times: Array) -> Array:
    """
    Return the displacement that seals follow, shape (n,) [m].

    Between the samples of sudden strokes it is straight: a curve would overshoot where the piston stops.

    Parameters
    ----------
    motion
        The smoothed displacement.
    measured
        The displacement as measured, at the samples [m].
    times
        Within the recording, increasing, shape (n,) [s].

    """
    smooth = _is_smooth(motion)
    path = motion.at(times) if smooth else np.interp(times, motion.times, motion.displacement)
    slack = _wiggle(motion.displacement)
    followed: Array = _followed(path, slack if smooth else max(slack, _resolution(measured)))
    return followed


def _is_smooth(motion: Motion) -> bool:
    """Return whether the motion is known between samples, as it isn't in a stroke of a few."""
    return motion.order > 2


def _wiggle(displacement: Array) -> float:
    """Return how far noise moves a smoothed displacement from sample to sample [m]."""
    return LEAST_REVERSAL / _DIFFERENCES / _MEDIAN_OF_NORMAL * float(np.median(np.abs(np.diff(displacement, 4))))


def _resolution(measured: Array) -> float:
    """Return the smallest step of a sensor [m]; 0 where it never moved."""
    steps = np.abs(np.diff(measured))
    return float(np.min(steps[steps > 0.0])) if np.any(steps) else 0.0


@compiler()
def _followed(path: Array, slack: float) -> Array:
    """Return what follows a path with play, half of it `slack`."""
    followed = np.empty_like(path)
    held = path[0]
    for i in range(path.size):
        held = min(max(held, path[i] - slack), path[i] + slack)
        followed[i] = held
    return followed
