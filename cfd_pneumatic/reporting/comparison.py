# SPDX-License-Identifier: Apache-2.0
"""
`compare.mcap`: a recording with its simulations without and with effects, for PlotJuggler and Foxglove.

All messages are on the time line of the recording. Each namespace holds:

========================  ==============================================================================
``/measured``             piston_state, set-points, pressures and force; topic names as in `convention.py`.
``/simulated_before``     pressures and contact_force, simulated without effects.
``/simulated_after``      pressures and contact_force, simulated with the estimated effects.
``/residual_before``      measured minus simulated without effects, in messages with stamps.
``/residual_after``       measured minus simulated with effects, in messages with stamps.
========================  ==============================================================================

`/measured` is a complete recording: `read_recording` and `identify_bag --namespace /measured` can read it.

Above two million messages, the file holds minima and maxima only, unless every sample is requested. A remark in the
file reports the reduction.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cfd_pneumatic.charts import thinned
from cfd_pneumatic.files import marked, staged_output
from cfd_pneumatic.identification import Comparison, Identification
from cfd_pneumatic.messages import Form
from cfd_pneumatic.recording import BagWriter, Recording, Stream, stamps_of, streams_of

MEASURED = '/measured'
SIMULATED = ('/simulated_before', '/simulated_after')
RESIDUAL = ('/residual_before', '/residual_after')

MOST_MESSAGES = 2_000_000
"""Largest number of messages in a file, unless every sample is requested."""

is_comparison = marked(rf'(?s)\A\x89MCAP.{{,64}}cfd_pneumatic.*{SIMULATED[0]}/')
"""Recognise a comparison file: this program announces all topics of an MCAP file before the first message."""

_THINNING_REMARK = 'minima and maxima of {} samples each; identify_bag --full writes every sample'


def write_comparison(
    path: Path, identification: Identification, index: int, run: str = '', *, full: bool = False
) -> bool:
    """
    Write the comparison of one recording to a single MCAP file, which is replaced in one step.

    Parameters
    ----------
    path
        Path of the file. An earlier file is replaced.
    identification, index
        Results of the identification, and index of the recording.
    run
        Name of the identification run; it is stored in the file.
    full
        Whether every sample is written, regardless of the number.

    Returns
    -------
    bool
        Whether the file holds every sample.

    Raises
    ------
    InputError
        If the file cannot be written, or a time of the recording does not fit a message.

    """
    sizes = [stream.times.size for stream in _streams(identification, index)]
    complete = full or sum(sizes) <= MOST_MESSAGES
    columns = max(sizes) if complete else MOST_MESSAGES // (2 * len(sizes))
    streams = []
    for stream in _streams(identification, index):
        times, values = thinned(stream.times, stream.values, columns)
        streams.append(replace(stream, times=times, values=values))
    with staged_output(path) as staged_file:
        bag = staged_file.with_name('bag')
        with BagWriter(bag) as writer:
            writer.write_streams(streams)
            writer.remark('run', run)
            if not complete:
                writer.remark('holds', _THINNING_REMARK.format(max(sizes) // columns))
        os.replace(next(bag.glob('*.mcap')), staged_file)
    return complete


def _streams(identification: Identification, index: int) -> Iterator[Stream]:
    """Yield the inputs of the models as measured, then each channel with its simulations and residuals."""
    recording = identification.recordings[index]
    comparisons = [
        comparison
        for result in identification.closed
        for comparison in result.comparisons
        if comparison.recording == index
    ]
    channel_topics = {f'{MEASURED}/{comparison.channel.topics[0]}' for comparison in comparisons}
    for stream in streams_of(recording, MEASURED, identification.ambient_pressure):
        if stream.topic not in channel_topics:
            yield stream
    for comparison in comparisons:
        yield from _channel_streams(recording, comparison)


def _channel_streams(recording: Recording, comparison: Comparison) -> Iterator[Stream]:
    """Yield the measured values, the simulated values and the residuals of one channel."""
    channel = comparison.channel
    signal = channel.signal(recording)
    assert signal is not None
    (measured_topic, simulated_topic), form = channel.topics, Form(channel.msgtype)
    times = stamps_of(recording, comparison.stamps(signal))
    yield Stream(f'{MEASURED}/{measured_topic}', form, times, comparison.experiment.measured)
    for space, values in zip(SIMULATED, (comparison.before, comparison.after)):
        yield Stream(f'{space}/{simulated_topic}', form, times, values)
    for which, space in enumerate(RESIDUAL):
        yield Stream(f'{space}/{simulated_topic}', form, times, comparison.residual(which))
