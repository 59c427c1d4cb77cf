# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types: a bag's own, ROS 2's, and those that the user gives."""

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
"""How message definitions are written, by what files call it."""

MOST_FIELDS = 100_000
"""Of a message, with all that is inside it; lists of numbers count once."""

MOST_STEPS = 400_000
"""Words and marks that are looked for in all definitions of a recording: some 25,000 lines, which take 2 s."""

LONGEST_PARSING = 10.0
"""Time of the processor for all definitions of a recording: one look may go over a whole text [s]."""

MOST_ENTRIES = 50_000
"""Files and folders in the folder of the user's definitions, which are looked through in a second."""

MOST_FILES = 2_000
"""Definitions in that folder; all of ROS 2 and its stacks has as many."""

LARGEST = 2**20
"""Bytes of a definition."""

LARGEST_TOGETHER = 16 * LARGEST
"""Bytes of all definitions in a folder."""

LONGEST_ARRAY = 2**32 - 1
"""Entries of an array; a message counts its bytes with as many bits."""

_IDL_SEPARATOR = '=' * 80 + '\n'


class Definitions:
    """
    The definitions that the messages of a recording have, each parsed once.

    Parameters
    ----------
    folder : Path, optional
        Folder with the user's definitions: PACKAGE/msg/NAME.msg or PACKAGE/NAME.msg, at any depth; the folder may
        itself be the package.

    Raises
    ------
    InputError
        If there are no such files, or more than can be meant.

    """

    def __init__(self, folder: Path | None = None) -> None:
        self._files = {} if folder is None else _files_by_type(folder)
        self._parsed: dict[tuple[str, str], Typesdict] = {}
        self._steps, self._seconds = MOST_STEPS, LONGEST_PARSING

    def of(self, connections: Sequence[Connection]) -> Typestore:
        """
        Return the definitions for a topic: those in the bag, else the user's and ROS 2's.

        Raises
        ------
        InputError
            If the topic's type, or one inside it, is defined nowhere, its connections define it in two ways, or a
            definition can't be parsed.

        """
        distinct = {(connection.msgdef.format, connection.msgdef.data): connection for connection in connections}
        types, *others = [self._of(connection) for connection in distinct.values()]
        msgtype = connections[0].msgtype
        if any(_needed(other, msgtype) != _needed(types, msgtype) for other in others):
            raise InputError(
                f'topic {connections[0].topic} has messages of two definitions of {msgtype}: '
                'split the bag, or leave out what one of its publishers sent'
            )
        return types

    def _of(self, connection: Connection) -> Typestore:
        stored = connection.msgdef.format != MessageDefinitionFormat.NONE
        types = self._in_the_bag(connection) if stored else self._given(connection.msgtype)
        try:
            needed = _needed(types, connection.msgtype)
            missing = next((name for name, fields in needed.items() if fields is None), None)
            if missing is not None:
                which = f'of type {connection.msgtype}'
                if missing != connection.msgtype:  # what the user's definitions name is not quoted
                    which = f'that hold {missing if stored else "another type"} (inside {connection.msgtype})'
                raise InputError(
                    f'topic {connection.topic} has messages {which}, which is unknown: '
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

    def _in_the_bag(self, connection: Connection) -> Typestore:
        types = get_typestore(Stores.EMPTY)
        try:
            if len(connection.msgdef.data) > LARGEST:
                raise InputError(f'has more than {LARGEST // 2**20} MiB')
            for text in _parts(connection.msgdef):
                _add(types, self._parse(text, connection.msgtype, connection.msgdef.format))
        except InputError as error:
            raise InputError(f'the definition of {connection.msgtype} in the bag {error}') from error
        return types

    def _given(self, msgtype: str) -> Typestore:
        """Return the user's definitions of a type and of those inside it, among those of ROS 2."""
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
                        raise InputError(f'is another definition of {name} than {self._files[name][0]}: give one')
                    _add(types, parsed)
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
            except Exception as error:  # rosbags raises whatever a text makes it stumble over
                line = parser.line_reached - (kind == MessageDefinitionFormat.MSG)
                raise InputError(f'is not a message definition: line {line} cannot be parsed') from error
            self._steps, self._seconds = parser.steps, parser.deadline - time.thread_time()
        return self._parsed[text, msgtype]


class _Bounded:
    """A parser of rosbags that gives up: there are short texts that it reads for hours."""

    text: str
    steps: int
    """How many words and marks it may still look for."""

    deadline: float
    """Until when, in the thread's time [s]."""

    _farthest = 0

    @property
    def line_reached(self) -> int:
        """The line that it came to, from 1 on."""
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
            raise InputError('takes too long to parse: leave out what is not needed')


class _MsgParser(_Bounded, MSGParser):
    pass


class _IdlParser(_Bounded, IDLParser):
    def _binop(self, pos: int, *_: object) -> Failure:
        """Refuse constants that are computed, which ROS does not write: their numbers may have any length."""
        return Failure(pos, '', set())


def _files_by_type(folder: Path) -> dict[str, list[Path]]:
    """Return the definitions in a folder, at any depth, by their types."""
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
                'let `types` name the folder of the package that is needed'
            )
        package = file.parent.parent if file.parent.name == 'msg' else file.parent
        files.setdefault(f'{package.name}/msg/{file.stem}', []).append(file)
    if not files:
        raise InputError(
            f'{folder} holds no .msg files: `types` names the folder with the definitions of your messages'
        )
    return files


def _definitions_below(folder: Path) -> Iterator[Path]:
    """Yield what a folder holds, at any depth, that is named as a definition, but nothing hidden or linked."""
    waiting = [folder.resolve()]
    seen = 0
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    seen += 1
                    if seen > MOST_ENTRIES:
                        raise InputError(
                            f'{folder} holds more than {MOST_ENTRIES:,} files and folders: let `types` name the folder '
                            'of the package that is needed'
                        )
                    if entry.name.startswith('.'):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(Path(entry.path))
                    elif entry.name.endswith('.msg'):
                        yield Path(entry.path)
        except OSError:  # one may not look into it
            continue


def _parts(definition: MessageDefinition) -> list[str]:
    """Return the texts of a definition; IDL has one for each type."""
    text = definition.data
    if definition.format == MessageDefinitionFormat.MSG or not text.startswith(f'{_IDL_SEPARATOR}IDL: '):
        return [text]
    return [part.partition('\n')[2] for part in text.split(_IDL_SEPARATOR)[1:]]


def _add(types: Typestore, parsed: Typesdict) -> None:
    """Add definitions to a store. Its own method would compile a class of each, which nobody needs to read messages."""
    for name, (_, fields) in parsed.items():
        if len({field for field, _ in fields}) < len(fields):
            raise InputError(f'is not a message definition: {name} has two fields of one name')
        if not all(0 <= desc[1][1] <= LONGEST_ARRAY for _, desc in fields if desc[0] == Nodetype.ARRAY):
            raise InputError(f'is not a message definition: {name} has an array of impossible length')
    types.fielddefs.update({name: ([], fields) for name, fields in _fields(parsed).items()})


def _fields(parsed: Typesdict) -> dict[str, list[tuple[str, FieldDesc]]]:
    """Return the fields of messages; one without any has a byte in its place."""
    nothing: list[tuple[str, FieldDesc]] = [(PLACEHOLDER, (Nodetype.BASE, ('uint8', 0)))]
    return {name: list(fields) or nothing for name, (_, fields) in parsed.items()}


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
