# SPDX-License-Identifier: Apache-2.0
"""Decode serialised messages into arrays, many messages at a time."""

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

MOST_LAYOUTS = 8
"""Number of layouts that are remembered from block to block."""


@dataclass(frozen=True)
class TimePaths:
    """Paths of a message's stamp: seconds and nanoseconds."""

    seconds: FieldPath
    nanoseconds: FieldPath


@dataclass(frozen=True)
class CounterPath:
    """Path of a message's stamp that is one number, with its unit [s]."""

    counter: FieldPath
    unit: float


@dataclass(frozen=True)
class Columns:
    """
    Numbers and stamps of consecutive messages.

    Attributes
    ----------
    has_number : (n,) array of bool
        Whether the message has the wanted number. An array may be too short for its index or lack its name.
    values : (n,) array
        The numbers; meaningless if `has_number` is False.
    stamps : (n,) array of int
        The stamps [ns]; 0 for messages without a stamp.

    """

    has_number: NDArray[np.bool_]
    values: Array
    stamps: NDArray[np.int64]


class Decoder:
    """
    Decoder of the messages of a topic.

    Parameters
    ----------
    types : Typestore
        Definitions of the messages.
    msgtype : str
        Type of the topic.
    value : FieldPath
        Path of the wanted number.
    stamp : TimePaths or CounterPath or None
        Path of the messages' stamp; None for messages without a stamp.
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
        self._layouts: deque[Layout] = deque(maxlen=MOST_LAYOUTS)

    def names(self, payload: bytes) -> list[str]:
        """Return the names of a message's array entries, such as the joints of a JointState."""
        return self._parse(payload).names()

    def decode(self, block: MessageBlock) -> Columns:
        """
        Return the wanted number and the stamp of each message.

        Raises
        ------
        InputError
            If a payload does not fit the type's definition.

        """
        count = len(block)
        columns = Columns(np.zeros(count, bool), np.zeros(count), np.zeros(count, np.int64))
        for layout, indices in self._split_by_layout(block):
            messages = block[indices]
            place = layout.place(self._value)
            if place is not None:
                columns.has_number[indices] = True
                columns.values[indices] = _numbers(messages, place)
            columns.stamps[indices] = self._stamps(layout, messages)
        return columns

    def _split_by_layout(self, block: MessageBlock) -> Iterator[tuple[Layout, NDArray[np.intp]]]:
        """Split a block by layout: yield each layout with the indices of its messages."""
        pending = np.arange(len(block))
        layouts = iter(tuple(self._layouts))
        while pending.size:
            layout = next(layouts, None) or self._remember_layout(block.payload(pending[0]))
            fitting = layout.fitting(block[pending])
            if fitting.any():
                yield layout, pending[fitting]
                pending = pending[~fitting]

    def _remember_layout(self, payload: bytes) -> Layout:
        layout = self._parse(payload)
        self._layouts.appendleft(layout)
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
    """Convert times in a unit [s] to whole nanoseconds; times that are not finite become 0."""
    if np.issubdtype(times.dtype, np.integer) and unit * NANOSECONDS >= 1:
        return times.astype(np.int64) * round(unit * NANOSECONDS)
    nanoseconds = np.rint(times.astype(np.float64) * (unit * NANOSECONDS))
    return np.where(np.isfinite(nanoseconds), nanoseconds, 0).astype(np.int64)


def _numbers(messages: MessageBlock, place: Place) -> NDArray[Any]:
    """Return the number at a place of every message."""
    return gather(messages.data, place.dtype, messages.starts + place.offset)
