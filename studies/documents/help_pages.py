# SPDX-License-Identifier: Apache-2.0
"""
The programs' help: what each is, its arguments or parameters with their units and defaults, an example.

`make interface-document` writes the pages; ROS is not started for them.
"""

from __future__ import annotations

import importlib
import inspect
import os
import textwrap
from types import ModuleType
from typing import Any, NamedTuple

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.examples import example_of
from studies.documents.package_facts import programs

_WIDTH = 100
_SWITCH = '.enabled'
_OWN_SWITCHES = tuple(f'{name}{_SWITCH}' for name in CYLINDERS)  # no effect's, but the cylinder's
_MORE = (
    "Physical effects that the paper's model lacks are parameters, too, such as {effect}.enabled and what stands "
    'below it; all are off. docs/interface.md lists every parameter, and so does `ros2 param describe` of a node.'
)


class Declared(NamedTuple):
    """A parameter as a node declares it."""

    name: str
    default: Any
    descriptor: ParameterDescriptor


def pages() -> dict[str, str]:
    """Return the help of every program, by the program's name."""
    modules = {name: importlib.import_module(module) for name, module in programs().items()}
    os.environ['COLUMNS'] = str(_WIDTH)  # argparse asks for it
    return {
        name: module.make_parser().format_help()
        if hasattr(module, 'make_parser')
        else help_of(name, node_class(module))
        for name, module in modules.items()
    }


def node_class(module: ModuleType) -> Any:
    """Return the class of the node that a module holds."""
    return getattr(module, module.__name__.rpartition('.')[2].title().replace('_', ''))


def help_of(name: str, node: Any) -> str:
    """Return the help of a node of some class."""
    about = (inspect.getdoc(node) or '').split('\n\nParameters\n---')[0]
    parameters = declared_by(node)
    effects = [
        one.name[: -len(_SWITCH)] for one in parameters if one.name.endswith(_SWITCH) and one.name not in _OWN_SWITCHES
    ]
    lines = [
        f'usage: {name} --ros-args [-r __ns:=NAMESPACE] [-r TOPIC:=TOPIC] [-p PARAMETER:=VALUE] [--params-file FILE]',
        '',
        about,
        '',
        'parameters and their defaults:',
        *map(_line, (one for one in parameters if _is_shown(one.name, effects))),
        '',
        *([textwrap.fill(_MORE.format(effect=effects[0]), _WIDTH), ''] if effects else []),
        example_of(name),
    ]
    return '\n'.join(lines)


def _is_shown(name: str, effects: list[str]) -> bool:
    """Tell whether a parameter is none of an effect's, nor cylinder B's where cylinder A's says the same."""
    of_b = name.startswith('cylinder_b.')
    return not of_b and not any(name.startswith(f'{effect}.') for effect in effects)


def _line(one: Declared) -> str:
    name = one.name.replace('cylinder_a.', 'cylinder_*.')
    text = f'{name} ({_written(one.default)}): {one.descriptor.description}'
    if one.descriptor.additional_constraints:
        text += f'; {one.descriptor.additional_constraints}'
    return textwrap.fill(text, _WIDTH, initial_indent='  ', subsequent_indent='      ')


def _written(value: Any) -> str:
    """Return a default as a user would write it."""
    if isinstance(value, list):
        return f'[{", ".join(_written(one) for one in value if one != "")}]'
    if isinstance(value, float):
        return f'{value:.7g}'
    return (value if isinstance(value, str) else str(value).lower()) or 'empty'


def declared_by(node: type) -> list[Declared]:
    """Return the parameters that nodes of a class declare, in their order."""
    found = []

    def declare(name: str, default: Any, descriptor: ParameterDescriptor) -> Parameter:
        found.append(Declared(name, default, descriptor))
        return Parameter(name, value=default)

    bare: Any = object.__new__(node)  # a node would join the graph
    bare.declare_parameter = declare
    bare._declare_parameters()
    return found
