# SPDX-License-Identifier: Apache-2.0
"""
Which mistakes a result looks like: parameters that no device has, a device that changed, an area that can't be.

A check looks closer only where something is odd.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.identification.channels import Force
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.identification.input_checks.alternative_readings import (
    alternative_scales,
    force_error_share,
    pressure_readings,
)
from cfd_pneumatic.identification.input_checks.recordings import LENGTHS, check_recordings, in_other_units, shown_length
from cfd_pneumatic.identification.input_checks.thresholds import (
    ATMOSPHERE_TOLERANCE,
    BORES,
    CHAMBER_LENGTHS,
    ERROR_PIECES,
    FEWEST_COMPARED_RECORDINGS,
    FEWEST_PIECE_SAMPLES,
    LARGEST_AREA_RATIO,
    LEAST_CHANGED_ERROR,
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
_LAG = 'displacement_lag'  # as good as a delay


def check_results(
    recordings: Sequence[Recording], results: Mapping[str, ChannelResult], options: Options, seen: Sequence[Notice] = ()
) -> tuple[Notice, ...]:
    """
    Return which mistakes recordings, and what was identified of them, look like; and what was assumed.

    What was `seen` before effects were searched for is not looked for again.
    """
    found = [*check_recordings(recordings, options)]
    odd = any(one.code == 'unit_suspect' for one in found)
    cylinders = {name: one for name, one in results.items() if not isinstance(one.channel, Force)}
    forces = [one for one in results.values() if isinstance(one.channel, Force)]
    if not any_warning(found) and not any(one.code in _MISREAD for one in seen):  # or the chamber is anything
        found += [notice for one in cylinders.values() for notice in _of_chamber(one, recordings, options)]
    if not odd:  # in a wrong unit signs and levels look wrong, too
        found += seen
    if not any_warning(found):
        others = map_in_threads(lambda one: [*pressure_readings(one, recordings, options)], cylinders.values())
        found += chain.from_iterable(others)
    if not any_warning(found):
        found += [notice for one in cylinders.values() for notice in _of_long_chamber(one, recordings, options)]
    if not any_warning(found):
        found += [notice for one in results.values() if one.conclusion for notice in _of_a_stranger(one)]
    if not any_warning(found):
        found += [notice for one in results.values() for notice in _of_changes(one)]
        found += [notice for one in cylinders.values() for notice in _of_delay(one, forces, recordings, options)]
    if not any_warning(found):
        found += _of_chambers(cylinders, recordings, options)
    found += [notice for one in cylinders.values() for notice in _of_drift(one)]
    found += [notice for one in forces for notice in _of_force(one, recordings, options)]
    return tuple(found)


def _of_drift(result: ChannelResult) -> Iterator[Notice]:
    """Say by how much the set-points drift that nobody recorded."""
    drifting = [one.index for one in result.experiments if one.drifts]
    if drifting:
        rates = result.found.model.recording_values[drifting, result.channel.recording_parameters.index('drift')]
        shown = ' to '.join(dict.fromkeys(f'{rate:.2g}' for rate in (np.min(rates), np.max(rates))))
        yield note('setpoint_drifts', f'{result.name}: the set-point that was not recorded drifts by {shown} Pa/s')


def _of_chamber(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Ask whether the chamber has a size that a cylinder may have."""
    told = _chamber(result)
    if told is None:
        return
    pressure, sensitivity = told
    displacement = recordings[0].displacement
    length = pressure / sensitivity
    if not CHAMBER_LENGTHS[0] <= length <= CHAMBER_LENGTHS[1]:
        yield warning(
            'unit_suspect',
            f'{result.name}: k_x of {sensitivity:.3g} Pa/m at {1e-3 * pressure:.4g} kPa is that of a chamber '
            f'{shown_length(length)} long',
            'check the units of pressure and displacement'
            + in_other_units(length, CHAMBER_LENGTHS, displacement.unit, LENGTHS, shown_length)
            + ''.join(
                f'; {shown_length(scale.chamber)} if the pressures are {scale.true}'
                for scale in alternative_scales(result, recordings, options.ambient_pressure)
            ),
        )
        return
    stroke = float(np.ptp(displacement.values))
    if length < SMALL_CHAMBER and stroke < SMALL_STROKE:
        yield warning(
            'unit_suspect',
            f'{result.name}: the piston moves {shown_length(stroke)} in a chamber {shown_length(length)} long',
            'check the units of pressure and displacement'
            + in_other_units(stroke, (SMALL_STROKE, CHAMBER_LENGTHS[1]), displacement.unit, LENGTHS, shown_length),
        )


