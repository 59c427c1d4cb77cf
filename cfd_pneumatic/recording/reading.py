# SPDX-License-Identifier: Apache-2.0
"""Read recordings from bags and tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arguments import check_numbers, check_path, check_type
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS, PISTON_JOINT, ROLES
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.files import check_input
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.bags import Bag
from cfd_pneumatic.recording.cleaning import Cleaned, at_changes, clean, share_at_shared_times
from cfd_pneumatic.recording.dropouts import without_pulses
from cfd_pneumatic.recording.mapping import ChannelMapping, read_mapping
from cfd_pneumatic.recording.memory_maps import parts
from cfd_pneumatic.recording.message_texts import count_of
from cfd_pneumatic.recording.outliers import SCREENS, screened
from cfd_pneumatic.recording.recording import Recording
from cfd_pneumatic.recording.sampling import Defaults, read_samples
from cfd_pneumatic.recording.signals import ABSOLUTE, GAUGE, CylinderSignals, Signal
from cfd_pneumatic.recording.sources import OTHER, Samples, SignalSource
from cfd_pneumatic.recording.table import read_table
from cfd_pneumatic.recording.topics import convention_channels, resolve
from cfd_pneumatic.units import UNITS

FORCE_AXES = ('x', 'y', 'z')

_MISSING_SHARE, _MISSING_TIME = 0.1, 1.0
"""Part of a recording without samples of a signal that a note reports: more than this share and this time [s]."""

_SAMPLED = ('displacement', 'pressure', 'force')
"""Roles whose samples cover a whole recording."""

Paths = list[Path] | list[str] | tuple[Path | str, ...]
"""Several paths; not `Sequence`, since a string is a sequence, too."""


@overload
def read_recording(
    path: Path | str,
    *,
    mapping: ChannelMapping | Path | str | None = ...,
    namespace: str | None = ...,
    ambient_pressure: float = ...,
    joint: str = ...,
    force_axis: str = ...,
    folder: Path | str | None = ...,
) -> Recording: ...


@overload
def read_recording(
    path: Paths,
    *,
    mapping: ChannelMapping | Path | str | None = ...,
    namespace: str | None = ...,
    ambient_pressure: float = ...,
    joint: str = ...,
    force_axis: str = ...,
    folder: Path | str | None = ...,
) -> list[Recording]: ...


def read_recording(
    path: Path | str | Paths,
    *,
    mapping: ChannelMapping | Path | str | None = None,
    namespace: str | None = None,
    ambient_pressure: float = AMBIENT_PRESSURE,
    joint: str = PISTON_JOINT,
    force_axis: str = 'x',
    folder: Path | str | None = None,
) -> Recording | list[Recording]:
    """
    Read one or several bags or tables.

    Parameters
    ----------
    path : Path or str, or a sequence of them
        A ROS 2 bag (folder, .mcap or .db3 file), or a ROS 1 .bag file. With a mapping for tables, a table.
    mapping : ChannelMapping, Path or str, optional
        Mapping of the signals, or its file; by default the signals have the names of our convention.
    namespace : str, optional
        Namespace of the topics, also of relative topics in a mapping; needed if several namespaces follow our
        convention.
    ambient_pressure : float
        Absolute ambient pressure, which is added to gauge pressures [Pa].
    joint : str
        Name of the piston in a JointState.
    force_axis : str
        Axis of the force in a WrenchStamped: x, y or z.
    folder : Path or str, optional
        Folder for files with the signals of a bag, which save memory and vanish with the recording. By default only
        long recordings use files, in the system's temporary folder.

    Returns
    -------
    Recording, or a list of recordings if several paths are given
        Signals in SI units, each with separate sample times.

    Raises
    ------
    InputError
        If there is nothing to read, or the data are implausible. The message states what to do.

    """
    if isinstance(mapping, Path | str):
        mapping = read_mapping(mapping)
    check_type('mapping', mapping, (ChannelMapping, type(None)), 'a mapping file, or what read_mapping returns')
    check_type('path', path, (Iterable, Path), 'a path or a list of paths')
    check_numbers(ambient_pressure=ambient_pressure)
    check_type('namespace', namespace, (str, type(None)), 'a text')
    check_type('joint', joint, str, 'a text')
    if folder is not None:
        check_path('folder', folder)
    if not isinstance(path, Path | str):
        return [
            read_recording(
                single_path,
                mapping=mapping,
                namespace=namespace,
                ambient_pressure=ambient_pressure,
                joint=joint,
                force_axis=force_axis,
                folder=folder,
            )
            for single_path in path
        ]
    path = Path(path)
    if force_axis not in FORCE_AXES:
        raise InputError(f'the force has no axis {force_axis!r}: choose one of {", ".join(FORCE_AXES)}')
    try:
        if path.exists() and not path.is_dir():
            check_input(path)
        if mapping is not None and mapping.table is not None:
            samples, notes = read_table(path, mapping.table, mapping.channels)
        else:
            defaults = Defaults(joint, force_axis)
            samples, notes = _read_bag(path, mapping, namespace, defaults, None if folder is None else Path(folder))
        return _assemble(path.resolve().name, samples, notes, ambient_pressure)
    except InputError as error:
        raise InputError(f'{path}: {error}') from error


def _read_bag(
    path: Path, mapping: ChannelMapping | None, namespace: str | None, defaults: Defaults, folder: Path | None
) -> tuple[list[Samples], list[str]]:
    with Bag(path) as bag:
        if mapping is None:
            channels = convention_channels(bag.topics, namespace)
            channels = [replace(channel, table=bag.remarks.get(str(channel.source), '')) for channel in channels]
        else:
            channels = [
                replace(channel, source=resolve(namespace, str(channel.source))) for channel in mapping.channels
            ]
        types = mapping.types if mapping else None
        try:
            samples, notes = read_samples(bag, _preferred(channels), types, defaults, folder)
        except InputError as error:
            raise InputError('; '.join([str(error), *bag.notes])) from error
        return samples, bag.notes + notes


def _preferred(channels: Sequence[SignalSource]) -> list[SignalSource]:
    """Return the channels without the set-points of cylinders that have an applied set-point."""
    applied = {channel.cylinder for channel in channels if channel.role == 'setpoint_applied'}
    return [channel for channel in channels if channel.role != 'setpoint' or channel.cylinder not in applied]


def _assemble(name: str, samples: Sequence[Samples], notes: Sequence[str], ambient_pressure: float) -> Recording:
    """Make a recording of the samples of one pressure or more; without a displacement the piston is at rest."""
    units = {(raw.channel.role, raw.channel.cylinder): _unit_and_reference(raw.channel) for raw in samples}
    shared = max(share_at_shared_times(raw.times, raw.raw) for raw in samples if raw.channel.role in _SAMPLED)
    cleaned = {(raw.channel.role, raw.channel.cylinder): _clean(raw, ambient_pressure) for raw in samples}
    epoch = min(int(clean_samples.times[0]) for clean_samples in cleaned.values())
    short = _short_signals(cleaned, epoch)

    def signal(role: str, cylinder: str | None = None) -> Signal | None:
        clean_samples = cleaned.get((role, cylinder))
        if clean_samples is None:
            return None
        return Signal(_seconds_since(epoch, clean_samples.times), clean_samples.values, *units[role, cylinder])

    cylinders = {}
    for cylinder in CYLINDERS:
        pressure = signal('pressure', cylinder)
        if pressure is not None:
            setpoint = signal('setpoint_applied', cylinder) or signal('setpoint', cylinder)
            cylinders[cylinder] = CylinderSignals(pressure, setpoint)
    measured = signal('displacement')
    displacement = _at_rest(cylinders) if measured is None else measured
    _check_overlap(displacement, cylinders)
    health = [*notes, *(note for clean_samples in cleaned.values() for note in clean_samples.notes), *short]
    attributes = {field.name for field in fields(Recording)}
    further_signals = {
        str(name_or_cylinder if role == OTHER else role): Signal(_seconds_since(epoch, found.times), found.values)
        for (role, name_or_cylinder), found in cleaned.items()
        if role == OTHER or (role in ROLES and not ROLES[role].of_cylinder and role not in attributes)
    }
    return Recording(
        name=printable(name),
        epoch=epoch,
        displacement=displacement,
        cylinders=cylinders,
        force=signal('force'),
        health=tuple(map(printable, health)),
        others=further_signals,
        rests=measured is None,
        shared_times=shared,
    )


def _unit_and_reference(channel: SignalSource) -> tuple[str | None, str | None]:
    """Return the unit and the reference of a signal according to a mapping; None for each that is not given."""
    unit, _, reference = channel.table.partition(' ')
    if unit in UNITS:  # the bag was made from a table
        return unit, reference if reference in (GAUGE, ABSOLUTE) else None
    if channel.unit is None or UNITS[channel.unit].quantity != 'pressure':
        return channel.unit, None
    return channel.unit, GAUGE if channel.gauge else ABSOLUTE


def _at_rest(cylinders: Mapping[str, CylinderSignals]) -> Signal:
    """Return the displacement of a piston that rests at zero, at the times of the longest pressure."""
    pressures = (cylinder.pressure for cylinder in cylinders.values())
    longest = max(pressures, key=lambda signal: float(np.ptp(signal.times)))
    return Signal(longest.times, np.zeros(len(longest)))


def _seconds_since(epoch: int, times: NDArray[np.int64]) -> Array:
    """Convert times [ns] to seconds since an epoch, in the same memory."""
    seconds = times.view(np.float64)
    for part in parts(times):
        seconds[part] = (times[part] - epoch) / NANOSECONDS
    return seconds


def _clean(samples: Samples, ambient_pressure: float) -> Cleaned:
    channel, values = samples.channel, samples.raw
    for part in parts(values):
        values[part] = channel.si(values[part], ambient_pressure)
    if channel.role in ROLES and ROLES[channel.role].held:
        return _without_pulses(at_changes(clean(samples.times, values, channel.name, held=True)), channel.name)
    cleaned = clean(samples.times, values, channel.name)
    if channel.role in SCREENS:
        return screened(cleaned, channel.role, channel.name)
    if channel.role == 'setpoint_applied':
        return _without_pulses(at_changes(_from_previous(cleaned)), channel.name)
    return cleaned


def _without_pulses(changes: Cleaned, name: str) -> Cleaned:
    kept = without_pulses(changes.times, changes.values)
    number = (len(kept) - int(np.count_nonzero(kept))) // 2
    if not number:
        return changes
    note = f'{name}: left out {count_of(number, "change")} taken back within 0.02 s: look at the plug and the logger'
    return Cleaned(changes.times[kept], changes.values[kept], (*changes.notes, note))


def _from_previous(applied: Cleaned) -> Cleaned:
    """Convert set-points that acted up to their times to set-points that act from their times on."""
    if len(applied.times) == 1:
        return applied
    return Cleaned(applied.times[:-1], applied.values[1:], applied.notes)


def _short_signals(cleaned: Mapping[tuple[str, str | None], Cleaned], epoch: int) -> list[str]:
    """Return notes on signals that begin later or end earlier than the recording."""
    spans = {
        ' '.join(filter(None, (cylinder, role))): tuple((found.times[[0, -1]] - epoch) / NANOSECONDS)
        for (role, cylinder), found in cleaned.items()
        if role in _SAMPLED
    }
    first, last = (choose(limits) for choose, limits in zip((min, max), zip(*spans.values())))
    return [
        f'{name}: samples from {begin:.4g} to {end:.4g} s only, the recording is from {first:.4g} to {last:.4g} s: '
        'check its sensor and its source'
        for name, (begin, end) in spans.items()
        if last - first - (end - begin) > max(_MISSING_SHARE * (last - first), _MISSING_TIME)
    ]


def _check_overlap(displacement: Signal, cylinders: dict[str, CylinderSignals]) -> None:
    for cylinder, signals in cylinders.items():
        times = signals.pressure.times
        if times[0] > displacement.times[-1] or displacement.times[0] > times[-1]:
            raise InputError(
                f'the displacement ({_span(displacement)}) and the {cylinder} pressure ({_span(signals.pressure)}) '
                'have no time in common: if their clocks differ, give `stamp: receive` in a mapping file'
            )


def _span(signal: Signal) -> str:
    return f'{signal.times[0]:.3f} to {signal.times[-1]:.3f} s'
