# SPDX-License-Identifier: Apache-2.0
"""
Places of the fields in a serialised message.

The messages of a topic mostly have the same layout: the first message determines the place of a number in all
messages. The layout follows from the message's definition and from the lengths of the strings and sequences in the
payload. Two payloads of equal size with equal lengths have the same layout.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys.store import Typestore

from cfd_pneumatic.messages.blocks import MessageBlock, gather
from cfd_pneumatic.messages.fields import NAMES, NUMBERS, FieldPath

PLACEHOLDER = 'structure_needs_at_least_one_member'
"""Field for the byte that replaces an empty message in CDR."""


class Serialization(Enum):
    """Serialisation of a bag's messages."""

    CDR = 'ROS 2: numbers aligned to their size, after four bytes with the byte order'
    ROS1 = 'ROS 1: packed, little endian'


class LayoutError(Exception):
    """A payload does not fit the definition of its type."""


_FEW = 4
"""Number of messages that are compared singly: with thousands of names, array operations cost more per message."""


@dataclass(frozen=True)
class Place:
    """Place of a number in a payload: offset in bytes, NumPy type."""

    offset: int
    dtype: str

    def number(self, payload: bytes) -> float:
        """Return the number in a payload."""
        return float(np.frombuffer(payload, self.dtype, 1, self.offset)[0])


class Layout:
    """
    Layout of a payload and of all payloads with the same lengths.

    Parameters
    ----------
    payload : bytes
        A serialised message.
    types : Typestore
        Definitions of the message's type and of the types inside it.
    msgtype : str
        Type of the message.
    serialization : Serialization
        Serialisation of the message.

    Raises
    ------
    LayoutError
        If the payload cannot be a message of this type.

    """

    def __init__(self, payload: bytes, types: Typestore, msgtype: str, serialization: Serialization) -> None:
        self.size = len(payload)
        self._payload = payload
        self._types = types
        self._aligned = serialization is Serialization.CDR
        self._order = '<'
        self._position = 0
        self._arrays: dict[str, tuple[Place, int]] = {}
        self._texts: dict[str, slice] = {}
        self._decisive: list[slice] = []
        if self._aligned:
            self._walk_encapsulation()
        self._origin = self._position
        self._padding = 3 if self._aligned else 0
        self._walk_message(msgtype, '')
        if not 0 <= self.size - self._position <= self._padding:
            raise LayoutError(f'has {self.size} bytes, but its definition requires {self._position}')

    def place(self, path: FieldPath) -> Place | None:
        """Return the place of a path's number; None if the payload has no such entry."""
        parent, array, entry = '', '', 0
        for step in path.steps:
            index = step.index
            if isinstance(index, str):
                names = self.names(parent)
                if index not in names:
                    return None
                index = names.index(index)
            entry = index or 0
            array = f'{parent}{step.name}'
            parent = f'{array}.' if index is None else f'{array}[{index}].'
        first, count = self._arrays.get(array, (Place(0, ''), 0))
        return Place(first.offset + entry * np.dtype(first.dtype).itemsize, first.dtype) if entry < count else None

    def names(self, parent: str = '') -> list[str]:
        """Return the names of the array entries of a message."""
        names: list[str] = []
        while (span := self._texts.get(f'{parent}{NAMES}[{len(names)}]')) is not None:
            names.append(self._payload[span].rstrip(b'\0').decode(errors='replace'))
        return names

    def fits(self, payload: bytes) -> bool:
        """Return whether a payload has this layout."""
        return len(payload) == self.size and all(payload[span] == self._payload[span] for span in self._decisive)

    def fitting(self, block: MessageBlock) -> NDArray[np.bool_]:
        """Return which messages have this layout: equal size, equal lengths, equal names of array entries."""
        fitting: NDArray[np.bool_] = block.sizes == self.size
        for span in self._decisive:
            indices = np.flatnonzero(fitting)
            if indices.size <= _FEW:
                fitting[indices] = [self.fits(block.payload(index)) for index in indices.tolist()]
                break
            texts = gather(block.data, f'V{span.stop - span.start}', block.starts[indices] + span.start)
            fitting[indices] = texts == np.void(self._payload[span])
        return fitting

    def _add_decisive(self, start: int, stop: int) -> None:
        """Add a span of bytes that are equal in all payloads of this layout."""
        if self._decisive and self._decisive[-1].stop == start:
            start = self._decisive.pop().start
        self._decisive.append(slice(start, stop))

    def _walk_encapsulation(self) -> None:
        encapsulation = self._payload[:2]
        if len(self._payload) < 4 or encapsulation not in (b'\0\0', b'\0\1'):
            raise LayoutError(f'begins with {encapsulation.hex()}, which is not plain CDR')
        self._order = '<' if encapsulation[1] else '>'
        self._add_decisive(0, 4)
        self._position = 4

    def _walk_message(self, msgtype: str, prefix: str) -> None:
        for name, desc in self._types.fielddefs[msgtype][1]:
            if name == PLACEHOLDER and not self._aligned:
                continue
            self._walk_field(desc, f'{prefix}{name}')

    def _walk_field(self, desc: FieldDesc, path: str) -> None:
        if desc[0] == Nodetype.NAME:
            self._walk_message(desc[1], f'{path}.')
        elif desc[0] == Nodetype.BASE and desc[1][0] == 'string':
            self._walk_text(path)
        elif desc[0] == Nodetype.BASE:
            self._walk_numbers(desc[1][0], 1, path)
        else:
            element, length = desc[1]
            count = length if desc[0] == Nodetype.ARRAY else self._walk_length()
            if element[0] == Nodetype.BASE and element[1][0] != 'string':
                self._walk_numbers(element[1][0], count, path)
                return
            for index in range(count):
                self._walk_field(element, f'{path}[{index}]')
                if self._position > self.size:
                    raise LayoutError(f'ends after {self.size} bytes, inside a message')

    def _walk_numbers(self, kind: str, count: int, path: str) -> None:
        if kind not in NUMBERS:
            raise LayoutError(f'holds a {kind}, which cannot be read')
        dtype = np.dtype(self._order + NUMBERS[kind])
        if count:
            self._align(dtype.itemsize)
        elif self._aligned:
            self._padding += dtype.itemsize  # rmw_serialize pads also before an empty sequence
        self._arrays[path] = (Place(self._position, dtype.str), count)
        self._position += count * dtype.itemsize

    def _walk_text(self, path: str) -> None:
        length = self._walk_length()
        text = slice(self._position, self._position + length)
        self._texts[path] = text
        if length and path.rpartition('.')[2].startswith(f'{NAMES}['):
            self._add_decisive(text.start, text.stop)
        self._position = text.stop

    def _walk_length(self) -> int:
        self._align(4)
        word = slice(self._position, self._position + 4)
        if word.stop > self.size:
            raise LayoutError(f'ends after {self.size} bytes, inside a message')
        self._add_decisive(word.start, word.stop)
        self._position = word.stop
        length = int.from_bytes(self._payload[word], 'little' if self._order == '<' else 'big')
        if length > self.size:
            raise LayoutError(f'has {self.size} bytes and a sequence of {length}')
        return length

    def _align(self, size: int) -> None:
        if self._aligned:
            self._position += (self._origin - self._position) % size