def _of_long_chamber(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Ask whether a chamber is long for its stroke, and usual with other pressures, of which nothing else tells."""
    told = _chamber(result)
    if told is None:
        return
    length, stroke = told[0] / told[1], float(np.ptp(recordings[0].displacement.values))
    if length > USUAL_CHAMBERS[1] and stroke < LEAST_STROKE_SHARE * length:
        usual = [*_usual_chambers(result, recordings, options)]
        if usual:
            yield warning(
                'unit_suspect',
                f'{result.name}: the piston moves {shown_length(stroke)} in a chamber {shown_length(length)} long',
                f'check unit and reference of the pressures: it would be {" or ".join(usual)}; if they are right its '
                'line is long',
            )


def _usual_chambers(
    result: ChannelResult, recordings: Sequence[Recording], options: Options, *, in_other_units: bool = True
) -> Iterator[str]:
    """Yield how long the chamber would be in units and references of pressures that make it a usual one."""
    own = next(signal for one in recordings if (signal := result.channel.signal(one)) is not None)
    for scale in alternative_scales(result, recordings, options.ambient_pressure):
        is_meant = in_other_units or (own.reference is not None and 'unit' not in scale.entries)
        if is_meant and USUAL_CHAMBERS[0] <= scale.chamber <= USUAL_CHAMBERS[1]:
            yield f'{shown_length(scale.chamber)} if the pressures are {scale.true}'


def _in_other_units(
    length: float, usual: tuple[float, float], said: str | None, what: str, *, power: float = 1.0
) -> Iterator[str]:
    """Yield which usual length it would be if what goes into it, to a power, were in another unit than is said."""
    if said is None:
        return
    for name, unit in UNITS.items():
        other = length * (unit.si / UNITS[said].si) ** power
        if name != said and unit.quantity == UNITS[said].quantity and usual[0] <= other <= usual[1]:
            yield f'{shown_length(other)} if {what} in {name}'


def _chamber(result: ChannelResult) -> tuple[float, float] | None:
    """Return the usual pressure and `k_x` [Pa, Pa/m]; None where that is not told."""
    gains = () if result.conclusion and result.conclusion.unknown else result.gains[:1]  # a law may have a part
    told = [one.value for one in (*gains, result.fit.estimates[0]) if one.value is not None]
    pressure = float(np.median(np.concatenate([one.measured for one in result.experiments])))
    return (pressure, told[0]) if told else None


def _of_chambers(
    cylinders: Mapping[str, ChannelResult], recordings: Sequence[Recording], options: Options
) -> Iterator[Notice]:
    """
    Say how long the chambers are, which only the drawing tells better.

    Of an unusual one it is said in which units and references it would be usual; of a usual one, how long it would be
    with the other reference.
    """
    lengths: list[str] = []
    instead: list[str] = []
    for name, one in cylinders.items():
        told = _chamber(one)
        if told is None:
            continue
        length = told[0] / told[1]
        lengths.append(f'{shown_length(length)} ({name})')
        if not instead:
            is_usual = USUAL_CHAMBERS[0] <= length <= USUAL_CHAMBERS[1]
            instead = [
                *_usual_chambers(one, recordings, options, in_other_units=not is_usual),
                *_in_other_units(length, USUAL_CHAMBERS, recordings[0].displacement.unit, 'the displacement is'),
            ]
    if lengths:
        also = f'; it would be {", ".join(instead)}' if instead else ''
        yield note(
            'chamber_told',
            f'the pressures go with a chamber {" and ".join(lengths)} long, its line counted in',
            f'check that against the drawing{also}',
        )


def _of_delay(
    result: ChannelResult, forces: Sequence[ChannelResult], recordings: Sequence[Recording], options: Options
) -> Iterator[Notice]:
    """Ask whether the pressure comes before the piston, or the displacement late, and what the force says of it."""
    for name in result.found.model.effects:
        what = 'displacement' if name == _LAG else result.channel.effects[name].late
        if not what:
            continue
        size = result.found.model.effects[name][0]
        estimate = next(iter(result.parameters(name).values()))
        _, high = estimate.interval or (size, size)  # none where the search ends at a bound
        early, late = what == 'reading', abs(size)
        is_told = high < 0.0 if early else estimate.value is not None
        if not is_told:
            continue
        message = f'{result.name}: the displacement seems to come {1e3 * late:.3g} ms late'
        if early:
            message = f'{result.name}: a delay of {-1e3 * late:.3g} ms has the pressure come before the piston'
        ratios = [
            force_error_share(recordings, force, options, -late) / force_error_share(recordings, force, options)
            for force in forces
        ]
        yield warning('size_suspect', message, _of_late_displacement(*ratios))


def _of_late_displacement(ratio: float = 1.0) -> str:
    """Return what to look at where a displacement seems late, by the force's error with it moved over that without."""
    sensor, dynamics = "the filter and the clock of the displacement's sensor", 'dynamics that the model lacks'
    if ratio > 1.0 + LEAST_FORCE_ERROR_CHANGE:
        against = f'moving the displacement by it makes the error of the force grow to {100.0 * ratio:.0f} %'
        return f'the delay stands for {dynamics}: {against}'
    if ratio < 1.0 - LEAST_FORCE_ERROR_CHANGE:
        return f'look at {sensor}: moving the displacement by it lowers the error of the force to {100.0 * ratio:.0f} %'
    return f'look at {sensor}; or the delay stands for {dynamics}'


def _of_changes(result: ChannelResult) -> Iterator[Notice]:
    """Ask whether the error, as a share of what moves, is several times as large from some time on, or up to it."""
    for one in result.comparisons:
        settled = np.flatnonzero(one.experiment.settled)
        if settled.size < ERROR_PIECES * FEWEST_PIECE_SAMPLES:
            continue
        pieces = np.array_split(settled, ERROR_PIECES)
        errors = np.array([rms(one.residual(1)[piece]) for piece in pieces])
        spreads = [float(np.std(one.experiment.measured[piece])) for piece in pieces]
        shares = errors / np.maximum(spreads, LEAST_DIVISOR)
        ratio, cut = max((_ratio(shares, cut), cut) for cut in range(1, ERROR_PIECES))
        before, after = (float(np.median(some)) for some in (errors[:cut], errors[cut:]))
        if ratio > LEAST_ERROR_RATIO and max(before, after) > LEAST_CHANGED_ERROR * result.noise.std:
            small, when = result.quantity.small, float(one.times[pieces[cut][0]])
            yield warning(
                'changed_during_recording',
                f'{one.name}, {result.name}: the error is {before / small.si:.3g} {small.unit} before t = {when:.1f} s '
                f'and {after / small.si:.3g} {small.unit} after it',
                'something changed there, the device or its work: identify the two pieces on their own',
            )


def _of_a_stranger(result: ChannelResult) -> Iterator[Notice]:
    """Ask whether one recording of several is of another device, once the loop was closed: one core may not fit all."""
    noises = [max(sample_noise(one.times, one.experiment.measured), LEAST_DIVISOR) for one in result.comparisons]
    errors = [rms(one.residual(1)[one.experiment.settled]) / noise for one, noise in zip(result.comparisons, noises)]
    usual = float(np.median(errors))
    for one, error in zip(result.comparisons, errors):
        if len(errors) >= FEWEST_COMPARED_RECORDINGS and error > LEAST_ERROR_RATIO * max(usual, 1.0):
            yield warning(
                'recording_differs',
                f'{one.name}, {result.name}: the error is {error:.3g} times the noise of its samples, and {usual:.3g} '
                'times in the other recordings',
                'another device, supply or work: identify it on its own, and the others without it',
            )


def _ratio(shares: Array, cut: int) -> float:
    """Return how many times the largest on one side of a cut the median of the other is."""
    sides = shares[:cut], shares[cut:]
    return max(float(np.median(one)) / float(np.max(other)) for one, other in (sides, sides[::-1]))


def _of_force(result: ChannelResult, recordings: Sequence[Recording], options: Options) -> Iterator[Notice]:
    """Ask whether area and offset are what a piston and a gauge have."""
    channel = result.channel
    assert isinstance(channel, Force)
    area = float(result.found.model.parameters[0])
    bore = 2.0 * math.sqrt(area / math.pi)
    told = result.found.estimates[0]
    size = f'{1e6 * area:.4g} mm^2, a bore of {1e3 * bore:.3g} mm ({bore / INCH:.3g} inch)'
    direct = channel.estimated_area(result.experiments)
    if options.area is not None and not 1.0 / LARGEST_AREA_RATIO < direct / options.area < LARGEST_AREA_RATIO:
        yield warning(
            'area_suspect',
            f'force and pressures make {1e6 * direct:.4g} mm^2 of a piston said to have {1e6 * options.area:.4g} mm^2',
            'check the area, and the units of force and pressure',
        )
    code = 'area_held' if told.reason else 'area_told'
    (said, *_) = (own.unit for one in recordings if (own := channel.signal(one)) is not None)
    instead = _in_other_units(bore, BORES, said, 'the force is', power=0.5)
    fix = 'check that against the drawing' + ''.join(f'; the bore would be {one}' for one in instead)
    yield note(code, f'the force goes with a piston of {size}', fix)
    if not BORES[0] <= bore <= BORES[1]:
        yield warning('unit_suspect', f'the force makes a piston of {size}', 'check the units of force and pressure')
    offset = result.found.model.effects.get('force_offset')
    if offset is not None and abs(abs(offset[0]) / area - options.ambient_pressure) < (
        ATMOSPHERE_TOLERANCE * options.ambient_pressure
    ):
        yield warning(
            'ambient_suspect',
            f'the force is off by {offset[0]:.3g} N, which is ambient pressure on the piston',
            'one pressure is gauge and said to be absolute, or the reverse',
        )
