"""
`compare.mcap`: a recording beside its simulations without and with effects, for PlotJuggler and Foxglove.

On the recording's own time line. One namespace for each:

========================  ==============================================================================
``/measured``             piston_state, set-points, pressures and force, under the names of our convention
``/simulated_before``     pressures and contact_force, by the model without effects
``/simulated_after``      the same with the effects that were found
``/residual_before``      measured less simulated, in messages of the same types, so that they are stamped
``/residual_after``       the same with the effects
========================  ==============================================================================

`/measured` is a recording of its own, which `read_recording` and `identify_bag --namespace /measured` read again.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import BagWriter, Recording, Signal, messages
from cfd_pneumatic.recording.messages import NANOSECONDS
from cfd_pneumatic.reporting.outcome import PRESSURE, Comparison, Outcome

Array = NDArray[np.float64]

MEASURED = '/measured'
SIMULATED = ('/simulated_before', '/simulated_after')
RESIDUAL = ('/residual_before', '/residual_after')

_LAST_STAMP = 2**31  # seconds that a stamp can't hold any more


@dataclass(frozen=True)
class _Track:
    """A topic to write: samples at times [ns], and what makes a message of a time and a value."""

    topic: str
    msgtype: str
    times: NDArray[np.int64]
    values: Array
    message: Callable[[int, float], object]


def write_comparison(
    path: Path, recording: Recording, index: int, outcomes: Sequence[Outcome], ambient_pressure: float
) -> None:
    """
    Write the comparison of one recording as a single MCAP file, aside and then to its place.

    Parameters
    ----------
    path
        Of the file; an earlier one is replaced.
    recording, index
        The recording, and which one it is among those identified.
    outcomes
        What was found.
    ambient_pressure
        What set-points, gauge in a bag, are above [Pa].

    Raises
    ------
    InputError
        If it can't be written, or the recording's times don't fit a message.

    """
    tracks = _tracks(recording, index, outcomes, ambient_pressure)
    last = max(int(track.times[-1]) for track in tracks) / NANOSECONDS
    if recording.epoch < 0 or last >= _LAST_STAMP:
        raise InputError(f'{recording.name}: times up to {last:g} s do not fit a stamp: check their unit and offset')
    try:
        aside = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}.'))
    except OSError as error:
        raise InputError(f'cannot write {path}: {error.strerror}; choose a folder that you may write to') from error
    try:
        _write(aside / path.stem, tracks)
        os.replace(next((aside / path.stem).glob('*.mcap')), path)
    except OSError as error:
        raise InputError(f'cannot write {path}: {error.strerror}; choose a folder that you may write to') from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _write(folder: Path, tracks: Sequence[_Track]) -> None:
    times = np.concatenate([track.times for track in tracks])
    owners = np.repeat(np.arange(len(tracks)), [track.times.size for track in tracks])
    samples = np.concatenate([np.arange(track.times.size) for track in tracks])
    order = np.argsort(times, kind='stable')
    with BagWriter(folder) as bag:
        for track in tracks:
            bag.add_topic(track.topic, track.msgtype)
        for owner, sample in zip(owners[order].tolist(), samples[order].tolist()):
            track = tracks[owner]
            time = int(track.times[sample])
            bag.write_message(track.topic, time, track.message(time, float(track.values[sample])))


def _tracks(recording: Recording, index: int, outcomes: Sequence[Outcome], ambient_pressure: float) -> list[_Track]:
    """Return the topics, set-points first: at equal times they come before the samples that they act on."""
    tracks = [
        _Track(
            f'{MEASURED}/{setpoint_topic(cylinder)}',
            messages.FLOAT64,
            _nanoseconds(recording, signals.setpoint.times),
            signals.setpoint.values - ambient_pressure,
            lambda _time, value: messages.float64(value),
        )
        for cylinder, signals in recording.cylinders.items()
        if signals.setpoint is not None
    ]
    tracks.append(
        _Track(
            f'{MEASURED}/{PISTON_STATE}',
            messages.JOINT_STATE,
            _nanoseconds(recording, recording.displacement.times),
            recording.displacement.values,
            lambda time, value: messages.joint_state(time, PISTON_JOINT, value),
        )
    )
    for outcome in outcomes:
        for comparison in outcome.comparisons:
            if comparison.recording == index:
                tracks += _compared(recording, outcome, comparison)
    return tracks


def _compared(recording: Recording, outcome: Outcome, comparison: Comparison) -> list[_Track]:
    """Return what was measured, simulated and left of one quantity."""
    measured_as, simulated_as, msgtype, message = _naming(outcome)
    times = _nanoseconds(recording, comparison.stamps(_signal(recording, outcome)))
    series = {
        f'{MEASURED}/{measured_as}': comparison.measured,
        **{f'{space}/{simulated_as}': one for space, one in zip(SIMULATED, (comparison.before, comparison.after))},
        **{f'{space}/{simulated_as}': one for space, one in zip(RESIDUAL, comparison.residuals)},
    }
    return [_Track(topic, msgtype, times, values, message) for topic, values in series.items()]


def _naming(outcome: Outcome) -> tuple[str, str, str, Callable[[int, float], object]]:
    """Return names below the measured and the simulated namespace, the type, and what makes a message."""
    if outcome.quantity is PRESSURE:
        topic = pressure_topic(outcome.name)
        return topic, topic, messages.FLUID_PRESSURE, messages.fluid_pressure
    return MEASURED_FORCE, CONTACT_FORCE, messages.WRENCH_STAMPED, messages.wrench_stamped


def _signal(recording: Recording, outcome: Outcome) -> Signal:
    if outcome.quantity is PRESSURE:
        return recording.cylinders[outcome.name].pressure
    assert recording.force is not None
    return recording.force


def _nanoseconds(recording: Recording, times: Array) -> NDArray[np.int64]:
    return recording.epoch + np.rint(times * NANOSECONDS).astype(np.int64)
