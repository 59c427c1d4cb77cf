# SPDX-License-Identifier: Apache-2.0
"""
Describe a recording for people, and report likely input errors.

The ranges are those of a pneumatic force device on a robot's hand, with a wide margin. A value outside of a range most
likely has a wrong unit, a wrong reference or a wrong column.
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
    check_clipping,
    check_frozen_pressure,
    check_leaps,
    check_range_limit,
    check_setpoint_noise,
    check_shifts,
    check_stuck_sensor,
    check_two_sources,
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

_MOST_STEPS, _FEWEST_CHANGES = 0.05, 0.5  # of a set-point and of a pressure [share of the samples]


def describe(recording: Recording, ambient_pressure: float) -> list[str]:
    """Return a line for each signal, in units for people: range, median and sampling."""
    lines = []
    for role, cylinder, signal in recording.signals():
        name = role if cylinder is None else f'{cylinder} {role}'
        values = _thinned_values(signal.values)
        low, high, middle = float(np.min(values)), float(np.max(values)), float(np.median(values))
        if role == 'displacement':
            text = f'{1e3 * low:.4g} to {1e3 * high:.4g} mm'
        elif role in ('pressure', 'setpoint'):
            low, high, middle = (1e-3 * (value - ambient_pressure) for value in (low, high, middle))
            psi = 1e3 / PSI
            text = f'{low:.4g} to {high:.4g} kPa gauge ({psi * low:.3g} to {psi * high:.3g} psi), median {middle:.4g}'
        else:
            text = f'{low:.4g} to {high:.4g}' + (' N' if role == 'force' else '')
        lines.append(f'{name}: {text}; {_describe_sampling(role, signal)}')
    return lines


def _describe_sampling(role: str, signal: Signal) -> str:
    if role == 'setpoint':
        return count_of(len(signal) - 1, 'change')
    period = _median_interval(signal)
    rate = f' at {1.0 / period:.4g} Hz' if period else ''
    return f'{count_of(len(signal), "sample")}{rate} in {float(np.ptp(signal.times)):.4g} s'


def check_recordings(recordings: Sequence[Recording], options: Options) -> tuple[Notice, ...]:
    """Return warnings about likely input errors of recordings, and notes about assumptions."""
    notices = (notice for recording in recordings for notice in check_recording(recording, options.ambient_pressure))
    return (*dict.fromkeys(notices), *_check_duplicates(recordings))


def check_recording(recording: Recording, ambient_pressure: float) -> list[Notice]:
    """Return warnings about likely input errors of a recording, and notes about assumptions."""
    found = (
        [] if recording.rests else [*check_motion(recording.displacement), *check_range_limit(recording.displacement)]
    )
    for role, cylinder, signal in recording.signals():
        found += [
            *check_leaps(role, cylinder, signal),
            *check_shifts(role, cylinder, signal),
            *check_two_sources(role, cylinder, signal),
        ]
    found += [] if recording.rests else check_stuck_sensor('displacement', recording.displacement)
    found += [] if recording.force is None else check_stuck_sensor('force', recording.force)
    for name, cylinder_signals in recording.cylinders.items():
        found += check_frozen_pressure(name, cylinder_signals.pressure, recording.displacement, least=STROKES[0])
        found += _check_sensing(name, cylinder_signals, recording)
    for name, cylinder_signals in recording.cylinders.items():
        found += _check_pressure_level(name, cylinder_signals, recording.cylinders, ambient_pressure)
    return [*found, *_check_shared_times(recording), *_assumptions(recording)]


def hides_effects(recording: Recording) -> bool:
    """Return whether a wrong unit, a clipped pressure or a noisy set-point hides the effects of a device."""
    return any(notice.code == 'unit_suspect' for notice in check_motion(recording.displacement)) or any(
        any(_check_sensing(name, signals, recording)) for name, signals in recording.cylinders.items()
    )


def _check_sensing(name: str, signals: CylinderSignals, recording: Recording) -> Iterator[Notice]:
    if not recording.rests:
        yield from check_clipping(name, signals.pressure, signals.setpoint, recording.displacement)
    if signals.setpoint is not None:
        yield from check_setpoint_noise(name, signals.setpoint, signals.pressure)


def _check_duplicates(recordings: Sequence[Recording]) -> Iterator[Notice]:
    """Warn about recordings with equal data."""
    for index, recording in enumerate(recordings):
        for earlier in recordings[:index]:
            (role, _, signal), (_, _, earlier_signal) = (next(piece.signals()) for piece in (recording, earlier))
            if _have_equal_values(signal, earlier_signal):
                yield warning(
                    'duplicate_recording',
                    f'{recording.name} and {earlier.name} contain the same {role}',
                    'remove a copy: duplicated data make standard errors too small',
                )


def _check_shared_times(recording: Recording) -> Iterator[Notice]:
    if recording.shared_times > LARGEST_SHARED_TIMES:
        yield warning(
            'times_suspect',
            f'{100.0 * recording.shared_times:.0f} % of the samples were ignored because their time equals that of '
            'another sample: the times have too few digits',
            'record the times with more digits, or give the sample period in the mapping file',
        )


def check_motion(displacement: Signal) -> Iterator[Notice]:
    """Warn about likely input errors of a displacement and its times."""
    stroke, period = float(np.ptp(_thinned_values(displacement.values))), _median_interval(displacement)
    if stroke > STROKES[1] or 0.0 < stroke < STROKES[0]:
        yield warning(
            'unit_suspect',
            f'the piston moves {format_length(stroke)}',
            'check the unit of the displacement'
            + in_other_units_text(stroke, STROKES, displacement.unit, LENGTHS, format_length),
        )
    if period and not PERIODS[0] <= period <= PERIODS[1]:
        yield warning(
            'unit_suspect',
            f'the samples are {period:.3g} s apart, {float(np.ptp(displacement.times)):.4g} s in total',
            'check the unit of the time'
            + _usual_multiples(period, PERIODS, _TIME_FACTORS, lambda value: f'{value:.3g} s'),
        )
    intervals = np.diff(displacement.times[:MOST_INSPECTED_SAMPLES])
    intervals = intervals[intervals < LONGEST_BATCH_INTERVAL]
    if intervals.size >= FEWEST_INTERVALS and np.mean(intervals < LARGEST_BATCH_SHARE * np.mean(intervals)) > 0.5:
        yield warning(
            'times_suspect',
            f'most samples are {1e3 * float(np.median(intervals)):.3g} ms apart, on average '
            f'{1e3 * float(np.mean(intervals)):.3g} ms: the samples were stamped in batches',
            'record the time at which each sample was taken, or give the sample period in the mapping file',
        )
    values = displacement.values[:MOST_INSPECTED_SAMPLES]
    values = np.clip(values, *np.percentile(values, (1.0, 99.0)))  # single outliers are no sign of a low rate
    spread = float(np.std(values))
    if spread and float(np.sqrt(np.mean(np.diff(values) ** 2))) > LARGEST_ROUGHNESS * spread:
        yield warning(
            'sampling_slow',
            f'the displacement jumps between samples, every {period:.3g} s: it is sampled too slowly',
            'sample ten times as fast, or move the piston more slowly',
        )


def _check_pressure_level(
    name: str, signals: CylinderSignals, cylinders: Mapping[str, CylinderSignals], ambient: float
) -> Iterator[Notice]:
    gauge = float(np.median(_thinned_values(signals.pressure.values))) - ambient
    offset = 0.0 if signals.setpoint is None else _median_offset(signals.pressure, signals.setpoint)
    message = (
        f'{name}: the pressure is {abs(offset) / 1e3:.4g} kPa {"above" if offset > 0.0 else "below"} its set-point'
    )
    if signals.setpoint is not None and _are_swapped(signals.pressure, signals.setpoint):
        yield warning(
            'setpoint_suspect',
            f'{name}: the pressure changes in steps, and the set-point changes at every sample',
            'swap pressure and set-point',
        )
    elif abs(abs(offset) - ambient) < ATMOSPHERE_TOLERANCE * ambient and gauge < GAUGE_PRESSURES[1]:
        yield warning('reference_suspect', f'{message}, an atmosphere', _likely_reference_error(signals, offset > 0.0))
    elif gauge < LEAST_GAUGE_PRESSURE:
        yield warning(
            'reference_suspect',
            f'{name}: the pressure is mostly {gauge / 1e3:.4g} kPa gauge, below ambient, which no regulator holds',
            'check whether it was measured against ambient (`reference: gauge`), its unit, and the ambient pressure',
        )
    elif unusual := _check_usual_level(name, 'pressure', signals.pressure, ambient):
        yield from [*unusual, *_check_usual_level(name, 'set-point', signals.setpoint, ambient)]
    elif abs(offset) > max(LARGEST_SETPOINT_ERROR, LARGEST_SETPOINT_ERROR_SHARE * gauge):
        mismatch = warning('setpoint_suspect', message, _likely_setpoint_error(name, signals, cylinders, ambient))
        yield from _check_usual_level(name, 'set-point', signals.setpoint, ambient) or [mismatch]


def _likely_reference_error(signals: CylinderSignals, is_above: bool) -> str:
    """Return whether the pressure or its set-point may have a wrong reference in the mapping."""
    assert signals.setpoint is not None
    pair = ('pressure', signals.pressure.reference), ('set-point', signals.setpoint.reference)
    (higher, higher_reference), (lower, lower_reference) = pair if is_above else pair[::-1]
    causes = []
    if higher_reference != ABSOLUTE:
        causes.append(f'the {higher} may be absolute and is read as gauge')
    if lower_reference != GAUGE:
        causes.append(f'the {lower} may be gauge and is read as absolute')
    return ', or '.join(causes) or 'check the ambient pressure, and whether this is its set-point'


def _check_usual_level(name: str, signal_name: str, signal: Signal | None, ambient: float) -> list[Notice]:
    """Warn if the median of a pressure or set-point is outside of the usual gauge pressures."""
    if signal is None:
        return []
    gauge = float(np.median(_thinned_values(signal.values))) - ambient
    if GAUGE_PRESSURES[0] <= gauge <= GAUGE_PRESSURES[1]:
        return []
    return [
        warning(
            'unit_suspect',
            f'{name}: the {signal_name} is mostly {gauge / 1e3:.4g} kPa gauge ({gauge / PSI:.3g} psi)',
            f'check the unit of the {signal_name}'
            + in_other_units_text(gauge, GAUGE_PRESSURES, signal.unit, PRESSURES, _format_pressure),
        )
    ]


def _likely_setpoint_error(
    name: str, signals: CylinderSignals, cylinders: Mapping[str, CylinderSignals], ambient: float
) -> str:
    """Return a likely reason why a pressure is far from its set-point: swapped set-points, a unit or a reference."""
    assert signals.setpoint is not None
    pressure = signals.pressure
    offset = abs(_median_offset(pressure, signals.setpoint))
    for opposite_name, opposite in cylinders.items():
        if (
            opposite_name != name
            and opposite.setpoint is not None
            and abs(_median_offset(pressure, opposite.setpoint)) < 0.5 * offset
        ):
            return f'it is near the set-point of {opposite_name}: check which set-point belongs to which pressure'
    likely = ' or '.join(_agreeing_scales(signals, ambient))
    return 'check the units of both, and whether this is its set-point' + (f' (it is if {likely})' if likely else '')


def _agreeing_scales(signals: CylinderSignals, ambient: float) -> Iterator[str]:
    """Yield units and references with which a pressure and its set-point agree."""
    assert signals.setpoint is not None
    pair = {'pressure': signals.pressure, 'set-point': signals.setpoint}
    for signal_name, signal in pair.items():
        for _, unit, reference, factor, shift in scales(signal, ambient):
            scaled = {**pair, signal_name: replace(signal, values=factor * signal.values + shift)}
            gauge = float(np.median(_thinned_values(scaled[signal_name].values))) - ambient
            is_usual = GAUGE_PRESSURES[0] <= gauge <= GAUGE_PRESSURES[1]
            if is_usual and abs(_median_offset(*scaled.values())) < AT_SETPOINT_SHARE * gauge:
                yield f'the {signal_name} is {reference} {unit}'


def scales(signal: Signal, ambient: float) -> Iterator[tuple[str, str, str, float, float]]:
    """
    Yield the scales on which a pressure may have been recorded instead of the declared scale.

    Each scale has the declared reference, another unit and reference, and the factor and shift that convert the
    pressure as read [-, Pa]. Both references are tried as the declared reference if none is declared.
    """
    zeros = {GAUGE: ambient, ABSOLUTE: 0.0}
    declared_unit = signal.unit or 'Pa'
    for declared_reference in [signal.reference] if signal.reference else zeros:
        for unit, reference in product(PRESSURES, zeros):
            factor = UNITS[unit].si / UNITS[declared_unit].si
            if (unit, reference) != (declared_unit, declared_reference):
                shift = zeros[reference] - factor * zeros[declared_reference]
                yield declared_reference, unit, reference, factor, shift


def _assumptions(recording: Recording) -> Iterator[Notice]:
    if recording.rests:
        yield note(
            'displacement_assumed',
            'no displacement was recorded: a piston at rest is assumed',
            'record the displacement if the piston moves',
        )
    for name, signals in recording.cylinders.items():
        if signals.setpoint is None:
            yield note(
                'setpoint_assumed',
                f'{name}: no set-point was recorded: a constant or evenly drifting set-point is assumed and estimated',
                'record the set-point if it changes',
            )
    if len(recording.cylinders) == 1 and recording.force is not None:
        (name,) = recording.cylinders
        yield note(
            'cylinder_assumed',
            f'only {name} was recorded: the force model assumes ambient pressure in the opposite cylinder',
        )


def _median_offset(pressure: Signal, setpoint: Signal) -> float:
    """Return the median of a pressure minus the set-point at the same time [Pa]."""
    stride = max(1, len(pressure) // MOST_INSPECTED_SAMPLES)
    index = np.searchsorted(setpoint.times, pressure.times[::stride], side='right') - 1
    return float(np.median(pressure.values[::stride] - setpoint.values[np.maximum(index, 0)]))


def _are_swapped(pressure: Signal, setpoint: Signal) -> bool:
    """Return whether a pressure is constant like a set-point, and its set-point changes like a pressure."""
    values = pressure.values[:MOST_INSPECTED_SAMPLES]
    if len(values) < 2 or len(setpoint) < 2:
        return False
    changes = float(np.mean(np.diff(values) != 0.0))
    setpoint_changes = len(setpoint) / len(pressure)
    return changes < _MOST_STEPS and setpoint_changes > max(_FEWEST_CHANGES, 2.0 * changes)


def _have_equal_values(first: Signal, second: Signal) -> bool:
    """Return whether two signals have equal values, at any times."""
    return len(first) == len(second) and bool(
        np.allclose(first.values, second.values, rtol=LARGEST_DUPLICATE_DIFFERENCE, atol=0.0)
    )


def _thinned_values(values: Array) -> Array:
    """Return values evenly spread over a signal, fewer than twice `MOST_INSPECTED_SAMPLES`."""
    return values[:: max(1, len(values) // MOST_INSPECTED_SAMPLES)]


def _median_interval(signal: Signal) -> float:
    """Return the median interval between samples [s]; 0 for a single sample."""
    return float(np.median(np.diff(signal.times[:MOST_INSPECTED_SAMPLES]))) if len(signal) > 1 else 0.0


_TIME_FACTORS = {
    'if divided by 1000': 1e-3,
    'if divided by 1 000 000': 1e-6,
    'if multiplied by 1000': 1e3,
    'if multiplied by 1 000 000': 1e6,
}


def format_length(metres: float) -> str:
    """Return a length [m] as text in metres or millimetres."""
    return f'{metres:.3g} m' if metres >= 1.0 else f'{1e3 * metres:.3g} mm'


def _format_pressure(pascals: float) -> str:
    return f'{1e-3 * pascals:.4g} kPa'


def in_other_units_text(
    value: float,
    usual: tuple[float, float],
    declared: str | None,
    names: Sequence[str],
    format_value: Callable[[float], str],
    subject: str = 'it',
    recorded: str = 'recorded',
) -> str:
    """
    Return the value in those other units in which the value is usual, as text in brackets.

    `subject` is what has the value, `recorded` the part of the condition that names the recorded signal.
    """
    declared_si = UNITS[declared].si if declared else 1.0
    factors = {f'if {recorded} in {name}': UNITS[name].si / declared_si for name in names if name != declared}
    return _usual_multiples(value, usual, factors, format_value, subject)


def _usual_multiples(
    value: float,
    usual: tuple[float, float],
    factors: Mapping[str, float],
    format_value: Callable[[float], str],
    subject: str = 'it',
) -> str:
    """Return the value with those factors that make the value usual, the likeliest first, as text in brackets."""
    low, high = usual
    scaled = {name: value * factor for name, factor in factors.items() if low <= value * factor <= high}
    likely = sorted(scaled, key=lambda name: abs(math.log(scaled[name] / math.sqrt(low * high))))[:MOST_GUESSES]
    alternatives = ' or '.join(f'{format_value(scaled[name])} {name}' for name in likely)
    return f' ({subject} would be {alternatives})' if alternatives else ''
