# SPDX-License-Identifier: Apache-2.0
"""
Report likely input errors that a result shows: implausible parameters, or a different device.

Expensive checks run only if a cheap check finds an implausible value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from cfd_pneumatic.arrays import rms
from cfd_pneumatic.identification.channels import Force
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.identification.input_checks.alternative_readings import (
    alternative_scales,
    check_scales,
    force_error_share,
)
from cfd_pneumatic.identification.input_checks.recordings import (
    LENGTHS,
    check_recordings,
    format_length,
    in_other_units_text,
)
from cfd_pneumatic.identification.input_checks.thresholds import (
    ATMOSPHERE_TOLERANCE,
    BORES,
    CHAMBER_LENGTHS,
    FEWEST_COMPARED_RECORDINGS,
    LARGEST_AREA_RATIO,
    LEAST_DIVISOR,
    LEAST_ERROR_RATIO,
    LEAST_FORCE_ERROR_CHANGE,
    LEAST_STROKE_SHARE,
    SMALL_CHAMBER,
    SMALL_STROKE,
    USUAL_CHAMBERS,
)
from cfd_pneumatic.identification.residual import sample_noise
from cfd_pneumatic.identification.result import ChannelResult
from cfd_pneumatic.notices import Notice, any_warning, note, warning
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.runtime import map_in_threads
from cfd_pneumatic.units import INCH, UNITS

_MISREAD = ('sign_suspect', 'cylinders_swapped')
_LAG = 'displacement_lag'  # its parameter is a time, as that of a delay


def check_results(
    recordings: Sequence[Recording], results: Mapping[str, ChannelResult], options: Options, seen: Sequence[Notice] = ()
) -> tuple[Notice, ...]:
    """
    Return warnings about likely input errors of recordings and results, and notes about assumptions.

    `seen` has the notices from before the search for effects.
    """
    found = [*check_recordings(recordings, options)]
    has_wrong_unit = any(notice.code == 'unit_suspect' for notice in found)
    cylinders = {name: result for name, result in results.items() if not isinstance(result.channel, Force)}
    pressures = cylinders.values()
    forces = [result for result in results.values() if isinstance(result.channel, Force)]
    # A misread pressure does not determine the chamber.
    if not any_warning(found) and not any(notice.code in _MISREAD for notice in seen):
        found += [notice for result in pressures for notice in _check_chamber(result, recordings, options)]
    if not has_wrong_unit:  # a wrong unit makes signs and levels look wrong, too
        found += seen
    if not any_warning(found):
        readings = map_in_threads(lambda result: [*check_scales(result, recordings, options)], pressures)
        found += chain.from_iterable(readings)
    if not any_warning(found):
        found += [
            notice for result in cylinders.values() for notice in _check_long_chamber(result, recordings, options)
        ]
    if not any_warning(found):
        found += [
            notice for result in results.values() if result.conclusion for notice in _check_outlier_recording(result)
        ]
    if not any_warning(found):
        found += [notice for result in pressures for notice in _check_lag(result, forces, recordings, options)]
    if not any_warning(found):
        found += _note_chamber_lengths(cylinders, recordings, options)
    found += [notice for result in pressures for notice in _note_drift(result)]
    found += [notice for result in forces for notice in _check_force(result, recordings, options)]
    return tuple(found)


def _note_drift(result: ChannelResult) -> Iterator[Notice]:
    """Note the drift rates of set-points that were not recorded."""
    drifting = [experiment.index for experiment in result.experiments if experiment.drifts]
    if drifting:
        rates = result.found.model.recording_values[drifting, result.channel.recording_parameters.index('drift')]
        shown = ' to '.join(dict.fromkeys(f'{rate:.2g}' for rate in (np.min(rates), np.max(rates))))
        yield note('setpoint_drifts', f'{result.name}: the assumed set-point drifts by {shown} Pa/s')


def _check_chamber(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Warn if no cylinder has a chamber of the identified length."""
    chamber = _pressure_and_sensitivity(result)
    if chamber is None:
        return
    pressure, sensitivity = chamber
    displacement = recordings[0].displacement
    length = pressure / sensitivity
    if not CHAMBER_LENGTHS[0] <= length <= CHAMBER_LENGTHS[1]:
        yield warning(
            'unit_suspect',
            f'{result.name}: the data imply a chamber {format_length(length)} long, which no cylinder has (k_x of '
            f'{sensitivity:.3g} Pa/m at {1e-3 * pressure:.4g} kPa)',
            'check the units of pressure and displacement'
            + in_other_units_text(
                length,
                CHAMBER_LENGTHS,
                displacement.unit,
                LENGTHS,
                format_length,
                'the chamber',
                'the displacement was recorded',
            )
            + ''.join(
                f'; {format_length(scale.chamber)} if the pressures are {scale.likely}'
                for scale in alternative_scales(result, recordings, options.ambient_pressure)
            ),
        )
        return
    stroke = float(np.ptp(displacement.values))
    if length < SMALL_CHAMBER and stroke < SMALL_STROKE:
        yield warning(
            'unit_suspect',
            f'{result.name}: the piston moves {format_length(stroke)} in a chamber {format_length(length)} long',
            'check the units of pressure and displacement'
            + in_other_units_text(
                stroke, (SMALL_STROKE, CHAMBER_LENGTHS[1]), displacement.unit, LENGTHS, format_length
            ),
        )


