# SPDX-License-Identifier: Apache-2.0
"""The parameter files on a node's command line: whether one is meant for another node, or stands where none is read."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rclpy.node import Node

from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.input_files import check_input
from cfd_pneumatic.yaml_files import YamlMapping, read_yaml

_OPTION = '--params-file'
_SUFFIXES = ('.yaml', '.yml')
_WILDCARDS = {'*': '/[^/]+', '**': '(/[^/]+)*'}
_MOST_SHOWN = 5  # names in a message


def check_arguments(program: str, arguments: Sequence[str]) -> None:
    """
    Check that all arguments are ROS's, and that parameter files are files: ROS would wait for a pipe.

    Raises
    ------
    InputError
        If something stands outside of `--ros-args`, where ROS does not look, or a parameter file is none.

    """
    for path in filter(os.path.exists, _files(arguments)):  # ROS has words for one that is not there
        try:
            check_input(Path(path))
        except InputError as error:
            raise InputError(f'{printable(path)} {error}') from error
    left = list(_outside_of_ros_args(arguments))
    if not left:
        return
    file = next((one for one in left if one.endswith(_SUFFIXES)), None)
    meant = f'{_OPTION} {file}' if file else ' '.join(left)
    raise InputError(f'{printable(left[0])} stands outside of --ros-args: {program} --ros-args {printable(meant)}')


def _outside_of_ros_args(arguments: Sequence[str]) -> Iterator[str]:
    """Yield the arguments where ROS does not look; `--` ends what it looks at."""
    is_ros = False
    for one in arguments:
        if one == '--ros-args':
            is_ros = True
        elif one == '--' and is_ros:
            is_ros = False
        elif not is_ros:
            yield one


def has_files() -> bool:
    """Return whether the command line gives a parameter file."""
    return any(_files(sys.argv))


def unread_files(node: Node) -> Iterator[str]:
    """Yield a warning for each parameter file on the command line that has no section for the node."""
    node_name = node.get_fully_qualified_name()
    for path in _files(sys.argv):
        try:
            sections = list(_sections(read_yaml(Path(path))))
        except InputError:  # ROS has read it, in its own way
            continue
        if not any(_matches(section, node_name) for section in sections):
            shown = ', '.join(map(printable, sections[:_MOST_SHOWN])) or 'no node'
            yield f'{printable(path)} has parameters for {shown}, and not for {node_name}: let it begin with /**:'


def _files(arguments: Sequence[str]) -> Iterator[str]:
    for option, value in pairwise(arguments):
        if option == _OPTION:
            yield value


def _sections(document: Any, above: str = '') -> Iterator[str]:
    """Yield the names of the nodes to which a file gives parameters."""
    if isinstance(document, YamlMapping):
        for name, below in document.items():
            if name == 'ros__parameters':
                yield above
            else:
                yield from _sections(below, f'{above}/{name}'.replace('//', '/') if above else str(name))


def _matches(section: str, node_name: str) -> bool:
    """Return whether a section is for a node: `*` stands for one part of its full name, `**` for any number."""
    parts = section.removeprefix('/').split('/')
    pattern = ''.join(_WILDCARDS.get(part, f'/{re.escape(part)}') for part in parts)
    return re.fullmatch(pattern, node_name) is not None
