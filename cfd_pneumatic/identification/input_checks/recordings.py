# SPDX-License-Identifier: Apache-2.0
"""
What a recording looks like to people, and which mistakes it looks like.

Ranges are those of a pneumatic force device that fits a robot's hand, with much room on either side: whoever leaves one
of them has most likely named a wrong unit, a wrong reference or a wrong column.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.identification.input_checks.samples import (
    at_limit,
    clipped,
    leaps,
    noisy_setpoint,
    shifted,
    standstill,
    stuck,
    two_sources,
)
from cfd_pneumatic.identification.input_checks.thresholds import (
    AT_SETPOINT_SHARE,
    ATMOSPHERE_TOLERANCE,
    FEWEST_INTERVALS,
    GAUGE_PRESSURES,
    LARGEST_BATCH_SHARE,
    LARGEST_DUPLICATE_DIFFERENCE,
    LARGEST_ROUGHNESS,
    LARGEST_SETPOINT_ERROR,
    LARGEST_SETPOINT_ERROR_SHARE,
    LARGEST_SHARED_TIMES,
    LEAST_GAUGE_PRESSURE,
    LONGEST_BATCH_INTERVAL,
    MOST_GUESSES,
    MOST_INSPECTED_SAMPLES,
    PERIODS,
    STROKES,
)
from cfd_pneumatic.notices import Notice, note, warning
from cfd_pneumatic.recording import ABSOLUTE, GAUGE, CylinderSignals, Recording, Signal, count_of
from cfd_pneumatic.units import PSI, UNITS

LENGTHS = ('m', 'cm', 'mm', 'um', 'inch', 'mil')
"""Units in which people record a displacement."""

PRESSURES = ('Pa', 'mbar', 'kPa', 'psi', 'bar', 'MPa')
"""Units in which people record a pressure."""

_STEADY, _ALIVE = 0.05, 0.5  # share of the samples at which a set-point changes at most, a pressure at least


def describe(recording: Recording, ambient_pressure: float) -> list[str]:
    """Return a line for each signal, in units of people: range, level, and how it was sampled."""
    lines = []
    for role, cylinder, signal in recording.signals():
        name = role if cylinder is None else f'{cylinder} {role}'
        values = _some(signal.values)
        low, high, middle = float(np.min(values)), float(np.max(values)), float(np.median(values))
        if role == 'displacement':
            text = f'{1e3 * low:.4g} to {1e3 * high:.4g} mm'
        elif role in ('pressure', 'setpoint'):
            low, high, middle = (1e-3 * (one - ambient_pressure) for one in (low, high, middle))
            psi = 1e3 / PSI
            text = f'{low:.4g} to {high:.4g} kPa gauge ({psi * low:.3g} to {psi * high:.3g} psi), mostly {middle:.4g}'
        else:
            text = f'{low:.4g} to {high:.4g}' + (' N' if role == 'force' else '')
        lines.append(f'{name}: {text}; {_sampling(role, signal)}')
    return lines


def _sampling(role: str, signal: Signal) -> str:
    if role == 'setpoint':
        return count_of(len(signal) - 1, 'change')
    period = _period(signal)
    rate = f' at {1.0 / period:.4g} Hz' if period else ''
    return f'{count_of(len(signal), "sample")}{rate} in {float(np.ptp(signal.times)):.4g} s'


def check_recordings(recordings: Sequence[Recording], options: Options) -> tuple[Notice, ...]:
    """Return which mistakes recordings look like, and what has to be assumed of them."""
    alone = (notice for one in recordings for notice in check_recording(one, options.ambient_pressure))
    return (*dict.fromkeys(alone), *duplicates(recordings))


def check_recording(recording: Recording, ambient_pressure: float) -> list[Notice]:
    """Return which mistakes a recording looks like, and what has to be assumed of it."""
    found = [] if recording.rests else [*check_motion(recording.displacement), *at_limit(recording.displacement)]
    for role, cylinder, signal in recording.signals():
        found += [
            *leaps(role, cylinder, signal),
            *shifted(role, cylinder, signal),
            *two_sources(role, cylinder, signal),
        ]
    found += [] if recording.rests else stuck('displacement', recording.displacement)
    found += [] if recording.force is None else stuck('force', recording.force)
    for name, own in recording.cylinders.items():
        found += standstill(name, own.pressure, recording.displacement, least=STROKES[0])
        found += _of_sensing(name, own, recording)
    for name, own in recording.cylinders.items():
        found += _of_pressure(name, own, recording.cylinders, ambient_pressure)
    return [*found, *_of_shared_times(recording), *_assumptions(recording)]


def hides_effects(recording: Recording) -> bool:
    """Return whether a wrong unit, a clipped pressure or a noisy set-point hides what effects a device has."""
    return any(one.code == 'unit_suspect' for one in check_motion(recording.displacement)) or any(
        any(_of_sensing(name, own, recording)) for name, own in recording.cylinders.items()
    )


def _of_sensing(name: str, own: CylinderSignals, recording: Recording) -> Iterator[Notice]:
    if not recording.rests:
        yield from clipped(name, own.pressure, own.setpoint, recording.displacement)
    if own.setpoint is not None:
        yield from noisy_setpoint(name, own.setpoint, own.pressure)


def duplicates(recordings: Sequence[Recording]) -> Iterator[Notice]:
    """Yield which recordings hold the same data."""
    for index, one in enumerate(recordings):
        for other in recordings[:index]:
            (role, _, own), (_, _, others) = (next(held.signals()) for held in (one, other))
            if _same(own, others):
                yield warning(
                    'duplicate_recording',
                    f'{one.name} holds the same {role} as {other.name}',
                    'leave one out: twice the same data make standard errors too small',
                )


def _of_shared_times(recording: Recording) -> Iterator[Notice]:
    if recording.shared_times > LARGEST_SHARED_TIMES:
        yield warning(
            'times_suspect',
            f'{100.0 * recording.shared_times:.0f} % of the samples have the time of another, and were left out: '
            'their times have too few digits',
            'record the times with more digits, or give the sample period in the mapping file',
        )


def check_motion(displacement: Signal) -> Iterator[Notice]:
    """Yield which mistakes a displacement and its times look like."""
    stroke, period = float(np.ptp(_some(displacement.values))), _period(displacement)
    if stroke > STROKES[1] or 0.0 < stroke < STROKES[0]:
        yield warning(
            'unit_suspect',
            f'the piston moves {shown_length(stroke)}',
            'check the unit of the displacement'
            + in_other_units(stroke, STROKES, displacement.unit, LENGTHS, shown_length),
        )
    if period and not PERIODS[0] <= period <= PERIODS[1]:
        yield warning(
            'unit_suspect',
            f'a sample every {period:.3g} s, {float(np.ptp(displacement.times)):.4g} s in all',
            'check the unit of the time' + _were_it(period, PERIODS, _SCALES, lambda value: f'{value:.3g} s'),
        )
    intervals = np.diff(displacement.times[:MOST_INSPECTED_SAMPLES])
    intervals = intervals[intervals < LONGEST_BATCH_INTERVAL]
    if intervals.size >= FEWEST_INTERVALS and np.mean(intervals < LARGEST_BATCH_SHARE * np.mean(intervals)) > 0.5:
        yield warning(
            'times_suspect',
            f'most samples are {1e3 * float(np.median(intervals)):.3g} ms apart, on average '
            f'{1e3 * float(np.mean(intervals)):.3g} ms: their times come in batches',
            'use the time at which each sample was taken, or give the sample period in the mapping file',
        )
    values = displacement.values[:MOST_INSPECTED_SAMPLES]
    values = np.clip(values, *np.percentile(values, (1.0, 99.0)))  # single wild ones say nothing of the rate
    spread = float(np.std(values))
    if spread and float(np.sqrt(np.mean(np.diff(values) ** 2))) > LARGEST_ROUGHNESS * spread:
        yield warning(
            'sampling_slow',
            f'the displacement is another one at each sample, every {period:.3g} s',
            'sample ten times as fast, or let the piston move more slowly',
        )


def _of_pressure(
    name: str, own: CylinderSignals, cylinders: Mapping[str, CylinderSignals], ambient: float
) -> Iterator[Notice]:
    gauge = float(np.median(_some(own.pressure.values))) - ambient
    off = 0.0 if own.setpoint is None else _off(own.pressure, own.setpoint)
    apart = f'{name}: the pressure is {abs(off) / 1e3:.4g} kPa {"above" if off > 0.0 else "below"} its set-point'
    if own.setpoint is not None and _look_swapped(own.pressure, own.setpoint):
        yield warning(
            'setpoint_suspect',
            f'{name}: the pressure moves in steps, and the set-point at every sample',
            'swap pressure and set-point',
        )
    elif abs(abs(off) - ambient) < ATMOSPHERE_TOLERANCE * ambient and gauge < GAUGE_PRESSURES[1]:
        yield warning('reference_suspect', f'{apart}, an atmosphere', _whose_reference(own, off > 0.0))
    elif gauge < LEAST_GAUGE_PRESSURE:
        yield warning(
            'reference_suspect',
            f'{name}: the pressure is mostly {gauge / 1e3:.4g} kPa gauge, below ambient, which no regulator holds',
            'check whether it was measured against ambient (`reference: gauge`), its unit, and the ambient pressure',
        )
    elif unusual := _of_level(name, 'pressure', own.pressure, ambient):
        yield from [*unusual, *_of_level(name, 'set-point', own.setpoint, ambient)]
    elif abs(off) > max(LARGEST_SETPOINT_ERROR, LARGEST_SETPOINT_ERROR_SHARE * gauge):
        whose = warning('setpoint_suspect', apart, _whose(name, own, cylinders, ambient))
        yield from _of_level(name, 'set-point', own.setpoint, ambient) or [whose]


def _whose_reference(own: CylinderSignals, is_above: bool) -> str:
    """Return which of a pressure and its set-point may have another reference than a mapping says."""
    assert own.setpoint is not None
    pair = ('pressure', own.pressure.reference), ('set-point', own.setpoint.reference)
    (higher, of_higher), (lower, of_lower) = pair if is_above else pair[::-1]
    may_be = []
    if of_higher != ABSOLUTE:
        may_be.append(f'the {higher} is absolute and said to be gauge')
    if of_lower != GAUGE:
        may_be.append(f'the {lower} is gauge and said to be absolute')
    return ', or '.join(may_be) or 'check the ambient pressure, and whether this is its set-point'


def _of_level(name: str, what: str, signal: Signal | None, ambient: float) -> list[Notice]:
    """Ask whether a pressure or a set-point, where there is one, lies where a regulator holds a cylinder."""
    if signal is None:
        return []
    gauge = float(np.median(_some(signal.values))) - ambient
    if GAUGE_PRESSURES[0] <= gauge <= GAUGE_PRESSURES[1]:
        return []
    return [
        warning(
            'unit_suspect',
            f'{name}: the {what} is mostly {gauge / 1e3:.4g} kPa gauge ({gauge / PSI:.3g} psi)',
            f'check the unit of the {what}' + in_other_units(gauge, GAUGE_PRESSURES, signal.unit, PRESSURES, _pressure),
        )
    ]


def _whose(name: str, own: CylinderSignals, cylinders: Mapping[str, CylinderSignals], ambient: float) -> str:
    """Return what a pressure off its set-point suggests: the other cylinder's."""
    assert own.setpoint is not None
    off = abs(_off(own.pressure, own.setpoint))
    for other, signals in cylinders.items():
        if other != name and signals.setpoint is not None and abs(_off(own.pressure, signals.setpoint)) < 0.5 * off:
            return f'it lies at that of {other}: check which set-point and which pressure is whose'
    likely = ' or '.join(_at_its_set_point(own, ambient))
    return 'check the units of both, and whether this is its set-point' + (f' (it is if {likely})' if likely else '')


