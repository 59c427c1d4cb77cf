# SPDX-License-Identifier: Apache-2.0
"""Decode a single message with all of its fields; `Decoder` reads one number of many messages."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages.definitions import Definitions, has_same_fields
from cfd_pneumatic.messages.layout import Serialization
from cfd_pneumatic.messages.types import standard_types

LARGEST_MESSAGE = 16 * 2**20
"""Size of a message [bytes]: 200,000 poses. A decoded message of many small parts takes 30 times the memory."""

_ENCAPSULATIONS = {b'\0\0': 'be', b'\0\1': 'le'}


def decode_whole(payload: bytes, connections: Sequence[Connection], serialization: Serialization) -> Any:
    """
    Return a message of a type that ROS ships, with all of its fields.

    Parameters
    ----------
    payload : bytes
        The serialised message.
    connections : sequence of Connection
        Connections of the message's topic, with the definition of its type.
    serialization : Serialization
        Serialisation of the message.

    Raises
    ------
    InputError
        If the message is too large or damaged, or the bag defines its type differently from ROS.

    """
    msgtype = connections[0].msgtype
    types = _shipped_types(serialization)
    if not has_same_fields(Definitions().for_topic(connections), types, msgtype):
        raise InputError(f'the bag defines {msgtype} differently from ROS: convert the message to the type of ROS')
    if len(payload) > LARGEST_MESSAGE:
        raise InputError(f'a {msgtype} has more than {LARGEST_MESSAGE // 2**20} MiB: publish fewer points')
    definition = types.get_msgdef(msgtype)
    try:
        # Typestore.deserialize_cdr refuses the unused bytes that rmw_serialize leaves at the end of a message.
        if serialization is Serialization.ROS1:
            message, size = definition.deserialize_ros1(payload, 0, definition.cls, types)
        else:
            order = _ENCAPSULATIONS[payload[:2]]
            deserialize = definition.deserialize_cdr_le if order == 'le' else definition.deserialize_cdr_be
            message, size = deserialize(payload[4:], 0, definition.cls, types)
            size += 4
    except Exception as error:  # rosbags raises exceptions of several types for damaged messages
        raise InputError(f'a {msgtype} is damaged: record it again') from error
    if size > len(payload):
        raise InputError(f'a {msgtype} is damaged: it ends after {len(payload)} bytes; record it again')
    return message


@cache
def _shipped_types(serialization: Serialization) -> Typestore:
    """Return the message types that ROS ships. Shared: do not register types in it."""
    return standard_types() if serialization is Serialization.CDR else get_typestore(Stores.ROS1_NOETIC)
