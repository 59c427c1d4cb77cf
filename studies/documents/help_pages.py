# SPDX-License-Identifier: Apache-2.0
"""
Write the programs' help: purpose, arguments or parameters with units and defaults, an example.

`make interface-document` writes the pages, without starting ROS.
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
_CYLINDER_SWITCHES = tuple(f'{name}{_SWITCH}' for name in CYLINDERS)
_MORE = (
    "Physical effects that the paper's model lacks are parameters, too, such as {effect}.enabled and the parameters "
    'below it. All effects are off by default. docs/reference/interface.md and `ros2 param describe` list every '
    'parameter.'
)


class Declared(NamedTuple):
    """A parameter as a node declares it."""

    name: str
    default: Any
    descriptor: ParameterDescriptor


def pages() -> dict[str, str]:
    """Return the help of every program, by the program's name."""
    modules = {name: importlib.import_module(module) for name, module in programs().items()}
    os.environ['COLUMNS'] = str(_WIDTH)  # read by argparse
    return {
        name: module.make_parser().format_help()
        if hasattr(module, 'make_parser')
        else help_of(name, node_class(module))
        for name, module in modules.items()
    }


def node_class(module: ModuleType) -> Any:
    """Return the node class of a module."""
    return getattr(module, module.__name__.rpartition('.')[2].title().replace('_', ''))


def help_of(name: str, node: Any) -> str:
    """Return the help of a node class."""
    description = (inspect.getdoc(node) or '').split('\n\nParameters\n---')[0]
    parameters = declared_by(node)
    effects = [
        parameter.name[: -len(_SWITCH)]
        for parameter in parameters
        if parameter.name.endswith(_SWITCH) and parameter.name not in _CYLINDER_SWITCHES
    ]
    lines = [
        f'usage: {name} --ros-args [-r __ns:=NAMESPACE] [-r TOPIC:=TOPIC] [-p PARAMETER:=VALUE] [--params-file FILE]',
        '',
        description,
        '',
        'parameters and their defaults:',
        *map(_line, (parameter for parameter in parameters if _is_shown(parameter.name, effects))),
        '',
        *([textwrap.fill(_MORE.format(effect=effects[0]), _WIDTH), ''] if effects else []),
        example_of(name),
    ]
    return '\n'.join(lines)


def _is_shown(name: str, effects: list[str]) -> bool:
    """Return whether a parameter is listed: parameters of effects and of cylinder B are not."""
    of_b = name.startswith('cylinder_b.')
    return not of_b and not any(name.startswith(f'{effect}.') for effect in effects)


def _line(parameter: Declared) -> str:
    name = parameter.name.replace('cylinder_a.', 'cylinder_*.')
    text = f'{name} ({_written(parameter.default)}): {parameter.descriptor.description}'
    if parameter.descriptor.additional_constraints:
        text += f'; {parameter.descriptor.additional_constraints}'
    return textwrap.fill(text, _WIDTH, initial_indent='  ', subsequent_indent='      ')


def _written(value: Any) -> str:
    """Return a default value as a user would type it."""
    if isinstance(value, list):
        return f'[{", ".join(_written(item) for item in value if item != "")}]'
    if isinstance(value, float):
        return f'{value:.7g}'
    return (value if isinstance(value, str) else str(value).lower()) or 'empty'


def declared_by(node: type) -> list[Declared]:
    """Return the parameters of a node class, in the order of their declaration."""
    declared = []

    def declare(name: str, default: Any, descriptor: ParameterDescriptor) -> Parameter:
        declared.append(Declared(name, default, descriptor))
        return Parameter(name, value=default)

    uninitialised: Any = object.__new__(node)  # an initialised node would join the graph
    uninitialised.declare_parameter = declare
    uninitialised._declare_parameters()
    return declared