def _at_its_set_point(own: CylinderSignals, ambient: float) -> Iterator[str]:
    """Yield in which other unit or reference a pressure would lie at its set-point, or the set-point at it."""
    assert own.setpoint is not None
    pair = {'pressure': own.pressure, 'set-point': own.setpoint}
    for what, signal in pair.items():
        for _, unit, reference, factor, shift in scales(signal, ambient):
            scaled = {**pair, what: replace(signal, values=factor * signal.values + shift)}
            gauge = float(np.median(_some(scaled[what].values))) - ambient
            is_usual = GAUGE_PRESSURES[0] <= gauge <= GAUGE_PRESSURES[1]
            if is_usual and abs(_off(*scaled.values())) < AT_SETPOINT_SHARE * gauge:
                yield f'the {what} is {reference} {unit}'


def scales(signal: Signal, ambient: float) -> Iterator[tuple[str, str, str, float, float]]:
    """
    Yield on which other scales a pressure may have been recorded.

    The reference that it is said to have (each where nobody says one), unit and reference that it may have, and factor
    and shift that make it of what was read [-, Pa].
    """
    zeros = {GAUGE: ambient, ABSOLUTE: 0.0}
    said = signal.unit or 'Pa'
    for reference in [signal.reference] if signal.reference else zeros:
        for unit, other in product(PRESSURES, zeros):
            factor = UNITS[unit].si / UNITS[said].si
            if (unit, other) != (said, reference):
                yield reference, unit, other, factor, zeros[other] - factor * zeros[reference]


