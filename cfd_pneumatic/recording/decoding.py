"""From serialised messages to arrays, many messages at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.fields import FieldPath
from cfd_pneumatic.recording.layout import Layout, LayoutError, Place, Serialization
from cfd_pneumatic.recording.messages import NANOSECONDS


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
    values: NDArray[np.float64]
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

    def names(self, payload: bytes) -> list[str]:
        """Return the names of a message's entries, as JointState has them."""
        return self._layout(payload).names()

    def decode(self, payloads: Sequence[bytes]) -> Columns:
        """
        Return the numbers and stamps of messages.

        Raises
        ------
        InputError
            If a payload does not fit the type's definition.

        """
        count = len(payloads)
        columns = Columns(np.zeros(count, bool), np.zeros(count), np.zeros(count, np.int64))
        for layout, which, rows in self._alike(payloads):
            place = layout.place(self._value)
            if place is not None:
                columns.found[which] = True
                columns.values[which] = _column(rows, place)
            columns.stamps[which] = self._stamps(layout, rows)
        return columns

    def _alike(self, payloads: Sequence[bytes]) -> Iterator[tuple[Layout, NDArray[np.intp], NDArray[np.uint8]]]:
        """Sort payloads by layout: for each layout yield which they are and their bytes, a row for each."""
        sizes = np.fromiter(map(len, payloads), np.intp, len(payloads))
        pending = np.arange(len(payloads))
        while pending.size:
            layout = self._layout(payloads[pending[0]])
            candidates = pending[sizes[pending] == layout.size]
            joined = b''.join([payloads[index] for index in candidates])
            rows = np.frombuffer(joined, np.uint8).reshape(len(candidates), layout.size)
            deciding = rows[:, layout.deciding_bytes()]
            alike = (deciding == deciding[0]).all(axis=1)
            yield layout, candidates[alike], rows if alike.all() else rows[alike]
            pending = np.setdiff1d(pending, candidates[alike], assume_unique=True)

    def _layout(self, payload: bytes) -> Layout:
        try:
            return Layout(payload, self._types, self._msgtype, self._serialization)
        except LayoutError as error:
            raise InputError(
                f'a message {error}: the bag is damaged, or {self._msgtype} is not '
                'defined as it was recorded: check the files that `types` names in the mapping'
            ) from error

    def _stamps(self, layout: Layout, rows: NDArray[np.uint8]) -> NDArray[np.int64]:
        if isinstance(self._stamp, TimePaths):
            seconds, nanoseconds = layout.place(self._stamp.seconds), layout.place(self._stamp.nanoseconds)
            if seconds is not None and nanoseconds is not None:
                return _column(rows, seconds).astype(np.int64) * NANOSECONDS + _column(rows, nanoseconds).astype(
                    np.int64
                )
        elif isinstance(self._stamp, CounterPath):
            place = layout.place(self._stamp.counter)
            if place is not None:
                return in_nanoseconds(_column(rows, place), self._stamp.unit)
        return np.zeros(len(rows), np.int64)


def in_nanoseconds(times: NDArray[Any], unit: float) -> NDArray[np.int64]:
    """Return times in a unit [s] as whole nanoseconds; those that are not finite become 0."""
    if np.issubdtype(times.dtype, np.integer) and unit * NANOSECONDS >= 1:
        return times.astype(np.int64) * round(unit * NANOSECONDS)
    nanoseconds = np.rint(times.astype(np.float64) * (unit * NANOSECONDS))
    return np.where(np.isfinite(nanoseconds), nanoseconds, 0).astype(np.int64)


def _column(rows: NDArray[np.uint8], place: Place) -> NDArray[Any]:
    """Return the numbers at one place of every row."""
    dtype = np.dtype(place.dtype)
    record = np.dtype({'names': ['number'], 'formats': [dtype], 'offsets': [place.offset], 'itemsize': rows.shape[1]})
    column: NDArray[Any] = np.ascontiguousarray(rows).view(record)['number'][:, 0]
    return column
