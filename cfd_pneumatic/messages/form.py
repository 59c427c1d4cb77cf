# SPDX-License-Identifier: Apache-2.0
"""Forms of serialised messages: templates with blanks for the stamp and a number."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys.store import Typestore

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import JOINT_STATE
from cfd_pneumatic.messages.blocks import MessageBlock
from cfd_pneumatic.messages.fields import NUMBERS, FieldPath, parse_path
from cfd_pneumatic.messages.layout import Layout, Place, Serialization
from cfd_pneumatic.messages.types import NANOSECONDS, obvious_field, types_with

SECOND, NANOSECOND = parse_path('header.stamp.sec'), parse_path('header.stamp.nanosec')
"""Paths of a header's stamp."""

_STAMP = struct.Struct('<iI')


class Form:
    """
    Template of a serialised message of a standard type: blanks for a number and, if the type has a header, a stamp.

    Filling the blanks is fast. Serialising a new message takes longer than a step of the model.

    Parameters
    ----------
    msgtype : str
        JointState, FluidPressure, WrenchStamped, Float64 or another type with an obvious number.
    joint : str
        Name of the joint in a JointState.
    axis : str
        Axis of the force in a WrenchStamped.
    frame_id : str
        Frame in the header.

    """

    def __init__(self, msgtype: str, *, joint: str = '', axis: str = 'x', frame_id: str = '') -> None:
        self.msgtype = msgtype
        types = types_with(msgtype)
        message = _blank(types, msgtype)
        if msgtype == JOINT_STATE:
            message.name, message.position = [joint], np.zeros(1)
        if hasattr(message, 'header'):
            message.header.frame_id = frame_id
        self.payload = bytes(types.serialize_cdr(message, msgtype))
        layout = Layout(self.payload, types, msgtype, Serialization.CDR)
        field = obvious_field(msgtype, joint='0', force_axis=axis)
        assert field is not None
        places = {'number': _place(layout, parse_path(field))}
        self._has_stamp = hasattr(message, 'header')
        if self._has_stamp:
            places |= {'sec': _place(layout, SECOND), 'nanosec': _place(layout, NANOSECOND)}
        self._blanks = np.dtype(
            {
                'names': list(places),
                'formats': [place.dtype for place in places.values()],
                'offsets': [place.offset for place in places.values()],
                'itemsize': len(self.payload),
            }
        )
        self._buffer = bytearray(self.payload)
        self._stamp_at = places['sec'].offset if self._has_stamp else 0
        self._number, self._number_at = struct.Struct(np.dtype(places['number'].dtype).char), places['number'].offset

    def filled(self, stamp: int, number: float) -> bytes:
        """Return a message with a stamp [ns] and a number."""
        if self._has_stamp:
            _STAMP.pack_into(self._buffer, self._stamp_at, *divmod(stamp, NANOSECONDS))
        self._number.pack_into(self._buffer, self._number_at, number)
        return bytes(self._buffer)

    def block(self, times: NDArray[np.int64], numbers: Array) -> MessageBlock:
        """Return messages with numbers, shape (n,), which are stamped and received at times [ns], shape (n,)."""
        rows = np.full(times.size, np.void(self.payload))
        blanks = rows.view(self._blanks)
        blanks['number'] = numbers
        if self._has_stamp:
            blanks['sec'], blanks['nanosec'] = np.divmod(times, NANOSECONDS)
        size = len(self.payload)
        return MessageBlock(times, rows.tobytes(), size * np.arange(times.size), np.full(times.size, size))


def _place(layout: Layout, path: FieldPath) -> Place:
    place = layout.place(path)
    assert place is not None
    return place


def _blank(types: Typestore, msgtype: str) -> Any:
    """Return a message of zeros and empty texts."""
    fields = types.fielddefs[msgtype][1]
    return types.types[msgtype](**{name: _zero(types, desc) for name, desc in fields})


def _zero(types: Typestore, desc: FieldDesc) -> Any:
    if desc[0] == Nodetype.NAME:
        return _blank(types, desc[1])
    if desc[0] == Nodetype.BASE:
        return '' if desc[1][0] == 'string' else 0
    element, length = desc[1]
    if element[0] == Nodetype.BASE and element[1][0] in NUMBERS:
        return np.zeros(length if desc[0] == Nodetype.ARRAY else 0, NUMBERS[element[1][0]])
    return [_zero(types, element) for _ in range(length if desc[0] == Nodetype.ARRAY else 0)]