def _assumptions(recording: Recording) -> Iterator[Notice]:
    if recording.rests:
        yield note(
            'displacement_assumed',
            'no displacement was recorded: a piston at rest is assumed',
            'record the displacement if it moves',
        )
    for name, own in recording.cylinders.items():
        if own.setpoint is None:
            yield note(
                'setpoint_assumed',
                f'{name}: no set-point was recorded: one that drifts evenly at most is assumed, and estimated',
                'record the set-point if it changes',
            )
    if len(recording.cylinders) == 1 and recording.force is not None:
        (name,) = recording.cylinders
        yield note(
            'cylinder_assumed',
            f'only {name} was recorded: against the force, ambient pressure is assumed on the other side',
        )


def _off(pressure: Signal, setpoint: Signal) -> float:
    """Return by how much a pressure is mostly above what its set-point was then [Pa]."""
    every = max(1, len(pressure) // MOST_INSPECTED_SAMPLES)
    held = np.searchsorted(setpoint.times, pressure.times[::every], side='right') - 1
    return float(np.median(pressure.values[::every] - setpoint.values[np.maximum(held, 0)]))


def _look_swapped(pressure: Signal, setpoint: Signal) -> bool:
    """Return whether what is said to be a pressure holds still like a set-point, and the reverse."""
    values = pressure.values[:MOST_INSPECTED_SAMPLES]
    if len(values) < 2 or len(setpoint) < 2:
        return False
    changes = float(np.mean(np.diff(values) != 0.0))
    moves = len(setpoint) / len(pressure)
    return changes < _STEADY and moves > max(_ALIVE, 2.0 * changes)


def _same(one: Signal, other: Signal) -> bool:
    """Return whether signals hold the same values, whenever they were."""
    return len(one) == len(other) and bool(
        np.allclose(one.values, other.values, rtol=LARGEST_DUPLICATE_DIFFERENCE, atol=0.0)
    )


def _some(values: Array) -> Array:
    """Return values evenly spread over a signal."""
    return values[:: max(1, len(values) // MOST_INSPECTED_SAMPLES)]


def _period(signal: Signal) -> float:
    """Return the usual interval [s], 0 of a single sample."""
    return float(np.median(np.diff(signal.times[:MOST_INSPECTED_SAMPLES]))) if len(signal) > 1 else 0.0


_SCALES = {
    'with a thousandth of it': 1e-3,
    'with a millionth of it': 1e-6,
    'with a thousand times it': 1e3,
    'with a million times it': 1e6,
}


def shown_length(metres: float) -> str:
    """Return a length [m] in a unit that suits it."""
    return f'{metres:.3g} m' if metres >= 1.0 else f'{1e3 * metres:.3g} mm'


def _pressure(pascals: float) -> str:
    return f'{1e-3 * pascals:.4g} kPa'


def in_other_units(
    value: float, usual: tuple[float, float], declared: str | None, names: Sequence[str], shown: Callable[[float], str]
) -> str:
    """Return what a value would be, were it recorded in another unit than is said, as far as that is usual."""
    said = UNITS[declared].si if declared else 1.0
    others = {f'if recorded in {name}': UNITS[name].si / said for name in names if name != declared}
    return _were_it(value, usual, others, shown)


def _were_it(
    value: float, usual: tuple[float, float], factors: Mapping[str, float], shown: Callable[[float], str]
) -> str:
    """Return what a value would be with other factors, the likeliest first, as far as that is usual."""
    low, high = usual
    fitting = {name: value * factor for name, factor in factors.items() if low <= value * factor <= high}
    likely = sorted(fitting, key=lambda name: abs(math.log(fitting[name] / math.sqrt(low * high))))[:MOST_GUESSES]
    each = ' or '.join(f'{shown(fitting[name])} {name}' for name in likely)
    return f' (it would be {each})' if each else ''
