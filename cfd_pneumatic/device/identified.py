# SPDX-License-Identifier: Apache-2.0
"""The device that an identification found, with what is to be said of its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS, SUPPLY_PRESSURE
from cfd_pneumatic.device.descriptors import DESCRIPTORS, Value
from cfd_pneumatic.device.device import Device
from cfd_pneumatic.device.identified_range import IdentifiedRange
from cfd_pneumatic.identification import ChannelResult, Comparison, Estimate, Identification
from cfd_pneumatic.model import FORCE_PARTS, PRESSURE_PARTS, SPECS, Effect
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

_SEAL_PLAY = 3.0  # standard deviations of the displacement's noise
_LARGEST_SEAL_PLAY = 1e-3  # [m]
_OF_TIME = "counts from the recording's begin, and in a node from its start: false where that runs for hours"
_HEADROOM = 1.2  # times the highest set-point

Values = dict[str, Value]
Notes = dict[str, str]
Row = tuple[float, ...]


def identified_device(identification: Identification) -> Device:
    """
    Return the device that simulates what was reported.

    Gains are as the fit used them, also where they are not identifiable: only together with the others do they simulate
    what was reported; the notes say which. In a table of operating points one that is identifiable at some set-points
    only is held from the nearest of those. A set-point, or the offset of a recorded one, that differs from recording to
    recording is the mean. A cylinder that was not recorded is switched off: the force was made without it. The area is
    there whenever it was identified, held or given.
    """
    values: Values = {'ambient_pressure': identification.ambient_pressure}
    notes: Notes = {}
    for name in CYLINDERS:
        if name in identification.cylinders:
            _add_cylinder(identification, identification.cylinders[name], values, notes)
        else:
            values[f'{name}.enabled'] = False
            notes[f'{name}.enabled'] = 'its pressure was not recorded: ambient pressure takes its place'
    highest = max(point.setpoint for result in identification.cylinders.values() for point in result.schedule)
    if highest > SUPPLY_PRESSURE:
        values['supply_pressure'] = _HEADROOM * highest
        notes['supply_pressure'] = 'gauge; not measured, leaves room for set-points'
    _add_geometry(identification, values, notes)
    _add_range(identification, values)
    force = identification.channels.get('force')
    if force is not None and force.found.model.effects:
        effects = force.found.model.effects
        if any(FORCE_PARTS[name].states for name in effects):
            noise = max(one.motion.noise for one in force.experiments)
            values[f'{CONTACT_FORCE}.seal_play'] = min(_SEAL_PLAY * noise, _LARGEST_SEAL_PLAY)
            notes[f'{CONTACT_FORCE}.seal_play'] = "three standard deviations of the displacement's noise"
        _add_effects(CONTACT_FORCE, effects, FORCE_PARTS, values, notes)
    _hold_within_ranges(values, notes)
    return Device(values, notes)


def estimated_setpoints(identification: Identification) -> list[dict[str, float]]:
    """Return the set-points that were not recorded and so estimated, for each recording by cylinder, gauge [Pa]."""
    found: list[dict[str, float]] = [{} for _ in identification.recordings]
    for name, one, level in _estimated(identification):
        found[one.recording][name] = float(np.mean(level))
    return found


def identified_recordings(identification: Identification) -> tuple[Recording, ...]:
    """
    Return the recordings as they were identified, which the device simulates with the errors of the report.

    They have no waves of the displacement that no pressure follows, and the set-points that were estimated where none
    were recorded, with their drift.
    """
    found = list(identification.without_waves)
    for name, one, level in _estimated(identification):
        signals = found[one.recording].cylinders
        pressure = signals[name].pressure
        setpoint = Signal(one.stamps(pressure), level + identification.ambient_pressure)
        cylinders = {**signals, name: CylinderSignals(pressure, setpoint)}
        found[one.recording] = replace(found[one.recording], cylinders=cylinders)
    return tuple(found)


def _estimated(identification: Identification) -> Iterator[tuple[str, Comparison, Array]]:
    """Yield set-points that were not recorded: of which cylinder, in which recording, gauge at its samples [Pa]."""
    for name, result in identification.cylinders.items():
        levels = result.channel.levels(result.experiments, result.found.model)
        for one, level in zip(result.comparisons, levels):
            if identification.recordings[one.recording].cylinders[name].setpoint is None:
                yield name, one, level


def _add_geometry(identification: Identification, values: Values, notes: Notes) -> None:
    """Add area and geometric factor, as far as they are known: the force is their product times the pressure."""
    geometry = identification.geometry
    if geometry.area is not None:
        values['area'] = geometry.area
    if geometry.note is not None:
        notes['area'] = geometry.note
    if geometry.factor is not None:
        values['geometric_factor'] = geometry.factor


def _add_range(identification: Identification, values: Values) -> None:
    """Add within what was identified."""
    found = IdentifiedRange.of_recordings(identification.recordings, identification.ambient_pressure)
    if found.displacement is not None and found.speed is not None:
        values['identified_displacement'] = found.displacement
        values['identified_speed'] = found.speed
    for name in identification.cylinders:
        values[f'{name}.identified_pressures'] = found.pressures[name]
        if name in found.setpoints:
            values[f'{name}.identified_setpoints'] = found.setpoints[name]


def _add_cylinder(identification: Identification, result: ChannelResult, values: Values, notes: Notes) -> None:
    effects = result.found.model.parts
    setpoints, rows = _beside_effects(result) if effects else _scheduled(result)
    offset = _offset(identification, result)
    values[f'{result.name}.initial_setpoint'] = setpoints[0] - offset
    values[f'{result.name}.setpoint_offset'] = offset
    values[f'{result.name}.setpoints'] = setpoints
    for spec in SPECS:
        row, note = rows[spec.name]
        values[f'{result.name}.{spec.name}'] = tuple(_within(value, spec.lower, spec.upper) for value in row)
        if note:
            notes[f'{result.name}.{spec.name}'] = note
    doubtful = tuple(spec.name for spec in SPECS if rows[spec.name][1])
    if doubtful:
        values[f'{result.name}.not_identifiable'] = doubtful
    _add_effects(result.name, effects, PRESSURE_PARTS, values, notes)


def _offset(identification: Identification, result: ChannelResult) -> float:
    """Return by how much pressures at rest lie above the set-points that were recorded, 0 where none was [Pa]."""
    offsets = result.found.model.recording_values[:, 0].tolist()
    recorded = [
        offset
        for one, offset in zip(result.comparisons, offsets)
        if identification.recordings[one.recording].cylinders[result.name].setpoint is not None
    ]
    return float(np.mean(recorded)) if recorded else 0.0


def _scheduled(result: ChannelResult) -> tuple[Row, dict[str, tuple[Row, str]]]:
    """Return the set-points, and the gains at each with what is to be said of them."""
    points, rows = result.schedule, {}
    for rank, spec in enumerate(SPECS):
        used = [float(point.fit.model.parameters[rank]) for point in points]
        estimates = [point.fit.estimates[rank] for point in points]
        doubtful = [f'{point.setpoint:.1f}' for point, one in zip(points, estimates) if not one.identifiable]
        note = ''
        if len(doubtful) == len(points):
            note = _as_used(estimates[0])
        elif doubtful:
            note = f'not identifiable and held from the nearest at {", ".join(doubtful)} Pa'
        rows[spec.name] = _held(used, estimates), note
    return tuple(point.setpoint for point in points), rows


def _beside_effects(result: ChannelResult) -> tuple[Row, dict[str, tuple[Row, str]]]:
    """Return one set-point, and the gains that were fitted beside effects, the same at every set-point."""
    found = result.found
    level = float(np.mean(np.concatenate(result.channel.levels(result.experiments, found.model))))
    gains = zip(SPECS, found.model.parameters.tolist(), found.estimates)
    return (level,), {spec.name: ((value,), _as_used(estimate)) for spec, value, estimate in gains}


def _as_used(estimate: Estimate) -> str:
    return '' if estimate.identifiable else f'not identifiable, as the fit used it: {estimate.reason}'


def _held(used: Sequence[float], estimates: Sequence[Estimate]) -> Row:
    """Return values with those that are not identifiable taken from the nearest that is, if there is one."""
    known = np.array([index for index, one in enumerate(estimates) if one.identifiable], dtype=np.intp)
    if not known.size:
        return tuple(used)
    return tuple(used[int(known[np.argmin(np.abs(known - index))])] for index in range(len(used)))


def _add_effects(
    prefix: str, effects: Mapping[str, Sequence[float]], library: Mapping[str, Effect], values: Values, notes: Notes
) -> None:
    for name, own in effects.items():
        values[f'{prefix}.{name}.enabled'] = True
        if library[name].of_time:
            notes[f'{prefix}.{name}.enabled'] = _OF_TIME
        for parameter, value in zip(library[name].parameters, own):
            values[f'{prefix}.{name}.{parameter.name}'] = _within(value, parameter.lower, parameter.upper)


def _hold_within_ranges(values: Values, notes: Notes) -> None:
    """Hold at its bound what no device has, lest a report of data that were read wrongly come to nothing."""
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = _within(value, DESCRIPTORS[name].lower, DESCRIPTORS[name].upper)
            if values[name] != value:
                notes[name] = f'held here: {value:g} was found, which no device has; report.json has a warning'


def _within(value: float, lower: float, upper: float) -> float:
    """Return a value within bounds: a search in logarithms may end a rounding error beyond them."""
    return min(max(float(value), lower), upper)
