# SPDX-License-Identifier: Apache-2.0
"""The parameter files on a node's command line: whether one is meant for another node, or stands where none is read."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from rclpy.node import Node

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.input_files import check_input
from cfd_pneumatic.yaml_files import YamlMapping, read_yaml

_OPTION = '--params-file'
_SUFFIXES = ('.yaml', '.yml')
_OWN = ('area', *CYLINDERS)  # what describes a device
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


def unread_file(node: Node) -> str | None:
    """Return in words which file describes the device for other nodes; None if none does."""
    for path in _files(sys.argv):
        names = []
        with suppress(InputError):  # ROS has read it, in its own way
            names = [name for name, given in _nodes(read_yaml(Path(path))) if _describes(given)]
        if names:
            shown = ', '.join(map(printable, names[:_MOST_SHOWN]))
            return (
                f'{printable(path)} describes the device for {shown}, and not for {node.get_fully_qualified_name()}: '
                'let it begin with /**:'
            )
    return None


def _files(arguments: Sequence[str]) -> Iterator[str]:
    for option, value in pairwise(arguments):
        if option == _OPTION:
            yield value


def _nodes(document: Any, above: str = '') -> Iterator[tuple[str, YamlMapping]]:
    """Yield the names of the nodes in a file, and the parameters that each is given."""
    if isinstance(document, YamlMapping):
        for name, below in document.items():
            if name == 'ros__parameters' and isinstance(below, YamlMapping):
                yield above, below
            else:
                yield from _nodes(below, f'{above}/{name}'.replace('//', '/') if above else str(name))


def _describes(parameters: YamlMapping) -> bool:
    return any(str(name).partition('.')[0] in _OWN for name in parameters)
