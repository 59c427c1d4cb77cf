"""Reading a recording, from whatever it is in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS, PISTON_JOINT
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bag import Bag
from cfd_pneumatic.recording.cleaning import Cleaned, at_changes, clean
from cfd_pneumatic.recording.mapping import ChannelMapping
from cfd_pneumatic.recording.memory_maps import parts
from cfd_pneumatic.recording.messages import NANOSECONDS
from cfd_pneumatic.recording.sampling import Defaults, read_samples
from cfd_pneumatic.recording.signals import CylinderSignals, Recording, Signal
from cfd_pneumatic.recording.sources import Role, Samples, SignalSource
from cfd_pneumatic.recording.table import read_table
from cfd_pneumatic.recording.topics import convention_channels, resolve

FORCE_AXES = ('x', 'y', 'z')


def read_recording(
    path: Path | str,
    *,
    mapping: ChannelMapping | None = None,
    namespace: str | None = None,
    ambient_pressure: float = AMBIENT_PRESSURE,
    joint: str = PISTON_JOINT,
    force_axis: str = 'x',
    folder: Path | str | None = None,
) -> Recording:
    """
    Read a bag or a table.

    Parameters
    ----------
    path : Path or str
        A ROS 2 bag (its folder, or a .mcap or .db3 file), a ROS 1 .bag file, or with a mapping that says so a table.
    mapping : ChannelMapping, optional
        Where the signals are; by default they are at the names of our convention.
    namespace : str, optional
        Namespace of the topics; needed where several hold our convention's topics. Relative topics of a mapping are in
        it.
    ambient_pressure : float
        What gauge pressures are above, absolute [Pa].
    joint : str
        Name of the piston in a JointState.
    force_axis : str
        Axis of the force in a WrenchStamped: x, y or z.
    folder : Path or str, optional
        Folder for files to keep the signals of a bag in, so that they need no memory. They vanish with the recording.
        By default a long recording's are in the system's temporary folder.

    Returns
    -------
    Recording
        All that was found, in SI units, each signal on its own times.

    Raises
    ------
    InputError
        If there is nothing to read or it can't be meant: the message says what to do.

    """
    path = Path(path)
    if force_axis not in FORCE_AXES:
        raise InputError(f'the force has no axis {force_axis!r}: choose one of {", ".join(FORCE_AXES)}')
    try:
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
    """Leave out the set-points of cylinders whose applied set-point is there."""
    applied = {channel.cylinder for channel in channels if channel.role == 'setpoint_applied'}
    return [channel for channel in channels if channel.role != 'setpoint' or channel.cylinder not in applied]


def _assemble(name: str, samples: Sequence[Samples], notes: Sequence[str], ambient_pressure: float) -> Recording:
    """Make a recording of samples, at least of the displacement and of one pressure."""
    cleaned = {(one.channel.role, one.channel.cylinder): _clean(one, ambient_pressure) for one in samples}
    epoch = min(int(one.times[0]) for one in cleaned.values())

    def signal(role: Role, cylinder: str | None = None) -> Signal | None:
        found = cleaned.get((role, cylinder))
        return None if found is None else Signal(_seconds_since(epoch, found.times), found.values)

    cylinders = {}
    for cylinder in CYLINDERS:
        pressure = signal('pressure', cylinder)
        if pressure is not None:
            setpoint = signal('setpoint_applied', cylinder) or signal('setpoint', cylinder)
            cylinders[cylinder] = CylinderSignals(pressure, setpoint)
    displacement = signal('displacement')
    assert displacement is not None
    _check_overlap(displacement, cylinders)
    health = [*notes, *(note for one in cleaned.values() for note in one.notes)]
    others = {
        other: Signal(_seconds_since(epoch, found.times), found.values)
        for (role, other), found in cleaned.items()
        if role == 'other' and other is not None
    }
    return Recording(name, epoch, displacement, cylinders, signal('force'), tuple(health), others)


def _seconds_since(epoch: int, times: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return times [ns] in seconds since an epoch, in the same memory."""
    seconds = times.view(np.float64)
    for part in parts(times):
        seconds[part] = (times[part] - epoch) / NANOSECONDS
    return seconds


def _clean(samples: Samples, ambient_pressure: float) -> Cleaned:
    channel, values = samples.channel, samples.raw
    for part in parts(values):
        values[part] = channel.si(values[part], ambient_pressure)
    if channel.role == 'setpoint':
        return at_changes(clean(samples.times, values, channel.name, held=True))
    cleaned = clean(samples.times, values, channel.name)
    return at_changes(_from_previous(cleaned)) if channel.role == 'setpoint_applied' else cleaned


def _from_previous(applied: Cleaned) -> Cleaned:
    """Return set-points that acted up to their times at the times from which they acted on."""
    if len(applied.times) == 1:
        return applied
    return Cleaned(applied.times[:-1], applied.values[1:], applied.notes)


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
