# SPDX-License-Identifier: Apache-2.0
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
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cfd_pneumatic.files import marked, staged_output
from cfd_pneumatic.identification import Comparison, Identification
from cfd_pneumatic.messages import Form
from cfd_pneumatic.recording import BagWriter, Recording, Stream, stamps_of, streams_of
from cfd_pneumatic.reporting.thinning import thinned

MEASURED = '/measured'
SIMULATED = ('/simulated_before', '/simulated_after')
RESIDUAL = ('/residual_before', '/residual_after')

MOST = 2_000_000
"""Messages that a file holds, unless everything is asked for."""

is_comparison = marked(rf'(?s)\A\x89MCAP.{{,64}}cfd_pneumatic.*{SIMULATED[0]}/')
"""Recognises such a file: an mcap of ours announces all of its topics before the first message."""

_REMARK = 'minima and maxima of {} samples each; identify_bag --full writes every sample'


def write_comparison(
    path: Path, identification: Identification, index: int, run: str = '', *, full: bool = False
) -> bool:
    """
    Write the comparison of one recording as a single MCAP file, aside and then to its place.

    Parameters
    ----------
    path
        Of the file; an earlier one is replaced.
    identification, index
        What was found, and which recording it is.
    run
        Of the identification; the file carries it.
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
    streams = []
    for one in _streams(identification, index):
        times, values = thinned(one.times, one.values, columns)
        streams.append(replace(one, times=times, values=values))
    with staged_output(path) as made:
        bag = made.with_name('bag')
        with BagWriter(bag) as writer:
            writer.write_streams(streams)
            writer.remark('run', run)
            if not complete:
                writer.remark('holds', _REMARK.format(max(sizes) // columns))
        os.replace(next(bag.glob('*.mcap')), made)
    return complete


def _streams(identification: Identification, index: int) -> Iterator[Stream]:
    """Yield what is written: what was measured and drives the models, then each channel beside its simulations."""
    recording = identification.recordings[index]
    compared = [one for result in identification.closed for one in result.comparisons if one.recording == index]
    own = {f'{MEASURED}/{one.channel.topics[0]}' for one in compared}
    for stream in streams_of(recording, MEASURED, identification.ambient_pressure):
        if stream.topic not in own:
            yield stream
    for one in compared:
        yield from _compared(recording, one)


def _compared(recording: Recording, comparison: Comparison) -> Iterator[Stream]:
    """Yield what was measured, simulated and left of one quantity."""
    channel = comparison.channel
    signal = channel.signal(recording)
    assert signal is not None
    (measured_as, simulated_as), form = channel.topics, Form(channel.msgtype)
    times = stamps_of(recording, comparison.stamps(signal))
    yield Stream(f'{MEASURED}/{measured_as}', form, times, comparison.experiment.measured)
    for space, values in zip(SIMULATED, (comparison.before, comparison.after)):
        yield Stream(f'{space}/{simulated_as}', form, times, values)
    for which, space in enumerate(RESIDUAL):
        yield Stream(f'{space}/{simulated_as}', form, times, comparison.residual(which))
