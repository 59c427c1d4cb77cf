# SPDX-License-Identifier: Apache-2.0
"""From serialised messages to arrays, many messages at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages.blocks import MessageBlock, gather
from cfd_pneumatic.messages.fields import FieldPath
from cfd_pneumatic.messages.layout import Layout, LayoutError, Place, Serialization
from cfd_pneumatic.messages.types import NANOSECONDS

KNOWN = 8
"""Layouts that are remembered from one block to the next."""


@dataclass(frozen=True)
class TimePaths:
    """Where the stamp of a message is: seconds and nanoseconds."""

    seconds: FieldPath
    nanoseconds: FieldPath


@dataclass(frozen=True)
class CounterPath:
    """Where the stamp of a message is: a number in a unit of its own [s]."""

    counter: FieldPath
    unit: float


@dataclass(frozen=True)
class Columns:
    """
    What a run of messages holds.

    Attributes
    ----------
    found : (n,) array of bool
        Whether the message has the wanted number; False where an array is too short or lacks the name.
    values : (n,) array
        The numbers; meaningless where not found.
    stamps : (n,) array of int
        The stamps [ns]; 0 where there is none.

    """

    found: NDArray[np.bool_]
    values: Array
    stamps: NDArray[np.int64]


class Decoder:
    """
    Decodes the messages of one topic.

    Parameters
    ----------
    types : Typestore
        Definitions of the messages.
    msgtype : str
        Type of the topic.
    value : FieldPath
        The wanted number.
    stamp : TimePaths or CounterPath or None
        Where the messages' stamp is; None for messages without.
    serialization : Serialization
        How the bag's messages are serialised.

    """

    def __init__(
        self,
        types: Typestore,
        msgtype: str,
        value: FieldPath,
        stamp: TimePaths | CounterPath | None,
        serialization: Serialization,
    ) -> None:
        self._types = types
        self._msgtype = msgtype
        self._value = value
        self._stamp = stamp
        self._serialization = serialization
        self._known: deque[Layout] = deque(maxlen=KNOWN)

    def names(self, payload: bytes) -> list[str]:
        """Return the names of a message's entries, as JointState has them."""
        return self._parse(payload).names()

    def decode(self, block: MessageBlock) -> Columns:
        """
        Return the numbers and stamps of messages.

        Raises
        ------
        InputError
            If a payload does not fit the type's definition.

        """
        count = len(block)
        columns = Columns(np.zeros(count, bool), np.zeros(count), np.zeros(count, np.int64))
        for layout, which in self._alike(block):
            messages = block[which]
            place = layout.place(self._value)
            if place is not None:
                columns.found[which] = True
                columns.values[which] = _numbers(messages, place)
            columns.stamps[which] = self._stamps(layout, messages)
        return columns

    def _alike(self, block: MessageBlock) -> Iterator[tuple[Layout, NDArray[np.intp]]]:
        """Sort messages by layout: for each layout yield which have it."""
        pending = np.arange(len(block))
        known = iter(tuple(self._known))
        while pending.size:
            layout = next(known, None) or self._learn(block.payload(pending[0]))
            alike = layout.alike(block[pending])
            if alike.any():
                yield layout, pending[alike]
                pending = pending[~alike]

    def _learn(self, payload: bytes) -> Layout:
        layout = self._parse(payload)
        self._known.appendleft(layout)
        return layout

    def _parse(self, payload: bytes) -> Layout:
        try:
            return Layout(payload, self._types, self._msgtype, self._serialization)
        except LayoutError as error:
            raise InputError(
                f'a message {error}: the bag is damaged, or {self._msgtype} is not '
                'defined as it was recorded: check the files that `types` names in the mapping'
            ) from error

    def _stamps(self, layout: Layout, messages: MessageBlock) -> NDArray[np.int64]:
        if isinstance(self._stamp, TimePaths):
            seconds, nanoseconds = layout.place(self._stamp.seconds), layout.place(self._stamp.nanoseconds)
            if seconds is not None and nanoseconds is not None:
                whole = _numbers(messages, seconds).astype(np.int64) * NANOSECONDS
                return whole + _numbers(messages, nanoseconds).astype(np.int64)
        elif isinstance(self._stamp, CounterPath):
            place = layout.place(self._stamp.counter)
            if place is not None:
                return in_nanoseconds(_numbers(messages, place), self._stamp.unit)
        return np.zeros(len(messages), np.int64)


def in_nanoseconds(times: NDArray[Any], unit: float) -> NDArray[np.int64]:
    """Return times in a unit [s] as whole nanoseconds; those that are not finite become 0."""
    if np.issubdtype(times.dtype, np.integer) and unit * NANOSECONDS >= 1:
        return times.astype(np.int64) * round(unit * NANOSECONDS)
    nanoseconds = np.rint(times.astype(np.float64) * (unit * NANOSECONDS))
    return np.where(np.isfinite(nanoseconds), nanoseconds, 0).astype(np.int64)


def _numbers(messages: MessageBlock, place: Place) -> NDArray[Any]:
    """Return the numbers at one place of every message."""
    return gather(messages.data, place.dtype, messages.starts + place.offset)
