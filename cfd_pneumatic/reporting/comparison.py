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

Of more than two million messages it holds minima and maxima, unless everything is asked for, and says so.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from cfd_pneumatic.convention import PISTON_JOINT, PISTON_STATE, setpoint_topic
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Identification
from cfd_pneumatic.identification.result import Comparison
from cfd_pneumatic.recording import BagWriter, Recording, messages
from cfd_pneumatic.recording.writer import Stream, stamps_of
from cfd_pneumatic.reporting.thinning import thinned

MEASURED = '/measured'
SIMULATED = ('/simulated_before', '/simulated_after')
RESIDUAL = ('/residual_before', '/residual_after')

MOST = 2_000_000
"""Messages that a file holds, unless everything is asked for."""

_MESSAGES: Mapping[str, Callable[[int, float], object]] = {
    messages.FLUID_PRESSURE: messages.fluid_pressure,
    messages.WRENCH_STAMPED: messages.wrench_stamped,
}
"""What makes a message of a stamp [ns] and a value, by its type."""

_REMARK = 'minima and maxima of {} samples each; identify_bag --full writes every sample'


def write_comparison(path: Path, identification: Identification, index: int, *, full: bool = False) -> bool:
    """
    Write the comparison of one recording as a single MCAP file, aside and then to its place.

    Parameters
    ----------
    path
        Of the file; an earlier one is replaced.
    identification, index
        What was found, and which recording it is.
    full
        Whether every sample is written, however many there are.

    Returns
    -------
    bool
        Whether every sample is in it.

    Raises
    ------
    InputError
        If it can't be written, or the recording's times don't fit a message.

    """
    sizes = [one.times.size for one in _streams(identification, index)]
    complete = full or sum(sizes) <= MOST
    columns = max(sizes) if complete else MOST // (2 * len(sizes))
    streams = [_thinned(one, columns) for one in _streams(identification, index)]
    try:
        with TemporaryDirectory(dir=path.parent, prefix=f'.{path.name}.') as aside:
            bag = Path(aside) / path.stem
            with BagWriter(bag) as writer:
                writer.write_streams(streams)
                if not complete:
                    writer.remark('holds', _REMARK.format(max(sizes) // columns))
            os.replace(next(bag.glob('*.mcap')), path)
    except OSError as error:
        raise InputError(f'cannot write {path}: {error.strerror}; choose a folder that you may write to') from error
    return complete


def _thinned(stream: Stream, columns: int) -> Stream:
    times, values = thinned(stream.times, stream.values, columns)
    return replace(stream, times=times, values=values)


def _streams(identification: Identification, index: int) -> Iterator[Stream]:
    """Yield what is written, set-points first: at equal times they come before the samples that they act on."""
    recording, ambient_pressure = identification.recordings[index], identification.ambient_pressure
    for cylinder, signals in recording.cylinders.items():
        if signals.setpoint is not None:
            yield Stream(
                f'{MEASURED}/{setpoint_topic(cylinder)}',
                messages.FLOAT64,
                stamps_of(recording, signals.setpoint.times),
                signals.setpoint.values - ambient_pressure,
                lambda _, value: messages.float64(value),
            )
    yield Stream(
        f'{MEASURED}/{PISTON_STATE}',
        messages.JOINT_STATE,
        stamps_of(recording, recording.displacement.times),
        recording.displacement.values,
        lambda time, value: messages.joint_state(time, PISTON_JOINT, value),
    )
    for result in identification.closed:
        for comparison in result.comparisons:
            if comparison.recording == index:
                yield from _compared(recording, comparison)


def _compared(recording: Recording, comparison: Comparison) -> Iterator[Stream]:
    """Yield what was measured, simulated and left of one quantity."""
    channel = comparison.channel
    signal = channel.signal(recording)
    assert signal is not None
    (measured_as, simulated_as), message = channel.topics, _MESSAGES[channel.msgtype]
    times = stamps_of(recording, comparison.stamps(signal))
    yield Stream(f'{MEASURED}/{measured_as}', channel.msgtype, times, comparison.experiment.measured, message)
    for space, values in zip(SIMULATED, (comparison.before, comparison.after)):
        yield Stream(f'{space}/{simulated_as}', channel.msgtype, times, values, message)
    for which, space in enumerate(RESIDUAL):
        yield Stream(f'{space}/{simulated_as}', channel.msgtype, times, comparison.residual(which), message)
