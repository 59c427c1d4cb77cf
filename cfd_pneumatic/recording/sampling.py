# SPDX-License-Identifier: Apache-2.0
"""Read the samples of a bag's channels in one pass over the messages, decoded block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import gettempdir

from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import (
    NANOSECONDS,
    CounterPath,
    Decoder,
    Definitions,
    FieldPath,
    TimePaths,
    check_number,
    has_header,
    is_time,
    list_numbers,
    obvious_field,
    parse_path,
)
from cfd_pneumatic.recording.bags import Bag, Topic
from cfd_pneumatic.recording.intake import Content, Intake
from cfd_pneumatic.recording.memory_maps import give_back, parts
from cfd_pneumatic.recording.sources import RECEIVE, Samples, SignalSource
from cfd_pneumatic.recording.topics import list_topics

LONG = 8_000_000
"""Number of samples of all channels above which a recording is kept in files: 128 MB."""

OTHER_CLOCK = 1.0
"""Lag of reception behind the stamps [s] above which the stamps come from another clock."""


DRIFT = 0.05
"""Drift between stamps and times of reception [s] above which their clocks run at different rates."""


SCATTER = 0.03
"""Scatter of the lags [s] above which times of reception are inaccurate."""


@dataclass(frozen=True)
class Defaults:
    """Defaults of a channel: the joint, and the axis of a force (`x`, `y` or `z`)."""

    joint: str
    force_axis: str


def read_samples(
    bag: Bag, channels: Sequence[SignalSource], types_folder: Path | None, defaults: Defaults, folder: Path | None
) -> tuple[list[Samples], list[str]]:
    """
    Return the samples of given channels in a bag, and notes on defects.

    Parameters
    ----------
    bag : Bag
        An open bag.
    channels : sequence of SignalSource
        The channels, with full topic names.
    types_folder : Path or None
        Folder with definitions of messages.
    defaults : Defaults
        Joint and axis for channels that do not give them.
    folder : Path or None
        Folder for the samples; None for memory, or for the system's temporary folder if there are more than `LONG`.

    Raises
    ------
    InputError
        If a topic is missing or empty, its type is unknown, or a field is missing.

    """
    definitions = Definitions(types_folder)
    sources = [_find_source(bag, channel, definitions, defaults) for channel in channels]
    if folder is None and sum(topic.count for topic, _, _ in sources) > LONG:
        folder = Path(gettempdir())
    intakes = [
        Intake(channel, decoder, path, topic.count, folder)
        for channel, (topic, path, decoder) in zip(channels, sources)
    ]
    by_topic: dict[str, list[Intake]] = {}
    for intake in intakes:
        by_topic.setdefault(str(intake.channel.source), []).append(intake)
    for topic, block in bag.blocks(by_topic):
        for intake in by_topic[topic]:
            intake.add(block)
    return _on_one_clock([intake.content() for intake in intakes])


def _find_source(
    bag: Bag, channel: SignalSource, definitions: Definitions, defaults: Defaults
) -> tuple[Topic, FieldPath, Decoder]:
    """Return the topic of a channel, the path of its number, and a decoder."""
    topic = bag.topics.get(str(channel.source))
    if topic is None:
        raise InputError(
            f'has no topic of the name that the mapping gives for the {channel.name}: '
            f'the topics are {list_topics(bag.topics)}'
        )
    types = definitions.for_topic(topic.connections)
    field = channel.field or obvious_field(topic.msgtype, joint=defaults.joint, force_axis=defaults.force_axis)
    if field is None:
        numbers = list_numbers(types, topic.msgtype)
        raise InputError(f'topic {topic.name}: give the `field` of {topic.msgtype} in the mapping: {numbers}')
    try:
        path = parse_path(field)
        check_number(types, topic.msgtype, path)
        stamp = _stamp(types, topic.msgtype, channel)
    except InputError as error:
        raise InputError(f'topic {topic.name}: {error}') from error
    return topic, path, Decoder(types, topic.msgtype, path, stamp, bag.serialization)


def _stamp(types: Typestore, msgtype: str, channel: SignalSource) -> TimePaths | CounterPath | None:
    """Return the path of the stamps of a channel's messages; None for times of reception."""
    if channel.stamp == RECEIVE or (channel.stamp is None and not has_header(types, msgtype)):
        return None
    path = parse_path(channel.stamp or 'header.stamp')
    if is_time(types, msgtype, path):
        return TimePaths(parse_path(f'{path}.sec'), parse_path(f'{path}.nanosec'))
    check_number(types, msgtype, path)
    return CounterPath(path, channel.stamp_unit)


def _on_one_clock(contents: Sequence[Content]) -> tuple[list[Samples], list[str]]:
    """
    Return samples at their stamps, or at the time of reception if they have no stamp.

    If the stamps come from another clock, such as simulated time, the times of reception are moved by the lag between
    the clocks. The lag may grow, since the clocks may run at different rates.
    """
    notes = [note for content in contents for note in content.notes]
    clock = next((content.clock for content in contents if content.clock is not None), None)
    drifts = clock is not None and abs(clock.drift) > DRIFT * NANOSECONDS
    is_other = clock is not None and (drifts or abs(clock.lag) > OTHER_CLOCK * NANOSECONDS)
    samples = []
    for content in contents:
        if clock is not None and is_other and content.unstamped:
            shift = f'{-clock.lag / NANOSECONDS:.3f} s'
            rate = f', which runs {1.0 / (1.0 - clock.rate):.6g} times as fast' if drifts else ''
            notes.append(
                f'{content.channel.name}: moved by {shift} from the clock of reception{rate} to that of the stamps'
            )
            for indices in content.unstamped:
                content.times[indices] -= clock.lag_at(content.times[indices]) if drifts else clock.lag
                give_back(content.times)
        if clock is not None and content.unstamped and clock.scatter > SCATTER * NANOSECONDS:
            notes.append(
                f'{content.channel.name}: its messages have no stamp, and others were received by up to '
                f'{clock.scatter / NANOSECONDS:.3g} s sooner or later after their stamps: so wrong its times may be'
            )
        for part in parts(content.times) if content.channel.time_offset else ():
            content.times[part] += round(content.channel.time_offset * NANOSECONDS)
        samples.append(Samples(content.channel, content.times, content.raw))
    return samples, notes
