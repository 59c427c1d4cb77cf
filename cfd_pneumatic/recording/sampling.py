# SPDX-License-Identifier: Apache-2.0
"""Reading the samples of a bag's channels: one pass over the messages, decoded a block at a time."""

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
"""Samples, of all channels together, from which on a recording is kept in files: 128 MB."""

OTHER_CLOCK = 1.0
"""Stamps that differ from the times of reception by more [s] come from another clock."""


DRIFT = 0.05
"""Where stamps and times of reception drift apart by more [s], their clocks run at different rates."""


SCATTER = 0.03
"""Where messages are received by more sooner or later after their stamps [s], times of reception say little."""


@dataclass(frozen=True)
class Defaults:
    """What is meant where a channel leaves it open: a joint, and an axis of a force (`x`, `y` or `z`)."""

    joint: str
    force_axis: str


def read_samples(
    bag: Bag, channels: Sequence[SignalSource], types_folder: Path | None, defaults: Defaults, folder: Path | None
) -> tuple[list[Samples], list[str]]:
    """
    Return what a bag holds for some channels, and notes on what was amiss.

    Parameters
    ----------
    bag : Bag
        An open bag.
    channels : sequence of SignalSource
        The channels, with full topic names.
    types_folder : Path or None
        Folder with definitions of messages.
    defaults : Defaults
        What is meant where a channel leaves it open.
    folder : Path or None
        Folder to keep the samples in; None for memory, or the system's temporary folder if there are more than `LONG`.

    Raises
    ------
    InputError
        If a topic is missing or empty, its type unknown, or a field isn't there.

    """
    definitions = Definitions(types_folder)
    found = [_find(bag, channel, definitions, defaults) for channel in channels]
    if folder is None and sum(topic.count for topic, _, _ in found) > LONG:
        folder = Path(gettempdir())
    intakes = [
        Intake(channel, decoder, path, topic.count, folder) for channel, (topic, path, decoder) in zip(channels, found)
    ]
    by_topic: dict[str, list[Intake]] = {}
    for intake in intakes:
        by_topic.setdefault(str(intake.channel.source), []).append(intake)
    for topic, block in bag.blocks(by_topic):
        for intake in by_topic[topic]:
            intake.add(block)
    return _on_one_clock([intake.content() for intake in intakes])


def _find(
    bag: Bag, channel: SignalSource, definitions: Definitions, defaults: Defaults
) -> tuple[Topic, FieldPath, Decoder]:
    """Return a channel's topic, where its number is, and what decodes it."""
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
        raise InputError(f'topic {topic.name}: say which field of {topic.msgtype} is meant: {numbers}')
    try:
        path = parse_path(field)
        check_number(types, topic.msgtype, path)
        stamp = _stamp(types, topic.msgtype, channel)
    except InputError as error:
        raise InputError(f'topic {topic.name}: {error}') from error
    return topic, path, Decoder(types, topic.msgtype, path, stamp, bag.serialization)


def _stamp(types: Typestore, msgtype: str, channel: SignalSource) -> TimePaths | CounterPath | None:
    """Return where the stamps of a channel's messages are."""
    if channel.stamp == RECEIVE or (channel.stamp is None and not has_header(types, msgtype)):
        return None
    path = parse_path(channel.stamp or 'header.stamp')
    if is_time(types, msgtype, path):
        return TimePaths(parse_path(f'{path}.sec'), parse_path(f'{path}.nanosec'))
    check_number(types, msgtype, path)
    return CounterPath(path, channel.stamp_unit)


def _on_one_clock(contents: Sequence[Content]) -> tuple[list[Samples], list[str]]:
    """
    Return samples at their stamps, those without one at the time of reception.

    Where the stamps come from another clock than the times of reception, as simulated time does, the latter are moved
    by what lies between the two; that may grow, as the clocks may run at different rates.
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
            for some in content.unstamped:
                content.times[some] -= clock.lag_at(content.times[some]) if drifts else clock.lag
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
