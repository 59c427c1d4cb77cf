# SPDX-License-Identifier: Apache-2.0
"""Samples that no sensor gives which is well: some leap out of all others and back, some hold still."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.notices import Notice, warning
from cfd_pneumatic.recording import Signal, count_of, is_noisy

_SPIKE = 3  # samples that a leap out and back may last
_LEAP = 0.25  # of the absolute pressure: what leaps by less may be the piston's doing
_MOST_LOOKED_AT = 100_000  # samples
_MOVED = 0.05  # share of the stroke, before and after, within
_WHILE = 0.05  # so long: the pressure answers the piston within that [s]
_FROZEN = 0.03  # how long a pressure holds still then [s]
_FEWEST_FROZEN = 5  # samples that are as the one before
_FROZEN_SHARE = 0.05  # of the samples at which the piston moves
_EVEN = 1.5  # times the median number of repeats: no more are those of a slow sensor that is asked often
_STROKE = 0.5  # in which a piston moves to and fro, about [s]
_FINE = 0.01  # of a pressure's span in that time: with coarser steps of a sensor much looks still
_IN_TURN = 10.0  # times as far from the sample before as from the one before that
_APART = 0.01  # of the span, by which two sensors differ at least
_SHARE_IN_TURN = 0.3  # of the samples; of noise it is a sixteenth
_FEWEST_AT_LIMIT = 100  # samples that tell
_LEAST_AT_LIMIT = 0.005  # share of the samples
_REPEATED = 0.3  # share of samples as the one before, elsewhere: a coarse sensor repeats itself anywhere
_STEPS_INTO = 1.5  # of the sensor: where a piston turns round, a coarse one goes by single steps
_LEAPS_OUT = 2.0  # times what a hundredth of the steps elsewhere exceed
_RARELY_REPEATED = 0.1  # share of samples as the one before
_FEWEST_PLACES = 2  # where it is stuck: a force without contact rests at one
_RESOLVED = 5.5e-3  # interval between samples in which no piston or pressure goes all of a step [s]
_SHIFT = 5.0  # times what a hundredth of the changes exceed
_SHIFT_SHARE = 0.05  # of the span
_COUNTS = 10.0  # times the smallest change: a sensor may flicker by a count
_ALONE = 5.0  # times the largest change around it
_STAYS = 0.1  # so long before and behind: a pulse of the pressure has fallen off by then [s]
_MOST_SHIFTS = 3
_FAR = 4.0  # steps of the sensor into and out of a value: what settles there comes in small ones
_NOISE_OF_BENDS = 1.0 / (0.6745 * math.sqrt(6.0))  # standard deviation of white noise, of its median second difference
_AVERAGED = 9  # samples of a mean
_WIDE = 60.0  # times the noise of a mean, that a pressure moves at least
_LEAST_PILE = 0.02  # share of the samples; of clean recordings 0.001
_STEEP = 2.5  # times as many samples in a pile as below it; at the turns of a sine 2.4 times
_MOST_BEYOND = 2e-3  # share of the samples
_BETWEEN_PILES = 0.1  # share of the samples
_SETTLED = 0.5  # behind a step of the set-point [s]
_WIDE_BETWEEN = 10.0  # times the noise of a mean, about the set-point
_CHANGES_SPEED = 0.25  # of the standard deviation of all speeds; at the turns of a pressure that follows it less
_CHANGING = 0.5  # changes of a set-point for each sample of the pressure
_HELD = 50  # samples of a mean of the set-point
_SAME_LEVEL = 5.0  # times the noise of such a mean
_MOSTLY_HELD = 0.6  # share of the means that are as the one before


def leaps(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """Ask whether single samples leap out of all others and back, as flipped bits and loose plugs make them."""
    if role not in ('displacement', 'pressure'):  # a force has the jerks of what moves
        return
    values = signal.values
    low, middle, high = np.percentile(values[:: max(1, len(values) // _MOST_LOOKED_AT)], (1.0, 50.0, 99.0))
    span = max(float(high - low), _LEAP * float(middle) if role == 'pressure' else 0.0)
    if not span or (np.max(values) <= high + span and np.min(values) >= low - span):
        return
    outside = (values > high + span) | (values < low - span)
    edges = np.diff(outside.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (ends - begins <= _SPIKE) & (begins > 0) & (ends < len(values))
    begins, ends = begins[inner], ends[inner]
    there, back = np.abs(values[begins] - values[begins - 1]), np.abs(values[ends - 1] - values[ends])
    spikes = np.minimum(there, back) > span
    if np.any(spikes):
        name = role if cylinder is None else f'{cylinder} {role}'
        number, first = int(np.sum((ends - begins)[spikes])), float(signal.times[begins[spikes][0]])
        yield warning(
            'samples_suspect',
            f'{name}: {count_of(number, "sample")} of {len(signal):,} {"leap" if number > 1 else "leaps"} out of the '
            f'others and back, first at t = {first:.4g} s',
            'leave them out, and look at the plug, the cable and the logger',
        )


def two_sources(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """Ask whether samples come in turn from two sensors, as of two nodes that publish one topic."""
    values = signal.values[:_MOST_LOOKED_AT]
    if role == 'setpoint' or len(values) < _FEWEST_AT_LIMIT:
        return
    from_last, from_one_before = np.abs(values[2:] - values[1:-1]), np.abs(values[2:] - values[:-2])
    in_turn = (from_last > _IN_TURN * from_one_before) & (from_last > _APART * np.ptp(values))
    share = float(np.mean(in_turn))
    if share > _SHARE_IN_TURN:
        name = role if cylinder is None else f'{cylinder} {role}'
        yield warning(
            'samples_suspect',
            f'{name}: {100.0 * share:.0f} % of the samples are far from the one before and near the one before that',
            'look whether two publish the topic, or two sensors are in one column, and record one of them',
        )


def stuck(role: str, signal: Signal) -> Iterator[Notice]:
    """
    Ask whether a displacement or force holds still now here, now there, though its sensor has noise, or leaps then.

    What rests really has noise as before, or begins to move in small steps, or rests at one value, as a force without
    contact.
    """
    values, times = signal.values[:_MOST_LOOKED_AT], signal.times[:_MOST_LOOKED_AT]
    changes = np.diff(values)
    steps = np.abs(changes)
    begins = np.flatnonzero(np.append(True, steps != 0.0))  # of runs of one value
    ends = np.append(begins[1:], len(values))  # the first sample behind each
    is_long = (ends - begins >= _FEWEST_FROZEN) & (times[ends - 1] - times[begins] >= _FROZEN)
    inner = is_long & (ends < len(values))
    moving = np.repeat(~is_long, ends - begins)[1:]
    if not inner.any() or not moving.any() or np.mean(steps[moving] == 0.0) > _REPEATED:
        return
    out = steps[np.minimum(ends, len(values) - 1) - 1]
    leaps_out = inner & (out > _LEAPS_OUT * np.percentile(steps[moving], 99.0))
    has_noise = is_noisy(changes[moving]) and np.mean(steps[moving] == 0.0) < _RARELY_REPEATED
    held = inner if has_noise else leaps_out
    if len(np.unique(values[begins[held]])) < _FEWEST_PLACES:
        return
    share = float(np.sum((ends - begins)[held])) / len(values)
    yield warning(
        'samples_suspect',
        f'{role}: {count_of(int(np.sum(held)), "time")} it holds quite still, in '
        f'{float(f"{100.0 * share:.2g}"):g} % of the samples, first at t = {times[begins[held][0]]:.4g} s',
        "look at the sensor's plug, its cable and the logger, and record again",
    )


def shifted(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """
    Ask whether a displacement or pressure leaps once and stays, as a sensor that is zeroed or slips does.

    A piston and a pressure that move so far do it in several samples, if these come every 5 ms or faster.
    """
    values, times = signal.values[:_MOST_LOOKED_AT], signal.times[:_MOST_LOOKED_AT]
    if role not in ('displacement', 'pressure') or len(values) < _FEWEST_AT_LIMIT:
        return
    steps, intervals = np.abs(np.diff(values)), np.diff(times)
    period = float(np.median(intervals))
    if period > _RESOLVED or not np.median(steps):
        return
    least = max(
        _SHIFT * float(np.percentile(steps, 99.0)),
        _SHIFT_SHARE * float(np.ptp(values)),
        _COUNTS * float(np.min(steps[steps > 0.0])),
    )
    around, shifts = round(_STAYS / period), []
    for index in np.flatnonzero((steps > least) & (intervals < _RESOLVED)).tolist():
        before, behind = values[max(index + 1 - around, 0) : index + 1], values[index + 1 : index + 1 + around]
        largest = max(float(np.max(np.abs(np.diff(some)), initial=0.0)) for some in (before, behind))
        stays = abs(np.median(behind) - np.median(before)) > 0.5 * steps[index]
        if stays and np.ptp(before) and np.ptp(behind) and steps[index] > _ALONE * largest:
            shifts.append(f'{times[index + 1]:.4g}')
    if 0 < len(shifts) <= _MOST_SHIFTS:
        name = role if cylinder is None else f'{cylinder} {role}'
        yield warning(
            'samples_suspect',
            f'{name}: it leaps within one sample and stays there, at t = {" and ".join(shifts)} s',
            'look whether the sensor was zeroed or has slipped, and identify the parts separately (--from, --until)',
        )


def at_limit(displacement: Signal) -> Iterator[Notice]:
    """
    Ask whether a displacement ends at its sensor's limit, where it holds quite still at once and the piston goes on.

    At a stop, too, a piston holds still at once, but its sensor goes on to have noise.
    """
    values = displacement.values[:_MOST_LOOKED_AT]
    if len(values) < _FEWEST_AT_LIMIT or np.ptp(values) == 0.0:
        return
    steps = np.diff(values)
    moved = np.abs(steps[steps != 0.0])
    least = max(0.5 * float(np.median(moved)), _STEPS_INTO * float(np.min(moved)))
    for limit, towards in ((np.max(values), 1.0), (np.min(values), -1.0)):
        held = values == limit
        edges = np.diff(held.astype(np.int8), prepend=0, append=0)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        long = (ends - begins >= _FEWEST_FROZEN) & (begins > 1)
        begins, ends = begins[long], ends[long]
        elsewhere = ~(held[1:] | held[:-1])
        is_fine = np.mean(steps[elsewhere] == 0.0) < _REPEATED if elsewhere.any() else False
        if not begins.size or not is_fine:
            continue
        runs_into = towards * steps[begins - 2] > least
        share = float(np.sum(ends - begins)) / len(values)
        if np.mean(runs_into) > 0.5 and share > _LEAST_AT_LIMIT:
            yield warning(
                'samples_suspect',
                f'the displacement holds quite still at its {"highest" if towards > 0.0 else "lowest"} value, '
                f'{1e3 * float(limit):.4g} mm, in {float(f"{100.0 * share:.2g}"):g} % of the samples',
                "look whether that is the limit of the sensor's range, and record again within it",
            )


def clipped(name: str, pressure: Signal, setpoint: Signal | None, displacement: Signal) -> Iterator[Notice]:
    """
    Ask whether a pressure piles up at both ends of its range, as that of a clipping sensor with noise behind it does.

    A mean over some samples then has less noise than the pressure, and a pile narrower than any real turn of it. The
    piston changes its speed meanwhile, which the pressure follows between the piles, also where no set-point steps.
    """
    values, times = pressure.values[:_MOST_LOOKED_AT], pressure.times[:_MOST_LOOKED_AT]
    if len(values) < _FEWEST_AT_LIMIT:
        return
    noise = float(np.median(np.abs(np.diff(values, 2)))) * _NOISE_OF_BENDS
    means = _means(values)
    width = noise / math.sqrt(_AVERAGED)
    if not width or np.ptp(means) < _WIDE * width:
        return
    middles = times[_AVERAGED // 2 :][: len(means)]
    speed = np.gradient(np.interp(middles, displacement.times, displacement.values), middles)
    speed = np.convolve(speed, np.full(_AVERAGED, 1.0 / _AVERAGED), 'same')
    piles = [_pile(means, width), _pile(-means, width)]
    shares = [float(np.mean(pile)) for pile in piles]
    if min(shares) < _LEAST_PILE:
        return
    if any(np.std(speed[pile]) < _CHANGES_SPEED * np.std(speed) for pile in piles):
        return
    between = ~(piles[0] | piles[1])
    if setpoint is not None:
        index = np.searchsorted(setpoint.times[1:], middles, side='right')
        between &= middles - setpoint.times[index] > _SETTLED
        means = means - setpoint.values[index]
    if np.mean(between) < _BETWEEN_PILES or np.std(means[between]) < _WIDE_BETWEEN * width:
        return
    yield warning(
        'samples_suspect',
        f'{name}: the pressure piles up at both ends of its range, in {100.0 * sum(shares):.2g} % of the samples, '
        'while the piston changes its speed',
        "look whether the sensor's or the logger's range is too small, and record again within it",
    )


def _means(values: Array) -> Array:
    return np.convolve(values, np.full(_AVERAGED, 1.0 / _AVERAGED), 'valid')


def _pile(means: Array, width: float) -> NDArray[np.bool_]:
    """Return which means are in a pile at the upper end, as narrow as their noise, shape (n,); none without one."""
    top = float(np.percentile(means, 99.5)) - width
    level = float(np.median(means[means > top - 4.0 * width]))
    pile: NDArray[np.bool_] = np.abs(means - level) < 2.0 * width
    below = (means <= level - 2.0 * width) & (means > level - 6.0 * width)
    beyond = float(np.mean(means > level + 3.0 * width))
    is_pile = beyond < _MOST_BEYOND and np.mean(pile) > _STEEP * np.mean(below)
    return pile if is_pile else np.zeros(len(means), bool)


def noisy_setpoint(name: str, setpoint: Signal, pressure: Signal) -> Iterator[Notice]:
    """
    Ask whether a set-point has noise about its levels, as one that is measured has.

    A controller changes its set-point at each sample, too, but does not hold the mean of many.
    """
    values = setpoint.values[:_MOST_LOOKED_AT]
    changes = np.diff(values)
    if len(setpoint) < _CHANGING * len(pressure) or len(values) < _FEWEST_AT_LIMIT or not is_noisy(changes):
        return
    noise = float(np.median(np.abs(np.diff(values, 2)))) * _NOISE_OF_BENDS
    length = len(values) // _HELD * _HELD
    means = values[:length].reshape(-1, _HELD).mean(axis=1)
    is_held = np.abs(np.diff(means)) < _SAME_LEVEL * noise / math.sqrt(_HELD)
    if np.mean(is_held) < _MOSTLY_HELD:
        return
    yield warning(
        'setpoint_suspect',
        f'{name}: the set-point changes at each sample, by noise of {noise:.3g} Pa about its levels: the model takes '
        'each change for a step',
        'record the commanded set-point instead of a measured one, or round it to its levels',
    )


def standstill(name: str, pressure: Signal, displacement: Signal, least: float) -> Iterator[Notice]:
    """
    Ask whether a pressure holds quite still while the piston turns round, or begins and ends to do so at once.

    At a steady speed, and at rest, a pressure with less noise than its sensor has steps is still, too. A piston moves
    by `least` [m] or more.
    """
    values, times = pressure.values[:_MOST_LOOKED_AT], pressure.times[:_MOST_LOOKED_AT]
    begins = np.flatnonzero(np.append(True, np.diff(values) != 0.0))  # of runs of one value, which follow each other
    repeats = np.diff(begins, append=len(values)) - 1
    held = values[begins]
    if len(held) < 2 or np.sum(repeats) <= _FROZEN_SHARE * (len(values) - 1):
        return
    several = repeats[repeats > 0]
    if np.percentile(several, 90.0) < _EVEN * np.median(several):
        return  # a logger that asks faster than the sensor answers
    steps = np.abs(np.diff(held))
    finest, strokes = np.min(steps), max(1, min(len(values) // 2, int((times[-1] - times[0]) / _STROKE)))
    spans = [float(np.ptp(one)) for one in np.array_split(values, strokes) if np.any(one != one[:1])] or [0.0]
    if finest > _FINE * np.median(spans):
        return

    before, here, after = (
        np.interp(times + by, displacement.times, displacement.values) for by in (-_WHILE, 0, _WHILE)
    )
    low, high = np.percentile(displacement.values[:: max(1, len(displacement) // _MOST_LOOKED_AT)], (1.0, 99.0))
    moved = np.minimum(np.abs(here - before), np.abs(after - here)) > max(_MOVED * (high - low), least)
    direction = np.where(moved, np.sign(after - before), np.nan)
    turns = np.fmin.reduceat(direction, begins) < np.fmax.reduceat(direction, begins)

    at_an_end = (held == np.min(held)) | (held == np.max(held))
    sudden = np.minimum(np.append(0.0, steps), np.append(steps, 0.0)) > _FAR * finest
    is_long = (repeats >= _FEWEST_FROZEN) & (times[begins + repeats] - times[begins] >= _FROZEN)
    is_frozen = is_long & (turns | (at_an_end & sudden))
    frozen = moved & np.repeat(is_frozen, repeats + 1)
    share = np.sum(frozen) / max(1, np.sum(moved))
    if share <= _FROZEN_SHARE:
        return
    value = np.median(values[frozen])
    where = 'its lowest' if value == np.min(values) else 'its highest' if value == np.max(values) else 'the same'
    yield warning(
        'samples_suspect',
        f'{name}: the pressure holds quite still, mostly at {where} value, in {float(f"{100.0 * share:.2g}"):g} % of '
        'the time in which the piston moves',
        "look at the sensor's range, its plug and the logger, and record again",
    )