def _check_long_chamber(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Warn if a chamber is long for its stroke, and usual with another unit or reference of the pressures."""
    chamber = _pressure_and_sensitivity(result)
    if chamber is None:
        return
    length, stroke = chamber[0] / chamber[1], float(np.ptp(recordings[0].displacement.values))
    if length > USUAL_CHAMBERS[1] and stroke < LEAST_STROKE_SHARE * length:
        usual = [*_usual_chambers(result, recordings, options)]
        if usual:
            yield warning(
                'unit_suspect',
                f'{result.name}: the piston moves {format_length(stroke)} in a chamber {format_length(length)} long',
                f'check unit and reference of the pressures: the length would be {" or ".join(usual)}. If both are '
                'right, the pneumatic line is long',
            )


def _usual_chambers(
    result: ChannelResult, recordings: Sequence[Recording], options: Options, *, in_other_units: bool = True
) -> Iterator[str]:
    """Yield the usual chamber lengths that other units or references of the pressures give, as texts."""
    signals = map(result.channel.signal, recordings)
    signal = next(signal for signal in signals if signal is not None)
    for scale in alternative_scales(result, recordings, options.ambient_pressure):
        is_candidate = in_other_units or (signal.reference is not None and 'unit' not in scale.entries)
        if is_candidate and USUAL_CHAMBERS[0] <= scale.chamber <= USUAL_CHAMBERS[1]:
            yield f'{format_length(scale.chamber)} if the pressures are {scale.likely}'


def _usual_lengths(
    length: float, usual: tuple[float, float], declared: str | None, condition: str, *, power: float = 1.0
) -> Iterator[str]:
    """Yield the usual lengths that other units of a signal give, as texts; the length is a power of the signal."""
    if declared is None:
        return
    for name, unit in UNITS.items():
        converted = length * (unit.si / UNITS[declared].si) ** power
        if name != declared and unit.quantity == UNITS[declared].quantity and usual[0] <= converted <= usual[1]:
            yield f'{format_length(converted)} if {condition} in {name}'


def _pressure_and_sensitivity(result: ChannelResult) -> tuple[float, float] | None:
    """Return the median pressure and `k_x` [Pa, Pa/m]; None if `k_x` is not identifiable."""
    # An unknown curve may contain a part of k_x.
    gains = () if result.conclusion and result.conclusion.unknown else result.gains[:1]
    estimates = [estimate.value for estimate in (*gains, result.fit.estimates[0]) if estimate.value is not None]
    pressure = float(np.median(np.concatenate([experiment.measured for experiment in result.experiments])))
    return (pressure, estimates[0]) if estimates else None


def _note_chamber_lengths(
    cylinders: Mapping[str, ChannelResult], recordings: Sequence[Recording], options: Options
) -> Iterator[Notice]:
    """
    Note the lengths of the chambers, for comparison with the drawing.

    For an unusual length the note lists the units and references that give a usual length. For a usual length the note
    has the length with the other reference.
    """
    lengths: list[str] = []
    alternatives: list[str] = []
    for name, result in cylinders.items():
        chamber = _pressure_and_sensitivity(result)
        if chamber is None:
            continue
        length = chamber[0] / chamber[1]
        lengths.append(f'{format_length(length)} ({name})')
        if not alternatives:
            is_usual = USUAL_CHAMBERS[0] <= length <= USUAL_CHAMBERS[1]
            alternatives = [
                *_usual_chambers(result, recordings, options, in_other_units=not is_usual),
                *_usual_lengths(length, USUAL_CHAMBERS, recordings[0].displacement.unit, 'the displacement is'),
            ]
    if lengths:
        hint = f'; the length would be {", ".join(alternatives)}' if alternatives else ''
        yield note(
            'chamber_told',
            f'the pressures imply a chamber {" and ".join(lengths)} long, including its line',
            f'compare with the drawing{hint}',
        )


def _check_lag(
    result: ChannelResult, forces: Sequence[ChannelResult], recordings: Sequence[Recording], options: Options
) -> Iterator[Notice]:
    """Warn if the displacement lags the pressure, and use the force to find the cause."""
    for name in result.found.model.effects:
        late_signal = 'displacement' if name == _LAG else result.channel.effects[name].late
        if late_signal in ('', 'setpoint'):
            continue
        size = result.found.model.effects[name][0]
        estimate = next(iter(result.parameters(name).values()))
        _, high = estimate.interval or (size, size)  # no interval if the search ends at a bound
        is_negative_delay, lag = late_signal == 'reading', abs(size)
        is_significant = high < 0.0 if is_negative_delay else estimate.value is not None
        if not is_significant:
            continue
        message = f'{result.name}: the displacement lags the pressure by {1e3 * lag:.3g} ms'
        if is_negative_delay:
            message = f'{result.name}: the pressure leads the displacement: its delay is {-1e3 * lag:.3g} ms'
        ratios = [
            force_error_share(recordings, force, options, -lag) / force_error_share(recordings, force, options)
            for force in forces
        ]
        yield warning('size_suspect', message, _lag_advice(*ratios))


def _lag_advice(ratio: float = 1.0) -> str:
    """Return what to inspect if the displacement lags, from the error ratio of the force (shifted / as recorded)."""
    sensor, dynamics = 'the filter and the clock of the displacement sensor', 'dynamics that the model lacks'
    if ratio > 1.0 + LEAST_FORCE_ERROR_CHANGE:
        evidence = f'without the lag the error of the force grows to {100.0 * ratio:.0f} %'
        return f'the lag comes from {dynamics}: {evidence}'
    if ratio < 1.0 - LEAST_FORCE_ERROR_CHANGE:
        return f'inspect {sensor}: without the lag the error of the force falls to {100.0 * ratio:.0f} %'
    return f'inspect {sensor}; if both are in order, the lag comes from {dynamics}'


def _check_outlier_recording(result: ChannelResult) -> Iterator[Notice]:
    """Warn if one of several recordings may be of another device: its error is several times the usual error."""
    noises = [
        max(sample_noise(comparison.times, comparison.experiment.measured), LEAST_DIVISOR)
        for comparison in result.comparisons
    ]
    errors = [
        rms(comparison.residual(1)[comparison.experiment.settled]) / noise
        for comparison, noise in zip(result.comparisons, noises)
    ]
    usual = float(np.median(errors))
    for comparison, error in zip(result.comparisons, errors):
        if len(errors) >= FEWEST_COMPARED_RECORDINGS and error > LEAST_ERROR_RATIO * max(usual, 1.0):
            yield warning(
                'recording_differs',
                f'{comparison.name}, {result.name}: the error is {error:.3g} times the noise of its samples, and '
                f'{usual:.3g} times in the other recordings',
                'the device, the supply or the task differs: identify this recording separately',
            )


def _check_force(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Note the area of the piston, and warn if the area or the offset of the force is implausible."""
    channel = result.channel
    assert isinstance(channel, Force)
    area = float(result.found.model.parameters[0])
    bore = 2.0 * math.sqrt(area / math.pi)
    estimate = result.found.estimates[0]
    size = f'{1e6 * area:.4g} mm^2, a bore of {1e3 * bore:.3g} mm ({bore / INCH:.3g} inch)'
    direct = channel.estimated_area(result.experiments)
    if options.area is not None and not 1.0 / LARGEST_AREA_RATIO < direct / options.area < LARGEST_AREA_RATIO:
        yield warning(
            'area_suspect',
            f'force and pressures determine an area of {1e6 * direct:.4g} mm^2, and the given area is '
            f'{1e6 * options.area:.4g} mm^2',
            'check the area, and the units of force and pressure',
        )
    code = 'area_held' if estimate.reason else 'area_told'
    (declared_unit, *_) = (signal.unit for signal in map(channel.signal, recordings) if signal is not None)
    alternatives = _usual_lengths(bore, BORES, declared_unit, 'the force is', power=0.5)
    fix = 'compare with the drawing' + ''.join(f'; the bore would be {text}' for text in alternatives)
    yield note(code, f'the force implies a piston of {size}', fix)
    if not BORES[0] <= bore <= BORES[1]:
        yield warning('unit_suspect', f'the force implies a piston of {size}', 'check the units of force and pressure')
    offset = result.found.model.effects.get('force_offset')
    if offset is not None and abs(abs(offset[0]) / area - options.ambient_pressure) < (
        ATMOSPHERE_TOLERANCE * options.ambient_pressure
    ):
        yield warning(
            'ambient_suspect',
            f'the force has an offset of {offset[0]:.3g} N, which equals ambient pressure on the piston',
            'check the references: a gauge pressure may be read as absolute, or the reverse',
        )
