# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types: those in the bag, those of ROS 2, and those of the user."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import make_typesdict
from rosbags.typesys.idl import IDLParser
from rosbags.typesys.msg import MSGParser
from rosbags.typesys.peg import Failure
from rosbags.typesys.store import Typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import check_input, read_input
from cfd_pneumatic.messages.layout import PLACEHOLDER
from cfd_pneumatic.messages.types import standard_types

if TYPE_CHECKING:
    from rosbags.typesys.peg import Result

FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros1msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
"""Language of a message definition, by its name in bags."""

MOST_FIELDS = 100_000
"""Fields of a message, including the messages inside it; a list of numbers counts once."""

MOST_STEPS = 400_000
"""Token matches for all definitions of a recording: some 25,000 lines, which take 2 s."""

LONGEST_PARSING = 10.0
"""Processor time for all definitions of a recording [s]; a single token match may scan a whole text."""

MOST_ENTRIES = 50_000
"""Files and folders in the folder of the user's definitions; listing so many takes a second."""

MOST_FILES = 2_000
"""Definitions in the user's folder; all of ROS 2 and its stacks has as many."""

LARGEST = 2**20
"""Size of a definition [bytes]."""

LARGEST_TOGETHER = 16 * LARGEST
"""Size of all definitions in a folder [bytes]."""

LONGEST_ARRAY = 2**32 - 1
"""Entries of an array; a message's length has 32 bits."""

_IDL_SEPARATOR = '=' * 80 + '\n'


class Definitions:
    """
    Definitions of the messages of a recording, each parsed once.

    Parameters
    ----------
    folder : Path, optional
        Folder with the user's definitions: PACKAGE/msg/NAME.msg or PACKAGE/NAME.msg, at any depth. The folder may
        be the package.

    Raises
    ------
    InputError
        If the folder has no definitions, or too many.

    """

    def __init__(self, folder: Path | None = None) -> None:
        self._files = {} if folder is None else _files_by_type(folder)
        self._parsed: dict[tuple[str, str], Typesdict] = {}
        self._steps, self._seconds = MOST_STEPS, LONGEST_PARSING

    def for_topic(self, connections: Sequence[Connection]) -> Typestore:
        """
        Return the definitions for a topic: those in the bag, else those of the user and of ROS 2.

        Raises
        ------
        InputError
            If the topic's type, or a type inside it, has no definition, its connections define it differently, or a
            definition cannot be parsed.

        """
        distinct = {(connection.msgdef.format, connection.msgdef.data): connection for connection in connections}
        types, *more_types = [self._for_connection(connection) for connection in distinct.values()]
        msgtype = connections[0].msgtype
        if any(_fields_by_type(store, msgtype) != _fields_by_type(types, msgtype) for store in more_types):
            raise InputError(
                f'topic {connections[0].topic} has messages of two definitions of {msgtype}: '
                'split the bag, or remove the messages of one publisher'
            )
        return types

    def _for_connection(self, connection: Connection) -> Typestore:
        is_stored = connection.msgdef.format != MessageDefinitionFormat.NONE
        types = self._stored_types(connection) if is_stored else self._user_types(connection.msgtype)
        try:
            fields_by_type = _fields_by_type(types, connection.msgtype)
            missing = next((name for name, fields in fields_by_type.items() if fields is None), None)
            if missing is not None:
                description = f'of type {connection.msgtype}'
                if missing != connection.msgtype:  # the contents of the user's definitions may be secret
                    description = f'that hold {missing if is_stored else "another type"} (inside {connection.msgtype})'
                raise InputError(
                    f'topic {connection.topic} has messages {description}, which is unknown: '
                    'in a mapping file give `types:`, the folder with its .msg files'
                )
            if _count_fields(types, connection.msgtype, {}) > MOST_FIELDS:
                raise InputError(
                    f'the definition of {connection.msgtype} holds more than {MOST_FIELDS:,} fields, or itself: '
                    'leave the topic out'
                )
        except RecursionError as error:
            raise InputError(f'the definition of {connection.msgtype} is nested too deeply') from error
        return types

    def _stored_types(self, connection: Connection) -> Typestore:
        """Return the definitions of a type that are in the bag."""
        types = get_typestore(Stores.EMPTY)
        try:
            if len(connection.msgdef.data) > LARGEST:
                raise InputError(f'has more than {LARGEST // 2**20} MiB')
            for text in _definition_texts(connection.msgdef):
                _add_definitions(types, self._parse(text, connection.msgtype, connection.msgdef.format))
        except InputError as error:
            raise InputError(f'the definition of {connection.msgtype} in the bag {error}') from error
        return types

    def _user_types(self, msgtype: str) -> Typestore:
        """Return the types of ROS 2, with the user's definitions of a type and of the types inside it."""
        if msgtype not in self._files:
            return standard_types()
        types = get_typestore(Stores.LATEST)
        waiting, done = [msgtype], set()
        while waiting:
            name = waiting.pop()
            if name in done:
                continue
            done.add(name)
            for rank, file in enumerate(self._files.get(name, ())):
                try:
                    text = read_input(file, LARGEST).decode()
                    parsed = {name: self._parse(text, name, MessageDefinitionFormat.MSG)[name]}
                    if rank and _fields(parsed) != _fields({name: types.fielddefs[name]}):
                        raise InputError(f'defines {name} differently from {self._files[name][0]}: remove one of them')
                    _add_definitions(types, parsed)
                except UnicodeDecodeError as error:
                    raise InputError(f'{file} is not a message definition: it is not text in UTF-8') from error
                except InputError as error:
                    raise InputError(f'{file} {error}') from error
            waiting += filter(None, map(_message_in, (desc for _, desc in types.fielddefs.get(name, ((), ()))[1])))
        return types

    def _parse(self, text: str, msgtype: str, kind: MessageDefinitionFormat) -> Typesdict:
        """Return the types that a text defines."""
        if (text, msgtype) not in self._parsed:
            parser = _MsgParser(f'MSG: {msgtype}\n{text}') if kind == MessageDefinitionFormat.MSG else _IdlParser(text)
            parser.steps, parser.deadline = self._steps, time.thread_time() + self._seconds
            try:
                self._parsed[text, msgtype] = make_typesdict(parser.specification())
            except InputError:
                raise
            except Exception as error:  # rosbags raises exceptions of any type for an invalid text
                line = parser.line_reached - (kind == MessageDefinitionFormat.MSG)
                raise InputError(f'is not a message definition: line {line} cannot be parsed') from error
            self._steps, self._seconds = parser.steps, parser.deadline - time.thread_time()
        return self._parsed[text, msgtype]


