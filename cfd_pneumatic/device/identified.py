# SPDX-License-Identifier: Apache-2.0
"""Make a device from an identification, with notes about its parameters."""

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
_OF_TIME = "depends on the time since the recording's begin, or the node's start: set false if the node runs for hours"
_HEADROOM = 1.2  # times the highest set-point

Values = dict[str, Value]
Notes = dict[str, str]
Row = tuple[float, ...]


def identified_device(identification: Identification) -> Device:
    """
    Return the device that reproduces the reported simulation.

    Gains that are not identifiable have the values assumed in the fit, because the other gains depend on these values;
    notes name such gains. In a table of operating points a gain that is not identifiable at a set-point has its value
    at the nearest set-point with an identifiable gain. Set-points and offsets are means over the recordings. A cylinder
    that was not recorded is disabled, as in the fit of the force. The area is given if it was identified, assumed or
    given.
    """
    values: Values = {'ambient_pressure': identification.ambient_pressure}
    notes: Notes = {}
    for name in CYLINDERS:
        if name in identification.cylinders:
            _add_cylinder(identification, identification.cylinders[name], values, notes)
        else:
            values[f'{name}.enabled'] = False
            notes[f'{name}.enabled'] = 'its pressure was not recorded: ambient pressure is used instead'
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
            noise = max(experiment.motion.noise for experiment in force.experiments)
            values[f'{CONTACT_FORCE}.seal_play'] = min(_SEAL_PLAY * noise, _LARGEST_SEAL_PLAY)
            notes[f'{CONTACT_FORCE}.seal_play'] = "three standard deviations of the displacement's noise"
        _add_effects(CONTACT_FORCE, effects, FORCE_PARTS, values, notes)
    _hold_within_ranges(values, notes)
    return Device(values, notes)


def estimated_setpoints(identification: Identification) -> list[dict[str, float]]:
    """Return the estimated gauge set-points of cylinders without a recorded set-point, for each recording [Pa]."""
    setpoints: list[dict[str, float]] = [{} for _ in identification.recordings]
    for name, comparison, level in _estimated_levels(identification):
        setpoints[comparison.recording][name] = float(np.mean(level))
    return setpoints


def identified_recordings(identification: Identification) -> tuple[Recording, ...]:
    """
    Return the recordings with which the device reproduces the errors of the report.

    Sensor ripple is removed from the displacement. Estimated set-points, with their drift, replace set-points that were
    not recorded.
    """
    recordings = list(identification.without_waves)
    for name, comparison, level in _estimated_levels(identification):
        index = comparison.recording
        signals = recordings[index].cylinders
        pressure = signals[name].pressure
        setpoint = Signal(comparison.stamps(pressure), level + identification.ambient_pressure)
        cylinders = {**signals, name: CylinderSignals(pressure, setpoint)}
        recordings[index] = replace(recordings[index], cylinders=cylinders)
    return tuple(recordings)


def _estimated_levels(identification: Identification) -> Iterator[tuple[str, Comparison, Array]]:
    """Yield each estimated set-point: cylinder, recording, and gauge level at the samples [Pa]."""
    for name, result in identification.cylinders.items():
        levels = result.channel.levels(result.experiments, result.found.model)
        for comparison, level in zip(result.comparisons, levels):
            if identification.recordings[comparison.recording].cylinders[name].setpoint is None:
                yield name, comparison, level


def _add_geometry(identification: Identification, values: Values, notes: Notes) -> None:
    """Add the known ones of area and geometric factor; the force is their product times the pressure."""
    geometry = identification.geometry
    if geometry.area is not None:
        values['area'] = geometry.area
    if geometry.note is not None:
        notes['area'] = geometry.note
    if geometry.factor is not None:
        values['geometric_factor'] = geometry.factor


def _add_range(identification: Identification, values: Values) -> None:
    """Add the range of the recordings."""
    identified = IdentifiedRange.of_recordings(identification.recordings, identification.ambient_pressure)
    if identified.displacement is not None and identified.speed is not None:
        values['identified_displacement'] = identified.displacement
        values['identified_speed'] = identified.speed
    for name in identification.cylinders:
        values[f'{name}.identified_pressures'] = identified.pressures[name]
        if name in identified.setpoints:
            values[f'{name}.identified_setpoints'] = identified.setpoints[name]


