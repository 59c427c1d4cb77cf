# SPDX-License-Identifier: Apache-2.0
"""
The displacement that seals follow: without reversals that may be noise, with reversals between samples.

A seal loses its stretch within a few reversals, real or not. At rest the last bit of a converter suffices.
"""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.thresholds import LEAST_REVERSAL
from cfd_pneumatic.runtime import compiler

_DIFFERENCES = 70.0**0.5  # standard deviation of fourth differences of white noise of unit variance
_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal variable


def reversals(motion: Motion) -> Array:
    """Return the times between samples at which the piston reverses [s]; empty if the motion there is not known."""
    if not _is_smooth(motion):
        return np.empty(0)
    rate_before, rate_after = motion.rate[:-1], motion.rate[1:]
    steps = np.flatnonzero(rate_before * rate_after < 0.0)
    share = rate_before[steps] / (rate_before[steps] - rate_after[steps])
    return motion.times[steps] + share * np.diff(motion.times)[steps]


def seal_displacement(motion: Motion, measured: Array, times: Array) -> Array:
    """
    Return the displacement that seals follow, shape (n,) [m].

    The displacement is straight between the samples of sudden strokes: a curve would overshoot where the piston stops.

    Parameters
    ----------
    motion
        The smoothed displacement.
    measured
        Measured displacement at the samples [m].
    times
        Increasing times within the recording, shape (n,) [s].

    """
    smooth = _is_smooth(motion)
    path = motion.displacement_at(times) if smooth else np.interp(times, motion.times, motion.displacement)
    backlash = _largest_noise_reversal(motion.displacement)
    followed: Array = _with_backlash(path, backlash if smooth else max(backlash, _resolution(measured)))
    return followed


def _is_smooth(motion: Motion) -> bool:
    """Return whether the motion is known between samples, unlike in strokes of few samples."""
    return motion.order > 2


def _largest_noise_reversal(displacement: Array) -> float:
    """Return the largest reversal of a smoothed displacement that may be noise [m]."""
    return LEAST_REVERSAL / _DIFFERENCES / _MEDIAN_OF_NORMAL * float(np.median(np.abs(np.diff(displacement, 4))))


def _resolution(measured: Array) -> float:
    """Return the smallest step of a sensor [m]; 0 if the reading never changes."""
    steps = np.abs(np.diff(measured))
    return float(np.min(steps[steps > 0.0])) if np.any(steps) else 0.0


@compiler()
def _with_backlash(path: Array, backlash: float) -> Array:
    """Follow a path with a backlash of `backlash` to either side, shape (n,) [m]."""
    followed = np.empty_like(path)
    position = path[0]
    for i in range(path.size):
        position = min(max(position, path[i] - backlash), path[i] + backlash)
        followed[i] = position
    return followed