def has_same_fields(types: Typestore, reference: Typestore, msgtype: str) -> bool:
    """Return whether two stores define a message, and all messages inside it, with the same fields."""
    return _fields_by_type(types, msgtype) == _fields_by_type(reference, msgtype)


class _BoundedParser:
    """A rosbags parser with limits: rosbags can parse a short text for hours."""

    text: str
    steps: int
    """Number of token matches that the parser may still try."""

    deadline: float
    """Processor time of the thread at which the parser stops [s]."""

    _farthest = 0

    @property
    def line_reached(self) -> int:
        """The last line that the parser reached, counted from 1."""
        return self.text.count('\n', 0, self._farthest) + 1

    def literal(self, pos: int, text: str) -> Result[str]:
        self._count(pos)
        return super().literal(pos, text)  # type: ignore[misc,no-any-return]

    def regex(self, pos: int, pattern: str, flags: int = 0) -> Result[str]:
        self._count(pos)
        return super().regex(pos, pattern, flags)  # type: ignore[misc,no-any-return]

    def _count(self, pos: int) -> None:
        self.steps -= 1
        self._farthest = max(self._farthest, pos)
        if self.steps < 0 or time.thread_time() > self.deadline:
            raise InputError('takes too long to parse: remove unused definitions')


class _MsgParser(_BoundedParser, MSGParser):
    pass


class _IdlParser(_BoundedParser, IDLParser):
    def _binop(self, pos: int, *_: object) -> Failure:
        """Refuse computed constants: their numbers may have any length, and ROS does not write them."""
        return Failure(pos, '', set())


def _files_by_type(folder: Path) -> dict[str, list[Path]]:
    """Return the files of definitions in a folder, at any depth, by message type."""
    files: dict[str, list[Path]] = {}
    count = size = 0
    for file in sorted(_definitions_below(folder)):
        try:
            check_input(file)
            bytes_ = file.stat().st_size
            if bytes_ > LARGEST:
                raise InputError(f'has more than {LARGEST // 2**20} MiB')
        except InputError as error:
            raise InputError(f'{file} {error}') from error
        count, size = count + 1, size + bytes_
        if count > MOST_FILES or size > LARGEST_TOGETHER:
            raise InputError(
                f'{folder} holds more than {MOST_FILES:,} .msg files or {LARGEST_TOGETHER // 2**20} MiB of them: '
                'name the folder of the needed package in `types`'
            )
        package = file.parent.parent if file.parent.name == 'msg' else file.parent
        files.setdefault(f'{package.name}/msg/{file.stem}', []).append(file)
    if not files:
        raise InputError(
            f'{folder} holds no .msg files: name the folder with the definitions of your messages in `types`'
        )
    return files


