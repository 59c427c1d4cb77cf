"""Definitions of message types: a bag's own, ROS 2's, and those that the user gives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.messages import standard_types
from cfd_pneumatic.recording.wording import reason_of

FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
"""How message definitions are written, by what files call it."""

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
        except (TypesysError, UnicodeDecodeError) as error:
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
    if any(_fields(other, msgtype) != _fields(types, msgtype) for other in others):
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
        except TypesysError as error:
            raise InputError(
                f'the definition of {connection.msgtype} in the bag cannot be parsed: {reason_of(error)}'
            ) from error
    missing = _undefined(types, connection.msgtype)
    if missing is not None:
        inside = '' if missing == connection.msgtype else f' (inside {connection.msgtype})'
        raise InputError(
            f'topic {connection.topic} has messages of type {missing}{inside}, which is unknown: '
            'in a mapping file give `types:`, the folder with its .msg files'
        )
    return types


def _parse(connection: Connection) -> Typesdict:
    text = connection.msgdef.data
    if connection.msgdef.format == MessageDefinitionFormat.MSG:
        return get_types_from_msg(text, connection.msgtype)
    if not text.startswith(f'{_IDL_SEPARATOR}IDL: '):
        return get_types_from_idl(text)
    types: Typesdict = {}
    for part in text.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.partition('\n')[2]))
    return types


def _fields(types: Typestore, msgtype: str) -> list[Any]:
    """Return the names and types of a message's fields, and of the fields of messages inside it."""
    return [
        (name, desc, inside and _fields(types, inside))
        for name, desc in types.fielddefs[msgtype][1]
        for inside in [_message_in(desc)]
    ]


def _undefined(types: Typestore, msgtype: str) -> str | None:
    """Return the first type that a message needs and that is not defined."""
    if msgtype not in types.fielddefs:
        return msgtype
    for _, desc in types.fielddefs[msgtype][1]:
        inside = _message_in(desc)
        if inside is not None and (missing := _undefined(types, inside)) is not None:
            return missing
    return None


def _message_in(desc: FieldDesc) -> str | None:
    """Return the type of the message that a field is, or of those that it lists."""
    element = desc[1][0] if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else desc
    return element[1] if element[0] == Nodetype.NAME else None