def _add_cylinder(identification: Identification, result: ChannelResult, values: Values, notes: Notes) -> None:
    effects = result.found.model.parts
    setpoints, rows = _fitted_with_effects(result) if effects else _scheduled(result)
    offset = _offset(identification, result)
    values[f'{result.name}.initial_setpoint'] = setpoints[0] - offset
    values[f'{result.name}.setpoint_offset'] = offset
    values[f'{result.name}.setpoints'] = setpoints
    for spec in SPECS:
        row, note = rows[spec.name]
        values[f'{result.name}.{spec.name}'] = tuple(_within(value, spec.lower, spec.upper) for value in row)
        if note:
            notes[f'{result.name}.{spec.name}'] = note
    not_identifiable = tuple(spec.name for spec in SPECS if rows[spec.name][1])
    if not_identifiable:
        values[f'{result.name}.not_identifiable'] = not_identifiable
    _add_effects(result.name, effects, PRESSURE_PARTS, values, notes)


def _offset(identification: Identification, result: ChannelResult) -> float:
    """Return the mean of pressure at rest minus recorded set-point [Pa]; 0 if no set-point was recorded."""
    offsets = result.found.model.recording_values[:, 0].tolist()
    recorded = [
        offset
        for comparison, offset in zip(result.comparisons, offsets)
        if identification.recordings[comparison.recording].cylinders[result.name].setpoint is not None
    ]
    return float(np.mean(recorded)) if recorded else 0.0


def _scheduled(result: ChannelResult) -> tuple[Row, dict[str, tuple[Row, str]]]:
    """Return the set-points, and the gains at each set-point with a note."""
    points, rows = result.schedule, {}
    for rank, spec in enumerate(SPECS):
        used = [float(point.fit.model.parameters[rank]) for point in points]
        estimates = [point.fit.estimates[rank] for point in points]
        missing = [f'{point.setpoint:.1f}' for point, estimate in zip(points, estimates) if not estimate.identifiable]
        note = ''
        if len(missing) == len(points):
            note = _note_of(estimates[0])
        elif missing:
            note = f'not identifiable at {", ".join(missing)} Pa: the value at the nearest set-point is used'
        rows[spec.name] = _from_nearest(used, estimates), note
    return tuple(point.setpoint for point in points), rows


def _fitted_with_effects(result: ChannelResult) -> tuple[Row, dict[str, tuple[Row, str]]]:
    """Return the mean set-point, and the gains that were fitted together with effects, with a note."""
    found = result.found
    level = float(np.mean(np.concatenate(result.channel.levels(result.experiments, found.model))))
    gains = zip(SPECS, found.model.parameters.tolist(), found.estimates)
    return (level,), {spec.name: ((value,), _note_of(estimate)) for spec, value, estimate in gains}


def _note_of(estimate: Estimate) -> str:
    return '' if estimate.identifiable else f'not identifiable, value assumed in the fit: {estimate.reason}'


def _from_nearest(used: Sequence[float], estimates: Sequence[Estimate]) -> Row:
    """Return values with each that is not identifiable replaced by the nearest identifiable value, if any."""
    identifiable = (index for index, estimate in enumerate(estimates) if estimate.identifiable)
    known = np.array([*identifiable], dtype=np.intp)
    if not known.size:
        return tuple(used)
    return tuple(used[int(known[np.argmin(np.abs(known - index))])] for index in range(len(used)))


def _add_effects(
    prefix: str, effects: Mapping[str, Sequence[float]], library: Mapping[str, Effect], values: Values, notes: Notes
) -> None:
    for name, parameters in effects.items():
        values[f'{prefix}.{name}.enabled'] = True
        if library[name].of_time:
            notes[f'{prefix}.{name}.enabled'] = _OF_TIME
        for parameter, value in zip(library[name].parameters, parameters):
            values[f'{prefix}.{name}.{parameter.name}'] = _within(value, parameter.lower, parameter.upper)


def _hold_within_ranges(values: Values, notes: Notes) -> None:
    """Limit implausible values to their range, so that misread recordings still give a report."""
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = _within(value, DESCRIPTORS[name].lower, DESCRIPTORS[name].upper)
            if values[name] != value:
                notes[name] = f'limited to the range of devices: {value:g} was identified; report.json has a warning'


def _within(value: float, lower: float, upper: float) -> float:
    """Return a value limited to bounds; a search in logarithms may exceed them by a rounding error."""
    return min(max(float(value), lower), upper)