def _definitions_below(folder: Path) -> Iterator[Path]:
    """Yield the paths below a folder that end in .msg; skip hidden entries and do not enter linked folders."""
    pending = [folder.resolve()]
    count = 0
    while pending:
        try:
            with os.scandir(pending.pop()) as entries:
                for entry in entries:
                    count += 1
                    if count > MOST_ENTRIES:
                        raise InputError(
                            f'{folder} holds more than {MOST_ENTRIES:,} files and folders: '
                            'name the folder of the needed package in `types`'
                        )
                    if entry.name.startswith('.'):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        pending.append(Path(entry.path))
                    elif entry.name.endswith('.msg'):
                        yield Path(entry.path)
        except OSError:  # the user has no permission to list the folder
            continue


def _definition_texts(definition: MessageDefinition) -> list[str]:
    """Return the texts of a definition; IDL has a text for each type."""
    text = definition.data
    if definition.format == MessageDefinitionFormat.MSG or not text.startswith(f'{_IDL_SEPARATOR}IDL: '):
        return [text]
    return [part.partition('\n')[2] for part in text.split(_IDL_SEPARATOR)[1:]]


def _add_definitions(types: Typestore, parsed: Typesdict) -> None:
    """Add definitions to a store, without the classes that `Typestore.register` would compile."""
    for name, (_, fields) in parsed.items():
        if len({field for field, _ in fields}) < len(fields):
            raise InputError(f'is not a message definition: {name} has two fields of one name')
        if not all(0 <= desc[1][1] <= LONGEST_ARRAY for _, desc in fields if desc[0] == Nodetype.ARRAY):
            raise InputError(f'is not a message definition: {name} has an array of impossible length')
    types.fielddefs.update({name: ([], fields) for name, fields in _fields(parsed).items()})


def _fields(parsed: Typesdict) -> dict[str, list[tuple[str, FieldDesc]]]:
    """Return the fields of each message; a message without fields gets a placeholder byte."""
    placeholder: list[tuple[str, FieldDesc]] = [(PLACEHOLDER, (Nodetype.BASE, ('uint8', 0)))]
    return {name: list(fields) or placeholder for name, (_, fields) in parsed.items()}


def _fields_by_type(types: Typestore, msgtype: str) -> dict[str, Any]:
    """Return the fields of a message and of all messages inside it, by type; None for an undefined type."""
    fields_by_type: dict[str, Any] = {}
    pending = [msgtype]
    while pending:
        name = pending.pop()
        if name not in fields_by_type:
            fields_by_type[name] = types.fielddefs[name][1] if name in types.fielddefs else None
            fields = fields_by_type[name] or ()
            pending += [inner for _, desc in fields if (inner := _message_in(desc)) is not None]
    return fields_by_type


def _count_fields(types: Typestore, msgtype: str, sizes: dict[str, int]) -> int:
    """Return the number of fields of a message; fields of messages inside it count at each occurrence."""
    if msgtype not in sizes:
        sizes[msgtype] = MOST_FIELDS + 1  # during the count: a message that contains itself has no end
        count = 0
        for _, desc in types.fielddefs[msgtype][1]:
            inner = _message_in(desc)
            length = desc[1][1] if desc[0] == Nodetype.ARRAY and not _is_list_of_numbers(desc) else 1
            count += length * (1 if inner is None else _count_fields(types, inner, sizes))
        sizes[msgtype] = min(count, MOST_FIELDS + 1)
    return sizes[msgtype]


def _is_list_of_numbers(desc: FieldDesc) -> bool:
    element = desc[1][0]
    return bool(element[0] == Nodetype.BASE and element[1][0] != 'string')


def _message_in(desc: FieldDesc) -> str | None:
    """Return the message type of a field or of its entries; None for numbers and texts."""
    element = desc[1][0] if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else desc
    return element[1] if element[0] == Nodetype.NAME else None
