# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types: a bag's own, ROS 2's, and those that the user gives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.messages import standard_types
from cfd_pneumatic.recording.wording import reason_of

FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
"""How message definitions are written, by what files call it."""

MOST_FIELDS = 100_000
"""Of a message, with all that is inside it; lists of numbers count once."""

_LARGEST = 1024 * 1024
"""Bytes of a definition."""

_IDL_SEPARATOR = '=' * 80 + '\n'


def read_types(folder: Path) -> Typestore:
    """
    Return ROS 2's message types and those of a folder's .msg files.

    A file is PACKAGE/msg/NAME.msg or PACKAGE/NAME.msg, at any depth; the folder may itself be the package.

    Raises
    ------
    InputError
        If there are no such files or one can't be parsed.

    """
    files = sorted(folder.resolve().rglob('*.msg'))
    if not files:
        raise InputError(
            f'{folder} holds no .msg files: `types` names the folder with the definitions of your messages'
        )
    types = get_typestore(Stores.LATEST)
    for file in files:
        package = file.parent.parent if file.parent.name == 'msg' else file.parent
        try:
            types.register(get_types_from_msg(file.read_text(encoding='utf-8'), f'{package.name}/msg/{file.stem}'))
        except Exception as error:  # rosbags raises whatever a text makes it stumble over
            raise InputError(f'{file} is not a message definition: {reason_of(error)}') from error
    return types


def types_of(connections: Sequence[Connection], extra: Typestore | None) -> Typestore:
    """
    Return the definitions for a topic: those in the bag, else ROS 2's and the user's.

    Raises
    ------
    InputError
        If the topic's type, or one inside it, is defined nowhere, or its connections define it in two ways.

    """
    types, *others = [_types_of(connection, extra) for connection in connections]
    msgtype = connections[0].msgtype
    if any(_needed(other, msgtype) != _needed(types, msgtype) for other in others):
        raise InputError(
            f'topic {connections[0].topic} has messages of two definitions of {msgtype}: '
            'split the bag, or leave out what one of its publishers sent'
        )
    return types


def _types_of(connection: Connection, extra: Typestore | None) -> Typestore:
    if connection.msgdef.format == MessageDefinitionFormat.NONE:
        types = extra or standard_types()
    else:
        types = get_typestore(Stores.EMPTY)
        try:
            types.register(_parse(connection))
        except Exception as error:  # rosbags raises whatever a text makes it stumble over
            raise InputError(
                f'the definition of {connection.msgtype} in the bag cannot be parsed: {reason_of(error)}'
            ) from error
    try:
        needed = _needed(types, connection.msgtype)
        missing = next((name for name, fields in needed.items() if fields is None), None)
        if missing is not None:
            inside = '' if missing == connection.msgtype else f' (inside {connection.msgtype})'
            raise InputError(
                f'topic {connection.topic} has messages of type {missing}{inside}, which is unknown: '
                'in a mapping file give `types:`, the folder with its .msg files'
            )
        if _unfolded(types, connection.msgtype, {}) > MOST_FIELDS:
            raise InputError(
                f'the definition of {connection.msgtype} holds more than {MOST_FIELDS:,} fields, or itself: '
                'leave the topic out'
            )
    except RecursionError as error:
        raise InputError(f'the definition of {connection.msgtype} is nested too deeply') from error
    return types


def _parse(connection: Connection) -> Typesdict:
    text = connection.msgdef.data
    if len(text) > _LARGEST:
        raise InputError(f'the definition of {connection.msgtype} in the bag has more than {_LARGEST // 1024} KiB')
    if connection.msgdef.format == MessageDefinitionFormat.MSG:
        return get_types_from_msg(text, connection.msgtype)
    if not text.startswith(f'{_IDL_SEPARATOR}IDL: '):
        return get_types_from_idl(text)
    types: Typesdict = {}
    for part in text.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.partition('\n')[2]))
    return types


def _needed(types: Typestore, msgtype: str) -> dict[str, Any]:
    """Return the fields of a message and of all inside it, by type; None of one that is not defined."""
    needed: dict[str, Any] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed[name] = types.fielddefs[name][1] if name in types.fielddefs else None
            waiting += [inside for _, desc in needed[name] or () if (inside := _message_in(desc)) is not None]
    return needed


def _unfolded(types: Typestore, msgtype: str, sizes: dict[str, int]) -> int:
    """Return how many fields a message has, those of messages inside it counted each time that they are there."""
    if msgtype not in sizes:
        sizes[msgtype] = MOST_FIELDS + 1  # while it is counted: what holds itself has no end
        count = 0
        for _, desc in types.fielddefs[msgtype][1]:
            inside = _message_in(desc)
            length = desc[1][1] if desc[0] == Nodetype.ARRAY and not _is_list_of_numbers(desc) else 1
            count += length * (1 if inside is None else _unfolded(types, inside, sizes))
        sizes[msgtype] = min(count, MOST_FIELDS + 1)
    return sizes[msgtype]


def _is_list_of_numbers(desc: FieldDesc) -> bool:
    element = desc[1][0]
    return bool(element[0] == Nodetype.BASE and element[1][0] != 'string')


def _message_in(desc: FieldDesc) -> str | None:
    """Return the type of the message that a field is, or of those that it lists."""
    element = desc[1][0] if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else desc
    return element[1] if element[0] == Nodetype.NAME else None
