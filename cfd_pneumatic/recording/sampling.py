"""Reading the samples of a bag's channels: one pass over the messages, decoded a chunk at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bag import Bag
from cfd_pneumatic.recording.channels import RECEIVE, Channel, Samples
from cfd_pneumatic.recording.decoding import Columns, CounterPath, Decoder, TimePaths
from cfd_pneumatic.recording.definitions import read_types, types_of
from cfd_pneumatic.recording.fields import FieldPath, check_number, has_header, is_time, list_numbers, parse_path
from cfd_pneumatic.recording.messages import NANOSECONDS, obvious_field
from cfd_pneumatic.recording.topics import list_topics
from cfd_pneumatic.recording.wording import counted

CHUNK = 65_536
"""Messages of a topic that are decoded together."""

OTHER_CLOCK = 1.0
"""Stamps that differ from the times of reception by more [s] come from another clock."""


@dataclass(frozen=True)
class Defaults:
    """What is meant where a channel leaves it open: a joint, and an axis of a force (`x`, `y` or `z`)."""

    joint: str
    force_axis: str


def read_samples(
    bag: Bag, channels: Sequence[Channel], types_folder: Path | None, defaults: Defaults
) -> tuple[list[Samples], list[str]]:
    """
    Return what a bag holds for some channels, and notes on what was amiss.

    Parameters
    ----------
    bag : Bag
        An open bag.
    channels : sequence of Channel
        The channels, with full topic names.
    types_folder : Path or None
        Folder with definitions of messages.
    defaults : Defaults
        What is meant where a channel leaves it open.

    Raises
    ------
    InputError
        If a topic is missing or empty, its type unknown, or a field isn't there.

    """
    intakes = [_intake(bag, channel, types_folder, defaults) for channel in channels]
    by_topic: dict[str, list[_Intake]] = {}
    for intake in intakes:
        by_topic.setdefault(str(intake.channel.source), []).append(intake)
    for topic, time, payload in bag.messages(by_topic):
        for intake in by_topic[topic]:
            intake.add(time, payload)
    contents = [intake.content() for intake in intakes]
    return _on_one_clock(contents)


@dataclass(frozen=True)
class _Content:
    """What the messages of a channel hold; a stamp of 0 is none."""

    channel: Channel
    received: NDArray[np.int64]
    stamps: NDArray[np.int64]
    raw: NDArray[np.float64]
    notes: tuple[str, ...]


class _Intake:
    """Takes in the messages of a channel's topic."""

    def __init__(self, channel: Channel, decoder: Decoder, path: FieldPath) -> None:
        self.channel = channel
        self._decoder = decoder
        self._path = path
        self._payloads: list[bytes] = []
        self._times: list[int] = []
        self._columns: list[Columns] = []
        self._received: list[NDArray[np.int64]] = []
        self._names: list[str] = []

    def add(self, time: int, payload: bytes) -> None:
        """Take in a message received at a time [ns]."""
        self._times.append(time)
        self._payloads.append(payload)
        if len(self._payloads) == CHUNK:
            self._decode()

    def content(self) -> _Content:
        """Return what was taken in."""
        self._decode()
        channel = self.channel
        if not self._columns:
            raise InputError(f'topic {channel.source}, the {channel.name}, has no messages')
        found = np.concatenate([columns.found for columns in self._columns])
        if not found.any():
            there = f'; the names are {", ".join(self._names)}' if self._names else ''
            raise InputError(f'no message on topic {channel.source} has {self._path}{there}')
        notes = []
        if not found.all():
            notes.append(f'{channel.name}: {counted(int(np.count_nonzero(~found)), "message")} without {self._path}')
        return _Content(
            channel,
            np.concatenate(self._received)[found],
            np.concatenate([columns.stamps for columns in self._columns])[found],
            np.concatenate([columns.values for columns in self._columns])[found],
            tuple(notes),
        )

    def _decode(self) -> None:
        if not self._payloads:
            return
        try:
            self._columns.append(self._decoder.decode(self._payloads))
        except InputError as error:
            raise InputError(f'topic {self.channel.source}: {error}') from error
        self._received.append(np.array(self._times, np.int64))
        if not self._names:
            self._names = self._decoder.names(self._payloads[0])
        self._payloads.clear()
        self._times.clear()


def _intake(bag: Bag, channel: Channel, types_folder: Path | None, defaults: Defaults) -> _Intake:
    topic = bag.topics.get(str(channel.source))
    if topic is None:
        raise InputError(f'no topic {channel.source} for the {channel.name}: the topics are {list_topics(bag.topics)}')
    types = types_of(topic.connection, read_types(types_folder) if types_folder else None)
    field = channel.field or obvious_field(topic.msgtype, joint=defaults.joint, force_axis=defaults.force_axis)
    if field is None:
        numbers = list_numbers(types, topic.msgtype)
        raise InputError(f'topic {topic.name}: say which field of {topic.msgtype} is meant: {numbers}')
    path = parse_path(field)
    try:
        check_number(types, topic.msgtype, path)
        stamp = _stamp(types, topic.msgtype, channel)
    except InputError as error:
        raise InputError(f'topic {topic.name}: {error}') from error
    return _Intake(channel, Decoder(types, topic.msgtype, path, stamp, bag.serialization), path)


def _stamp(types: Typestore, msgtype: str, channel: Channel) -> TimePaths | CounterPath | None:
    """Return where the stamps of a channel's messages are."""
    if channel.stamp == RECEIVE or (channel.stamp is None and not has_header(types, msgtype)):
        return None
    path = parse_path(channel.stamp or 'header.stamp')
    if is_time(types, msgtype, path):
        return TimePaths(parse_path(f'{path}.sec'), parse_path(f'{path}.nanosec'))
    check_number(types, msgtype, path)
    return CounterPath(path, channel.stamp_unit)


def _on_one_clock(contents: Sequence[_Content]) -> tuple[list[Samples], list[str]]:
    """
    Return samples at their stamps, those without one at the time of reception.

    Where the stamps come from another clock than the times of reception, as simulated time does, the latter are moved
    by what lies between the two.
    """
    notes = [note for content in contents for note in content.notes]
    lag = next((lag for lag in map(_lag, contents) if lag is not None), 0)
    if abs(lag) <= OTHER_CLOCK * NANOSECONDS:
        lag = 0
    samples = []
    for content in contents:
        unstamped = content.stamps == 0
        if lag and unstamped.any():
            shift = f'{-lag / NANOSECONDS:.3f} s'
            notes.append(f'{content.channel.name}: moved by {shift} from the clock of reception to that of the stamps')
        times = np.where(unstamped, content.received - lag, content.stamps)
        times += round(content.channel.time_offset * NANOSECONDS)
        samples.append(Samples(content.channel, times, content.raw))
    return samples, notes


def _lag(content: _Content) -> int | None:
    """Return the median time from stamp to reception [ns], None without stamps."""
    lags = (content.received - content.stamps)[content.stamps != 0]
    return int(lags[0]) + int(np.median(lags - lags[0])) if lags.size else None
