# SPDX-License-Identifier: Apache-2.0
"""Report samples of a faulty sensor or logger: leaps, shifts, frozen values, clipped ranges and mixed sources."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.input_checks.thresholds import (
    ANSWER_TIME,
    FEWEST_FROZEN_SAMPLES,
    FEWEST_SAMPLES_AT_LIMIT,
    FEWEST_STUCK_VALUES,
    LARGEST_EVEN_RATIO,
    LARGEST_LEVEL_CHANGE,
    LARGEST_REPEATED_SHARE,
    LARGEST_SHARE_BEYOND,
    LARGEST_STEP_SHARE,
    LARGEST_STEPS_INTO_LIMIT,
    LEAST_ALTERNATING_SHARE,
    LEAST_ALTERNATION,
    LEAST_CHANGE_RATIO,
    LEAST_CLIPPED_RANGE,
    LEAST_FROZEN_SHARE,
    LEAST_FROZEN_TIME,
    LEAST_HELD_SHARE,
    LEAST_LEAP_OUT,
    LEAST_LIMIT_SHARE,
    LEAST_LONE_SHIFT,
    LEAST_MOVED_SHARE,
    LEAST_PILE_RATIO,
    LEAST_PILE_SHARE,
    LEAST_PRESSURE_LEAP,
    LEAST_RANGE_AT_SETPOINT,
    LEAST_SHARE_BETWEEN,
    LEAST_SHIFT,
    LEAST_SHIFT_COUNTS,
    LEAST_SHIFT_SHARE,
    LEAST_SOURCE_DISTANCE,
    LEAST_SPEED_CHANGE,
    LEAST_STEPS_TO_STUCK,
    LEVEL_SAMPLES,
    LONGEST_RESOLVED_INTERVAL,
    LONGEST_SPIKE,
    MEAN_SAMPLES,
    MOST_INSPECTED_SAMPLES,
    MOST_SHIFTS,
    RARELY_REPEATED_SHARE,
    SETTLING_TIME,
    SHIFT_TIME,
    STROKE_TIME,
)
from cfd_pneumatic.notices import Notice, warning
from cfd_pneumatic.recording import Signal, count_of, is_noisy

_NOISE_OF_BENDS = 1.0 / (0.6745 * math.sqrt(6.0))  # standard deviation of white noise over median second difference


def check_leaps(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """Warn if single samples leap away and back, as with flipped bits or loose plugs."""
    if role not in ('displacement', 'pressure'):  # a force contains the jerks of the moving parts
        return
    values = signal.values
    low, middle, high = np.percentile(values[:: max(1, len(values) // MOST_INSPECTED_SAMPLES)], (1.0, 50.0, 99.0))
    span = max(float(high - low), LEAST_PRESSURE_LEAP * float(middle) if role == 'pressure' else 0.0)
    if not span or (np.max(values) <= high + span and np.min(values) >= low - span):
        return
    outside = (values > high + span) | (values < low - span)
    edges = np.diff(outside.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (ends - begins <= LONGEST_SPIKE) & (begins > 0) & (ends < len(values))
    begins, ends = begins[inner], ends[inner]
    there, back = np.abs(values[begins] - values[begins - 1]), np.abs(values[ends - 1] - values[ends])
    spikes = np.minimum(there, back) > span
    if np.any(spikes):
        name = role if cylinder is None else f'{cylinder} {role}'
        number, first = int(np.sum((ends - begins)[spikes])), float(signal.times[begins[spikes][0]])
        yield warning(
            'samples_suspect',
            f'{name}: {count_of(number, "sample")} of {len(signal):,} {"leap" if number > 1 else "leaps"} away and '
            f'back, first at t = {first:.4g} s',
            'remove these samples, and inspect the plug, the cable and the logger',
        )


def check_two_sources(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """Warn if the samples alternate between two sensors, as when two nodes publish the same topic."""
    values = signal.values[:MOST_INSPECTED_SAMPLES]
    if role == 'setpoint' or len(values) < FEWEST_SAMPLES_AT_LIMIT:
        return
    to_previous, to_second_previous = np.abs(values[2:] - values[1:-1]), np.abs(values[2:] - values[:-2])
    alternates = (to_previous > LEAST_ALTERNATION * to_second_previous) & (
        to_previous > LEAST_SOURCE_DISTANCE * np.ptp(values)
    )
    share = float(np.mean(alternates))
    if share > LEAST_ALTERNATING_SHARE:
        name = role if cylinder is None else f'{cylinder} {role}'
        yield warning(
            'samples_suspect',
            f'{name}: the samples seem to alternate between two sensors: {100.0 * share:.0f} % are far from the '
            'previous sample and near the sample before that',
            'check whether two nodes publish the topic or a column holds two sensors, and record a single sensor',
        )


def check_stuck_sensor(role: str, signal: Signal) -> Iterator[Notice]:
    """
    Warn if a displacement or force repeats several values without noise, or leaps out of the repeats.

    A signal at rest has sensor noise, or starts to move in small steps, or rests at a single value, as a force without
    contact does.
    """
    values, times = signal.values[:MOST_INSPECTED_SAMPLES], signal.times[:MOST_INSPECTED_SAMPLES]
    changes = np.diff(values)
    steps = np.abs(changes)
    begins = np.flatnonzero(np.append(True, steps != 0.0))  # of runs of equal values
    ends = np.append(begins[1:], len(values))
    is_long = (ends - begins >= FEWEST_FROZEN_SAMPLES) & (times[ends - 1] - times[begins] >= LEAST_FROZEN_TIME)
    inner = is_long & (ends < len(values))
    moving = np.repeat(~is_long, ends - begins)[1:]
    if not inner.any() or not moving.any() or np.mean(steps[moving] == 0.0) > LARGEST_REPEATED_SHARE:
        return
    out = steps[np.minimum(ends, len(values) - 1) - 1]
    leaps_out = inner & (out > LEAST_LEAP_OUT * np.percentile(steps[moving], 99.0))
    has_noise = is_noisy(changes[moving]) and np.mean(steps[moving] == 0.0) < RARELY_REPEATED_SHARE
    frozen = inner if has_noise else leaps_out
    if len(np.unique(values[begins[frozen]])) < FEWEST_STUCK_VALUES:
        return
    share = float(np.sum((ends - begins)[frozen])) / len(values)
    yield warning(
        'samples_suspect',
        f'{role}: the signal freezes {count_of(int(np.sum(frozen)), "time")}, in '
        f'{float(f"{100.0 * share:.2g}"):g} % of the samples, first at t = {times[begins[frozen][0]]:.4g} s',
        "inspect the sensor's plug, its cable and the logger, and record again",
    )


def check_shifts(role: str, cylinder: str | None, signal: Signal) -> Iterator[Notice]:
    """
    Warn if a displacement or pressure shifts within a sample, as with a sensor that is zeroed or slips.

    A piston or a pressure needs several samples for such a change at 200 Hz or faster.
    """
    values, times = signal.values[:MOST_INSPECTED_SAMPLES], signal.times[:MOST_INSPECTED_SAMPLES]
    if role not in ('displacement', 'pressure') or len(values) < FEWEST_SAMPLES_AT_LIMIT:
        return
    steps, intervals = np.abs(np.diff(values)), np.diff(times)
    period = float(np.median(intervals))
    if period > LONGEST_RESOLVED_INTERVAL or not np.median(steps):
        return
    least = max(
        LEAST_SHIFT * float(np.percentile(steps, 99.0)),
        LEAST_SHIFT_SHARE * float(np.ptp(values)),
        LEAST_SHIFT_COUNTS * float(np.min(steps[steps > 0.0])),
    )
    around, shifts = round(SHIFT_TIME / period), []
    for index in np.flatnonzero((steps > least) & (intervals < LONGEST_RESOLVED_INTERVAL)).tolist():
        before, behind = values[max(index + 1 - around, 0) : index + 1], values[index + 1 : index + 1 + around]
        largest = max(float(np.max(np.abs(np.diff(side)), initial=0.0)) for side in (before, behind))
        stays = abs(np.median(behind) - np.median(before)) > 0.5 * steps[index]
        if stays and np.ptp(before) and np.ptp(behind) and steps[index] > LEAST_LONE_SHIFT * largest:
            shifts.append(f'{times[index + 1]:.4g}')
    if 0 < len(shifts) <= MOST_SHIFTS:
        name = role if cylinder is None else f'{cylinder} {role}'
        yield warning(
            'samples_suspect',
            f'{name}: the signal shifts within a single sample, at t = {" and ".join(shifts)} s',
            'check whether the sensor was zeroed or slipped, and identify the parts separately (--from, --until)',
        )


def check_range_limit(displacement: Signal) -> Iterator[Notice]:
    """
    Warn if a displacement reaches the limit of its sensor, which then repeats a value while the piston moves on.

    At a mechanical stop the piston stops as suddenly, but the sensor still has noise.
    """
    values = displacement.values[:MOST_INSPECTED_SAMPLES]
    if len(values) < FEWEST_SAMPLES_AT_LIMIT or np.ptp(values) == 0.0:
        return
    steps = np.diff(values)
    changes = np.abs(steps[steps != 0.0])
    least = max(0.5 * float(np.median(changes)), LARGEST_STEPS_INTO_LIMIT * float(np.min(changes)))
    for limit, direction in ((np.max(values), 1.0), (np.min(values), -1.0)):
        at_limit = values == limit
        edges = np.diff(at_limit.astype(np.int8), prepend=0, append=0)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        is_long = (ends - begins >= FEWEST_FROZEN_SAMPLES) & (begins > 1)
        begins, ends = begins[is_long], ends[is_long]
        elsewhere = ~(at_limit[1:] | at_limit[:-1])
        is_fine = np.mean(steps[elsewhere] == 0.0) < LARGEST_REPEATED_SHARE if elsewhere.any() else False
        if not begins.size or not is_fine:
            continue
        runs_into = direction * steps[begins - 2] > least
        share = float(np.sum(ends - begins)) / len(values)
        if np.mean(runs_into) > 0.5 and share > LEAST_LIMIT_SHARE:
            yield warning(
                'samples_suspect',
                f'the displacement is exactly constant at its {"highest" if direction > 0.0 else "lowest"} value, '
                f'{1e3 * float(limit):.4g} mm, in {float(f"{100.0 * share:.2g}"):g} % of the samples',
                "check whether this is the limit of the sensor's range, and record again within the range",
            )


def check_clipping(name: str, pressure: Signal, setpoint: Signal | None, displacement: Signal) -> Iterator[Notice]:
    """
    Warn if a pressure piles up at both ends of its range, as with a clipping sensor and noise added later.

    Averaging reduces the noise, so that a pile is narrower than any real reversal of the pressure. The speed of the
    piston changes within the piles. Between the piles the pressure varies even without steps of the set-point.
    """
    values, times = pressure.values[:MOST_INSPECTED_SAMPLES], pressure.times[:MOST_INSPECTED_SAMPLES]
    if len(values) < FEWEST_SAMPLES_AT_LIMIT:
        return
    noise = float(np.median(np.abs(np.diff(values, 2)))) * _NOISE_OF_BENDS
    means = _means(values)
    width = noise / math.sqrt(MEAN_SAMPLES)
    if not width or np.ptp(means) < LEAST_CLIPPED_RANGE * width:
        return
    middles = times[MEAN_SAMPLES // 2 :][: len(means)]
    speed = np.gradient(np.interp(middles, displacement.times, displacement.values), middles)
    speed = np.convolve(speed, np.full(MEAN_SAMPLES, 1.0 / MEAN_SAMPLES), 'same')
    piles = [_pile(means, width), _pile(-means, width)]
    shares = [float(np.mean(pile)) for pile in piles]
    if min(shares) < LEAST_PILE_SHARE:
        return
    if any(np.std(speed[pile]) < LEAST_SPEED_CHANGE * np.std(speed) for pile in piles):
        return
    between = ~(piles[0] | piles[1])
    if setpoint is not None:
        index = np.searchsorted(setpoint.times[1:], middles, side='right')
        between &= middles - setpoint.times[index] > SETTLING_TIME
        means = means - setpoint.values[index]
    if np.mean(between) < LEAST_SHARE_BETWEEN or np.std(means[between]) < LEAST_RANGE_AT_SETPOINT * width:
        return
    yield warning(
        'samples_suspect',
        f'{name}: the pressure piles up at both ends of its range, in {100.0 * sum(shares):.2g} % of the samples, '
        'while the piston changes its speed',
        'check whether the range of the sensor or the logger is too small, and record again within the range',
    )


def _means(values: Array) -> Array:
    return np.convolve(values, np.full(MEAN_SAMPLES, 1.0 / MEAN_SAMPLES), 'valid')


def _pile(means: Array, width: float) -> NDArray[np.bool_]:
    """Return which means are in a pile at the upper end, as narrow as their noise, shape (n,); all False without."""
    top = float(np.percentile(means, 99.5)) - width
    level = float(np.median(means[means > top - 4.0 * width]))
    pile: NDArray[np.bool_] = np.abs(means - level) < 2.0 * width
    below = (means <= level - 2.0 * width) & (means > level - 6.0 * width)
    beyond = float(np.mean(means > level + 3.0 * width))
    is_pile = beyond < LARGEST_SHARE_BEYOND and np.mean(pile) > LEAST_PILE_RATIO * np.mean(below)
    return pile if is_pile else np.zeros(len(means), bool)


def check_setpoint_noise(name: str, setpoint: Signal, pressure: Signal) -> Iterator[Notice]:
    """
    Warn if a set-point has noise about its levels, as a measured set-point has.

    A controller also changes its set-point at each sample, but does not hold the mean.
    """
    values = setpoint.values[:MOST_INSPECTED_SAMPLES]
    changes = np.diff(values)
    if (
        len(setpoint) < LEAST_CHANGE_RATIO * len(pressure)
        or len(values) < FEWEST_SAMPLES_AT_LIMIT
        or not is_noisy(changes)
    ):
        return
    noise = float(np.median(np.abs(np.diff(values, 2)))) * _NOISE_OF_BENDS
    length = len(values) // LEVEL_SAMPLES * LEVEL_SAMPLES
    means = values[:length].reshape(-1, LEVEL_SAMPLES).mean(axis=1)
    is_held = np.abs(np.diff(means)) < LARGEST_LEVEL_CHANGE * noise / math.sqrt(LEVEL_SAMPLES)
    if np.mean(is_held) < LEAST_HELD_SHARE:
        return
    yield warning(
        'setpoint_suspect',
        f'{name}: the set-point has noise of {noise:.3g} Pa about its levels: the model treats each change as a step',
        'record the commanded set-point instead of a measured set-point, or round the set-point to its levels',
    )


def check_frozen_pressure(name: str, pressure: Signal, displacement: Signal, least: float) -> Iterator[Notice]:
    """
    Warn if a pressure freezes while the piston reverses, or freezes and resumes suddenly.

    At rest and at constant speed a healthy pressure may be constant if its noise is below the sensor's resolution.
    The piston counts as moving if its motion exceeds `least` [m].
    """
    values, times = pressure.values[:MOST_INSPECTED_SAMPLES], pressure.times[:MOST_INSPECTED_SAMPLES]
    begins = np.flatnonzero(np.append(True, np.diff(values) != 0.0))  # of runs of equal values
    repeats = np.diff(begins, append=len(values)) - 1
    run_values = values[begins]
    if len(run_values) < 2 or np.sum(repeats) <= LEAST_FROZEN_SHARE * (len(values) - 1):
        return
    repeated = repeats[repeats > 0]
    if np.percentile(repeated, 90.0) < LARGEST_EVEN_RATIO * np.median(repeated):
        return  # the logger reads faster than the sensor updates
    steps = np.abs(np.diff(run_values))
    finest, strokes = np.min(steps), max(1, min(len(values) // 2, int((times[-1] - times[0]) / STROKE_TIME)))
    spans = [float(np.ptp(part)) for part in np.array_split(values, strokes) if np.any(part != part[:1])] or [0.0]
    if finest > LARGEST_STEP_SHARE * np.median(spans):
        return

    before, now, after = (
        np.interp(times + shift, displacement.times, displacement.values) for shift in (-ANSWER_TIME, 0, ANSWER_TIME)
    )
    low, high = np.percentile(displacement.values[:: max(1, len(displacement) // MOST_INSPECTED_SAMPLES)], (1.0, 99.0))
    moved = np.minimum(np.abs(now - before), np.abs(after - now)) > max(LEAST_MOVED_SHARE * (high - low), least)
    direction = np.where(moved, np.sign(after - before), np.nan)
    turns = np.fmin.reduceat(direction, begins) < np.fmax.reduceat(direction, begins)

    is_extreme = (run_values == np.min(run_values)) | (run_values == np.max(run_values))
    is_sudden = np.minimum(np.append(0.0, steps), np.append(steps, 0.0)) > LEAST_STEPS_TO_STUCK * finest
    is_long = (repeats >= FEWEST_FROZEN_SAMPLES) & (times[begins + repeats] - times[begins] >= LEAST_FROZEN_TIME)
    is_frozen = is_long & (turns | (is_extreme & is_sudden))
    frozen = moved & np.repeat(is_frozen, repeats + 1)
    share = np.sum(frozen) / max(1, np.sum(moved))
    if share <= LEAST_FROZEN_SHARE:
        return
    value = np.median(values[frozen])
    where = 'its lowest' if value == np.min(values) else 'its highest' if value == np.max(values) else 'the same'
    yield warning(
        'samples_suspect',
        f'{name}: the pressure freezes, mostly at {where} value, in {float(f"{100.0 * share:.2g}"):g} % of the time '
        'in which the piston moves',
        "inspect the sensor's range, its plug and the logger, and record again",
    )
