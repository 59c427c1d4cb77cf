# SPDX-License-Identifier: Apache-2.0
"""Samples within the usual range that were not measured: single ones that leap out and back, and runs of a code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.messages import NANOSECONDS

_SUDDEN = 20.0  # times the change between samples that three quarters do not exceed
_SHARE_OF_RANGE = 0.25  # of the usual range that a leap has at least
_MOST_LEAPS = 0.4  # share of the samples; more is the signal itself
_SPIKE = 2  # samples that leap out and back with any values
_QUICK = 0.011  # between the samples before and behind them: a piston needs longer [s]
_CALM = 0.5  # of a leap, that the changes in front of a code and behind it have at most: a motion takes several
_CODE = 3  # samples of exactly one value between two leaps
_SAME_CODE = 3  # spikes of exactly one value: no impact of a tool repeats another one
_BOTH_WAYS = 3  # spikes up and as many down: impacts of a tool go one way
_FAR = 3.0  # times the usual range, for such spikes: jerks of a piston go both ways, but less far
_PULSE = 0.02  # no regulator answers a set-point that lasts so short [s]
_TURNS = 0.5  # share of small changes that turn back: two thirds of noise, few of a motion
_MOST_LOOKED_AT = 100_000  # samples
_LONGEST_ZERO = 0.1  # in which no piston goes somewhere and back without a sample on its way [s]
_FAST = 5.0  # times what a hundredth of the changes exceed
_MARGIN = 0.1  # of the usual range
_COUNTS = 5.0  # times the smallest change
_FEWEST_MEASURED = 5  # samples


def dropouts(times: NDArray[np.int64], values: Array, role: str) -> NDArray[np.bool_]:
    """
    Return which samples leap out and back as no piston, pressure or tool does, shape (n,).

    A displacement does so in one or two samples; a force only if the same value comes again and again, or if spikes
    go both ways, since an impact leaps, too. All samples of a value that comes again and again are dropped. Runs of
    exactly one value between two leaps are codes for "nothing measured", of any length; a force without noise may rest
    at zero, though. A signal that rests mostly without noise is not judged. A logger writes zeros where it has nothing:
    short runs of zeros are left out if the signal does not come from zero and go back to zero.

    Parameters
    ----------
    times, values
        Of the samples, shape (n,) [ns, SI].
    role
        `displacement`, `pressure` or `force`.

    """
    found = np.zeros(len(values), bool)
    changes = np.diff(values)
    steps = np.abs(changes)
    if role != 'pressure':
        found |= _zeros(times, values, within=role == 'displacement')
    every = slice(None, None, max(1, len(steps) // _MOST_LOOKED_AT))
    usual = float(np.percentile(steps[every], 75.0)) if len(steps) else 0.0
    if not usual:
        return found
    low, high = np.percentile(values[every], (5.0, 95.0))
    leaps = np.flatnonzero(steps > max(_SUDDEN * usual, _SHARE_OF_RANGE * float(high - low)))
    if len(leaps) > _MOST_LEAPS * len(values):
        return found
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
        found[run] = role != 'force' or is_code
        index += 2  # behind the leap back the signal goes on
    heights = np.array([changes[run.start - 1] for runs in spikes.values() for run in runs])
    far = _FAR * float(high - low)
    are_both_ways = min(np.sum(heights > far), np.sum(heights < -far)) >= _BOTH_WAYS
    for value, runs in spikes.items():
        if len(runs) >= _SAME_CODE:
            found[values == value] = True
        for run in runs if are_both_ways else ():
            found[run] = True
    return found


def _zeros(times: NDArray[np.int64], values: Array, *, within: bool) -> NDArray[np.bool_]:
    """
    Return which samples are in short runs of exact zeros between leaps, shape (n,).

    A leap is longer than nearly all changes from sample to sample. Beside one or two zeros a leap is also a bend: the
    zeros are farther from the line between the samples around them than the noise and the motion bring any sample.

    Parameters
    ----------
    times, values
        Of the samples, shape (n,) [ns, SI].
    within
        Whether zeros within the usual range are left out, too.

    """
    found = np.zeros(len(values), bool)
    zero = values == 0.0
    edges = np.diff(zero.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (begins > 0) & (ends < len(values))
    begins, ends = begins[inner], ends[inner]
    measured = values[~zero]
    if not begins.size or len(measured) < _FEWEST_MEASURED:
        return found
    low, high = np.percentile(measured, (5.0, 95.0))
    margin = _MARGIN * float(high - low)
    if not within and low - margin < 0.0 < high + margin:
        return found
    steps, bends = np.abs(np.diff(measured)), np.abs(np.diff(measured, 2))
    steps, bends = steps[steps > 0.0], bends[bends > 0.0]
    if not bends.size:
        return found
    change = max(_FAST * float(np.percentile(steps, 99.0)), margin)
    bend = max(_FAST * float(np.percentile(bends, 99.0)), _COUNTS * float(np.min(steps)))
    before, behind, length = values[begins - 1], values[ends], ends - begins
    distance = np.where(before * behind > 0.0, np.minimum(np.abs(before), np.abs(behind)), 0.0)
    is_leap = (distance > change) | ((length <= _SPIKE) & (distance > bend * length**2))
    is_short = times[ends - 1] - times[begins] < _LONGEST_ZERO * NANOSECONDS
    for begin, end in zip(begins[is_leap & is_short].tolist(), ends[is_leap & is_short].tolist()):
        found[begin:end] = True
    return found


def without_pulses(times: NDArray[np.int64], values: Array) -> NDArray[np.bool_]:
    """
    Return which changes of a set-point stay, shape (n,): all but those that are taken back after an instant.

    Parameters
    ----------
    times, values
        Of the changes, shape (n,) [ns, SI].

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
    """Return whether small changes from sample to sample turn back as noise does, shape (n,)."""
    changes = changes[changes != 0.0]
    steps = np.abs(changes)
    if len(steps) < 2:
        return False
    small = steps[1:] + steps[:-1] < 2.0 * float(np.median(steps))
    return bool(small.any() and np.mean((changes[1:] * changes[:-1])[small] < 0.0) > _TURNS)
