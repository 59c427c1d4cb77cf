# SPDX-License-Identifier: Apache-2.0
"""Remove wild samples of a displacement, force or pressure, and correct a counter that wraps round."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.cleaning import Cleaned, keep
from cfd_pneumatic.recording.dropouts import dropouts
from cfd_pneumatic.recording.message_texts import count_of

_MOST_LOOKED_AT = 100_000  # samples
_PART = 1_000_000  # samples that are checked together
_MOST_LEFT_OUT = 0.2  # share of the samples; a larger share is not an exception
_SPIKE = 3  # longest excursion with different values [samples]
_FAR_OUT = 10.0  # distance beyond which any run of samples is wild, in usual ranges
_COUNTERS = (*(2.0**bits for bits in range(8, 33)), *(10.0**digits for digits in range(3, 8)))
"""Usual numbers of steps of a counter."""

_NEARLY = 0.98  # share of a counter's steps that the recording covers
_MOST_LEAPS = 0.3  # share of the samples
_GO_ON = 0.75  # share of the leaps after which the motion continues
_UNSURE = 0.4  # motion between two samples above which unwrapping is unsure, as a share of the counter's range
_SMOOTHER = 0.5  # remaining changes of the speed after unwrapping, as a share
_WRAP = 0.5  # smallest leap of a counter, as a share of the range
_SMALL = 0.1  # largest other change, as a share of the leap
_ALIKE = 0.1  # largest difference between leaps of a counter, as a share


@dataclass(frozen=True)
class Screen:
    """
    Limits of an excursion from the usual range beyond which a sample is wild.

    Attributes
    ----------
    spans
        Distance in usual ranges.
    least
        Smallest distance [SI]: in a recording mostly at rest the usual range is noise, which a stroke exceeds.
    rate
        Speed of the excursion [SI/s].
    wraps
        Whether the sensor may be a counter that wraps round.

    """

    spans: float
    least: float
    rate: float
    wraps: bool


SCREENS = {
    'displacement': Screen(spans=1.0, least=0.0, rate=3.0, wraps=True),  # no such piston moves at 3 m/s
    'force': Screen(spans=5.0, least=1e3, rate=0.0, wraps=False),  # no such device makes a kilonewton
    'pressure': Screen(spans=math.inf, least=math.inf, rate=0.0, wraps=False),  # only runs of a code are left out
}
"""Limits by role."""


def screened(cleaned: Cleaned, role: str, name: str) -> Cleaned:
    """Return the samples of a signal without wild samples, with notes on the changes."""
    screen = SCREENS[role]
    values, notes = cleaned.values, list(cleaned.notes)
    period = _period_of_counter(values) if screen.wraps else None
    if period is not None:
        before = np.diff(values)
        values[:] = np.unwrap(values, period=period)
        wraps = int(np.count_nonzero(np.abs(np.diff(values) - before) > 0.5 * period))
        notes.append(f'{name}: its counter wraps round {count_of(wraps, "time")}, by {period:.4g} m: made continuous')
        if np.max(np.abs(np.diff(values))) > _UNSURE * period:
            notes.append(f'{name}: that is unsure, as the piston moves by half of it between samples: sample faster')
    wild = _wild(cleaned.times, values, screen)
    dropped = np.zeros(len(values), bool)
    for begin in range(0, len(values), _PART):  # of a long recording, in memory for a part only
        part = slice(begin, begin + _PART)
        with np.errstate(over='ignore', invalid='ignore'):  # a table may hold enormous numbers
            dropped[part] = dropouts(cleaned.times[part], values[part], role)
    if np.mean(wild | dropped) <= _MOST_LEFT_OUT:
        wild |= dropped
    number = int(np.count_nonzero(wild))
    if not number:
        return Cleaned(cleaned.times, values, tuple(notes))
    first = (cleaned.times[int(np.argmax(wild))] - cleaned.times[0]) / NANOSECONDS
    change = f'left out {count_of(number, "sample")} of {len(values):,} that leap out of the others and back'
    advice = "check the sensor's range, its plug and the logger, and whether the topic has two publishers"
    notes.append(f'{name}: {change}, first {first:.4g} s after the begin: {advice}')
    times, values = keep(cleaned.times, values, lambda part: ~wild[part])
    return Cleaned(times, values, tuple(notes))


def _period_of_counter(values: Array) -> float | None:
    """
    Return the range of a counter that wraps round; None if no counter is recognised.

    After a wrap the motion continues; a piston that leaps would stop. A counter with a range below the motion is
    recognised by its number of steps, a power of two or of ten. All leaps of a counter with a wide range are equal.
    """
    values = values[:_PART]
    reach = float(np.ptp(values)) if len(values) >= 5 else 0.0
    changes = np.diff(values)
    leaps = np.flatnonzero(np.abs(changes) > _WRAP * reach)
    inner = leaps[(leaps > 0) & (leaps < len(changes) - 1)]
    if not reach or not inner.size or leaps.size > _MOST_LEAPS * len(values):
        return None
    leap, before, behind = changes[inner], changes[inner - 1], changes[inner + 1]
    goes_on = (np.sign(before) == -np.sign(leap)) & (np.sign(behind) == -np.sign(leap))
    if np.mean(goes_on) < _GO_ON:
        return None
    small_changes = np.delete(np.abs(changes), leaps)
    alike = np.ptp(np.abs(changes[leaps])) < _ALIKE * reach and np.percentile(small_changes, 99.0) < _SMALL * reach
    period = _range_of_counter(values, reach)
    if period is None and alike:
        period = float(np.median(np.abs(leap - 0.5 * (before + behind))))
    if period is None:
        return None
    continuous = np.unwrap(values, period=period)
    is_smoother = np.std(np.diff(continuous, 2)) < _SMOOTHER * np.std(np.diff(values, 2))
    return period if is_smoother else None


def _range_of_counter(values: Array, reach: float) -> float | None:
    """Return the range of a counter with a usual number of steps; None for another number."""
    levels = np.unique(values[:: max(1, len(values) // _MOST_LOOKED_AT)])
    step = float(np.min(np.diff(levels))) if len(levels) > 1 else 0.0
    if not step:
        return None
    steps = reach / step + 1.0
    usual = [number for number in _COUNTERS if _NEARLY * number <= steps <= number * (1.0 + 1e-4)]
    return usual[0] * step if usual else None


def _wild(times: NDArray[np.int64], values: Array, screen: Screen) -> NDArray[np.bool_]:
    """Return which samples leap out of the usual range and back."""
    wild = np.zeros(len(values), bool)
    selection = values[:: max(1, len(values) // _MOST_LOOKED_AT)]
    low, high = np.percentile(selection, (5.0, 95.0)).tolist()
    if low == high or len(values) < 5:
        return wild
    for begin in range(0, len(values), _PART):
        part = slice(begin, begin + _PART)
        wild[part] = _wild_within(times[part], values[part], low, high, screen)
    return wild if np.mean(wild) <= _MOST_LEFT_OUT else np.zeros(len(values), bool)


def _wild_within(times: NDArray[np.int64], values: Array, low: float, high: float, screen: Screen) -> NDArray[np.bool_]:
    """Return which samples of a part leap out of the usual range, from `low` to `high`, and back."""
    wild = np.zeros(len(values), bool)
    span = high - low
    far = max(screen.spans * span, screen.least)
    outside = (values > high + far) | (values < low - far)
    if not outside.any() or len(values) < 2:
        return wild
    steps, seconds = np.abs(np.diff(values)), np.diff(times) / NANOSECONDS
    for begin, end in _runs(outside):
        run = values[begin:end]
        edges = [*([begin - 1] if begin else []), *([end - 1] if end < len(values) else [])]
        is_odd = len(run) <= _SPIKE or np.ptp(run) == 0.0 or np.min(np.abs(run - low)) > _FAR_OUT * span
        has_leaps = edges and all(steps[edge] > max(far, screen.rate * seconds[edge]) for edge in edges)
        wild[begin:end] = is_odd and bool(has_leaps)
    return wild


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.diff(flags.astype(np.int8), prepend=0, append=0)
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()))
