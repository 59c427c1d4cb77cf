# SPDX-License-Identifier: Apache-2.0
"""Find samples within the usual range that were not measured: short leaps out and back, and runs of an error code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.messages import NANOSECONDS

_SUDDEN = 20.0  # times the 75 % quantile of the changes between samples
_SHARE_OF_RANGE = 0.25  # smallest leap, as a share of the usual range
_MOST_LEAPS = 0.4  # share of the samples; a signal with more leaps is not judged
_SPIKE = 2  # longest spike with different values [samples]
_QUICK = 0.011  # longest time from the sample before to the sample after a spike: a piston needs longer [s]
_CALM = 0.5  # largest change next to a code, as a share of the leap: a motion takes several samples
_CODE = 3  # shortest run of exactly one value between two leaps [samples]
_SAME_CODE = 3  # spikes of exactly one value: impacts of a tool never repeat a value
_BOTH_WAYS = 3  # spikes up and as many down: impacts of a tool go one way
_FAR = 3.0  # times the usual range, for such spikes: jerks of a piston go both ways, but less far
_PULSE = 0.02  # longest set-point to which no regulator responds [s]
_TURNS = 0.5  # share of small changes that change sign: two thirds in noise, few in a motion
_MOST_LOOKED_AT = 100_000  # samples
_LONGEST_ZERO = 0.1  # a piston cannot leave and return within this time without a sample on its way [s]
_FAST = 5.0  # times the 99 % quantile of the changes
_MARGIN = 0.1  # of the usual range
_COUNTS = 5.0  # times the smallest change
_FEWEST_MEASURED = 5  # samples


def dropouts(times: NDArray[np.int64], values: Array, role: str) -> NDArray[np.bool_]:
    """
    Return which samples leap out and back faster than a piston, a pressure or a tool can, shape (n,).

    - Displacement: a spike of one or two samples is a dropout.
    - Force: spikes are dropouts only if a value repeats or if spikes go both ways, since an impact leaps, too. All
      samples of a repeated value are dropouts.
    - A run of exactly one value between two leaps is a code for "nothing measured", of any length. A force without
      noise is an exception: it may rest at zero.
    - A short run of zeros is a dropout if the signal does not approach zero: a logger writes zeros for missing values.
    - A signal that mostly rests without noise is not judged.

    Parameters
    ----------
    times, values
        Times [ns] and values [SI] of the samples, shape (n,).
    role
        `displacement`, `pressure` or `force`.

    """
    is_dropout = np.zeros(len(values), bool)
    changes = np.diff(values)
    steps = np.abs(changes)
    if role != 'pressure':
        is_dropout |= _zeros(times, values, within=role == 'displacement')
    every = slice(None, None, max(1, len(steps) // _MOST_LOOKED_AT))
    usual = float(np.percentile(steps[every], 75.0)) if len(steps) else 0.0
    if not usual:
        return is_dropout
    low, high = np.percentile(values[every], (5.0, 95.0))
    leaps = np.flatnonzero(steps > max(_SUDDEN * usual, _SHARE_OF_RANGE * float(high - low)))
    if len(leaps) > _MOST_LEAPS * len(values):
        return is_dropout
    outer = np.pad(steps, 1)
    moved = np.append(0, np.cumsum(steps != 0.0))
    has_codes = role != 'force' or is_noisy(changes[every])
    spikes: dict[float, list[slice]] = {}
    index = 0
    while index < len(leaps) - 1:
        before, last = int(leaps[index]), int(leaps[index + 1])
        run = slice(before + 1, last + 1)
        length = last - before
        is_back = changes[before] * changes[last] < 0.0
        is_quick = is_back and length <= _SPIKE and times[last + 1] - times[before] <= _QUICK * NANOSECONDS
        is_sudden = max(outer[before], outer[last + 2]) < _CALM * min(steps[before], steps[last])
        is_code = length >= _CODE and moved[last] == moved[before + 1] and is_sudden
        if is_quick and role != 'pressure':
            spikes.setdefault(float(values[last]), []).append(run)
        elif not (has_codes and is_code):
            index += 1
            continue
        is_dropout[run] = role != 'force' or is_code
        index += 2  # the signal continues after the leap back
    heights = np.array([changes[run.start - 1] for runs in spikes.values() for run in runs])
    far = _FAR * float(high - low)
    are_both_ways = min(np.sum(heights > far), np.sum(heights < -far)) >= _BOTH_WAYS
    for value, runs in spikes.items():
        if len(runs) >= _SAME_CODE:
            is_dropout[values == value] = True
        for run in runs if are_both_ways else ():
            is_dropout[run] = True
    return is_dropout


def _zeros(times: NDArray[np.int64], values: Array, *, within: bool) -> NDArray[np.bool_]:
    """
    Return which samples are in short runs of exact zeros between leaps, shape (n,).

    A leap is larger than nearly all changes between samples. For one or two zeros, a leap may also be a bend: the
    zeros are farther from the line between the adjacent samples than noise and motion explain.

    Parameters
    ----------
    times, values
        Times [ns] and values [SI] of the samples, shape (n,).
    within
        Whether to include zeros within the usual range.

    """
    is_dropout = np.zeros(len(values), bool)
    zero = values == 0.0
    edges = np.diff(zero.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (begins > 0) & (ends < len(values))
    begins, ends = begins[inner], ends[inner]
    measured = values[~zero]
    if not begins.size or len(measured) < _FEWEST_MEASURED:
        return is_dropout
    low, high = np.percentile(measured, (5.0, 95.0))
    margin = _MARGIN * float(high - low)
    if not within and low - margin < 0.0 < high + margin:
        return is_dropout
    steps, bends = np.abs(np.diff(measured)), np.abs(np.diff(measured, 2))
    steps, bends = steps[steps > 0.0], bends[bends > 0.0]
    if not bends.size:
        return is_dropout
    change = max(_FAST * float(np.percentile(steps, 99.0)), margin)
    bend = max(_FAST * float(np.percentile(bends, 99.0)), _COUNTS * float(np.min(steps)))
    before, behind, length = values[begins - 1], values[ends], ends - begins
    distance = np.where(before * behind > 0.0, np.minimum(np.abs(before), np.abs(behind)), 0.0)
    is_leap = (distance > change) | ((length <= _SPIKE) & (distance > bend * length**2))
    is_short = times[ends - 1] - times[begins] < _LONGEST_ZERO * NANOSECONDS
    for begin, end in zip(begins[is_leap & is_short].tolist(), ends[is_leap & is_short].tolist()):
        is_dropout[begin:end] = True
    return is_dropout


def without_pulses(times: NDArray[np.int64], values: Array) -> NDArray[np.bool_]:
    """
    Return which changes of a set-point stay, shape (n,): all except those reverted within 0.02 s.

    Parameters
    ----------
    times, values
        Times [ns] and values [SI] of the changes, shape (n,).

    """
    kept = np.ones(len(values), bool)
    index = 1
    while index < len(values) - 1:
        if times[index + 1] - times[index] <= _PULSE * NANOSECONDS and values[index + 1] == values[index - 1]:
            kept[index] = kept[index + 1] = False
            index += 1
        index += 1
    return kept


def is_noisy(changes: Array) -> bool:
    """Return whether small changes between samples, shape (n,), alternate in sign as noise does."""
    changes = changes[changes != 0.0]
    steps = np.abs(changes)
    if len(steps) < 2:
        return False
    small = steps[1:] + steps[:-1] < 2.0 * float(np.median(steps))
    return bool(small.any() and np.mean((changes[1:] * changes[:-1])[small] < 0.0) > _TURNS)
