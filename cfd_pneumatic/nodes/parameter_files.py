# SPDX-License-Identifier: Apache-2.0
"""Checks of the parameter files and arguments on a node's command line."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

from rclpy.node import Node

from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.files import YamlMapping, check_input, read_yaml

_OPTION = '--params-file'
_WITH_VALUE = {
    _OPTION, '-p', '--param', '-r', '--remap', '-e', '--enclave', '--log-level', '--log-file-name', '--log-config-file'
}  # fmt: skip
_SWITCH = re.compile('--(enable|disable)-[a-z-]+')
_FILE_OPTION = re.compile('-*params?[-_]files?(:?=(?P<value>.*))?')
_SUFFIXES = ('.yaml', '.yml')
_WILDCARDS = {'*': '/[^/]+', '**': '(/[^/]+)*'}
_MOST_SHOWN = 5  # names in a message


def check_arguments(program: str, arguments: Sequence[str]) -> None:
    """
    Check that ROS reads all arguments, and that parameter files are no pipes, for which ROS would wait.

    Raises
    ------
    InputError
        If an argument is outside `--ros-args`, where ROS does not read it, or a parameter file is no file.

    """
    for path in filter(os.path.exists, _parameter_files(arguments)):  # ROS reports a missing file
        try:
            check_input(Path(path))
        except InputError as error:
            raise InputError(f'{printable(path)} {error}') from error
    accepted, strays = _split_arguments(arguments)
    if not strays:
        return
    first, corrected = printable(strays[0]), list(_suggest_arguments(strays))
    if not corrected:
        raise InputError(f'{first} is no argument of {program}: see {program} --help')
    line = printable(shlex.join([program, '--ros-args', *accepted, *corrected]))
    is_outside = '--ros-args' not in arguments[: arguments.index(strays[0])]
    raise InputError(f'{first} {"is outside --ros-args" if is_outside else "belongs to no option"}: {line}')


def _split_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments that ROS reads, and the stray arguments; `--` ends the arguments that ROS reads."""
    accepted, strays = [], []
    is_ros = False
    remaining = iter(arguments)
    for argument in remaining:
        if argument == '--ros-args':
            is_ros = True
        elif argument == '--' and is_ros:
            is_ros = False
        elif is_ros and argument in _WITH_VALUE:
            accepted += [argument, *islice(remaining, 1)]
        elif is_ros and _SWITCH.fullmatch(argument):
            accepted.append(argument)
        else:
            strays.append(argument)
    return accepted, strays


def _suggest_arguments(strays: Sequence[str]) -> Iterator[str]:
    """Yield valid arguments with the likely meaning of stray arguments."""
    remaining = iter(strays)
    for argument in remaining:
        option = _FILE_OPTION.fullmatch(argument)
        if argument in _WITH_VALUE or (option and not option['value']):
            for value in islice(remaining, 1):
                yield from (_OPTION if option else argument, value)
        elif option:
            yield from (_OPTION, option['value'])
        elif argument.lower().endswith(_SUFFIXES) or os.path.isfile(argument):
            yield from (_OPTION, argument)
        elif ':=' in argument:
            is_remap = argument.startswith('__') or argument.partition(':=')[2].startswith('/')
            yield from ('-r' if is_remap else '-p', argument)


def has_files() -> bool:
    """Return whether the command line gives a parameter file."""
    return any(_parameter_files(sys.argv))


def unread_files(node: Node) -> Iterator[str]:
    """Yield a warning for each parameter file on the command line that has no section for the node."""
    node_name = node.get_fully_qualified_name()
    for path in _parameter_files(sys.argv):
        try:
            sections = list(_sections(read_yaml(Path(path))))
        except InputError:  # ROS has already read the file
            continue
        if not any(_matches(section, node_name) for section in sections):
            shown = ', '.join(map(printable, sections[:_MOST_SHOWN])) or 'no node'
            yield f'{printable(path)} has parameters for {shown}, and not for {node_name}: begin the file with /**:'


def _parameter_files(arguments: Sequence[str]) -> Iterator[str]:
    for option, value in pairwise(arguments):
        if option == _OPTION:
            yield value


def _sections(document: Any, above: str = '') -> Iterator[str]:
    """Yield the names of the nodes with parameters in a file."""
    if isinstance(document, YamlMapping):
        for name, below in document.items():
            if name == 'ros__parameters':
                yield above
            else:
                yield from _sections(below, f'{above}/{name}'.replace('//', '/') if above else str(name))


def _matches(section: str, node_name: str) -> bool:
    """Return whether a section matches a node: `*` matches a part of the full name, `**` any number of parts."""
    parts = section.removeprefix('/').split('/')
    pattern = ''.join(_WILDCARDS.get(part, f'/{re.escape(part)}') for part in parts)
    return re.fullmatch(pattern, node_name) is not None
