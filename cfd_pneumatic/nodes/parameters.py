# SPDX-License-Identifier: Apache-2.0
"""ROS parameters of the model: declared with unit, range and description, checked before they act."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from cfd_pneumatic.device import DESCRIPTORS, Descriptor, Device, Value, default_of
from cfd_pneumatic.errors import InputError

_HINTS = {
    ('INTEGER', 'DOUBLE'): ' (write 1.0 for 1)',
    ('INTEGER_ARRAY', 'DOUBLE_ARRAY'): ' (write 1.0 for 1)',
    ('BOOL', 'STRING'): ' (quote it, as YAML takes a bare y or on for true)',
}

_TEXTS = Parameter.Type.STRING, Parameter.Type.STRING_ARRAY
_NUMBER = re.compile(r'[-+]?\d+(\.\d*)?([eE][-+]?\d+)?')

FRAME_LENGTH = '1 to 256 characters'
_LONGEST_FRAME = 256

NONE = 'none'
"""Says that a text is not given: an empty one can't be typed in a shell."""


def value_of(value: Any) -> Any:
    """Return a parameter's value; nothing where it says `none`."""
    return '' if value == NONE else value


def number(unit: str, lower: float, upper: float, description: str, read_only: bool = False) -> ParameterDescriptor:
    """Return the descriptor of a number in a range [unit]."""
    return ParameterDescriptor(
        type=ParameterType.PARAMETER_DOUBLE,
        description=f'{description} [{unit}]',
        floating_point_range=[FloatingPointRange(from_value=lower, to_value=upper)],
        read_only=read_only,
    )


def text(description: str, constraints: str = '', read_only: bool = False) -> ParameterDescriptor:
    """Return the descriptor of a string."""
    return ParameterDescriptor(
        type=ParameterType.PARAMETER_STRING,
        description=description,
        additional_constraints=constraints,
        read_only=read_only,
    )


def switch(description: str, read_only: bool = False) -> ParameterDescriptor:
    """Return the descriptor of a boolean."""
    return ParameterDescriptor(type=ParameterType.PARAMETER_BOOL, description=description, read_only=read_only)


def numbers(unit: str, description: str, constraints: str) -> ParameterDescriptor:
    """Return the descriptor of a list of numbers; rclpy checks no range of a list, its owner has to."""
    return ParameterDescriptor(
        type=ParameterType.PARAMETER_DOUBLE_ARRAY,
        description=f'{description} [{unit}]',
        additional_constraints=constraints,
    )


def texts(description: str, read_only: bool = False) -> ParameterDescriptor:
    """Return the descriptor of a list of strings."""
    return ParameterDescriptor(type=ParameterType.PARAMETER_STRING_ARRAY, description=description, read_only=read_only)


def checked_frame(frame_id: str) -> str:
    """
    Return the name of a frame, which every message carries.

    Raises
    ------
    InputError
        If the name is empty or longer than 256 characters.

    """
    if not 0 < len(frame_id) <= _LONGEST_FRAME:
        raise InputError(
            f'frame_id has {len(frame_id)} characters, and must have {FRAME_LENGTH}: name the frame of the force'
        )
    return frame_id


def as_declared(node: Node, parameters: Sequence[Parameter]) -> list[Parameter]:
    """
    Return parameters with texts as numbers if numbers are declared and the texts are numbers.

    `ros2 param set` and `ros2 param load` send 1e-06 as a text: YAML takes numbers without a point for texts.
    """
    return [_as_declared(node, given) if node.has_parameter(given.name) else given for given in parameters]


def _as_declared(node: Node, parameter: Parameter) -> Parameter:
    declared, value = Parameter.Type(node.describe_parameter(parameter.name).type), parameter.value
    if declared == Parameter.Type.DOUBLE and isinstance(value, str) and _NUMBER.fullmatch(value):
        return Parameter(parameter.name, declared, float(value))
    if declared == Parameter.Type.DOUBLE_ARRAY and parameter.type_ in _TEXTS:
        texts = value.strip('[]').split(',') if isinstance(value, str) else value
        if all(_NUMBER.fullmatch(text.strip()) for text in texts):
            return Parameter(parameter.name, declared, [float(text) for text in texts])
    return parameter


def wrong_type(node: Node, parameters: Sequence[Parameter]) -> str | None:
    """Return which of these parameters is not of its declared type, or None; rclpy's own reason leaves the name out."""
    for parameter in parameters:
        if node.has_parameter(parameter.name):
            declared = Parameter.Type(node.describe_parameter(parameter.name).type).name
            given = parameter.type_.name
            if given != declared:
                return f'{parameter.name} is {given} where {declared} belongs{_HINTS.get((given, declared), "")}'
    return None


def warn_of_undeclared(node: Node) -> None:
    """Warn of parameters that were given to a node and that it does not have."""
    for name in node._parameter_overrides:
        if not node.has_parameter(name):
            near = get_close_matches(name, node._parameters, n=1)
            hint = f': did you mean {near[0]}?' if near else ''
            node.get_logger().warning(f'parameter {name} is none of this node, and has no effect{hint}')


def declare_device(node: Node) -> None:
    """
    Declare every parameter of a device.

    Gains that are not given are Table 1's at the set-points that are.

    Raises
    ------
    InputError
        If these set-points are none.

    """
    declared: dict[str, Value] = {}
    for name, descriptor in DESCRIPTORS.items():
        default = default_of(name, declared)
        own = list(default) if isinstance(default, tuple) else default
        declared[name] = node.declare_parameter(name, own, _as_ros(descriptor)).value


def device_of(node: Node, changes: Mapping[str, Any]) -> Device:
    """
    Return the device that a node's parameters describe, with some changes.

    Raises
    ------
    InputError
        If lengths differ or a value is out of its range, with the parameter's name.

    """
    values = {name: changes[name] if name in changes else node.get_parameter(name).value for name in DESCRIPTORS}
    return Device({name: value if isinstance(value, bool | float) else tuple(value) for name, value in values.items()})


def _as_ros(one: Descriptor) -> ParameterDescriptor:
    if isinstance(one.default, bool):
        return switch(one.description, one.at_start)
    if isinstance(one.default, float):
        return number(one.unit, one.lower, one.upper, one.description, one.at_start)
    if one.lists_names:
        return texts(one.description)
    return numbers(one.unit, one.description, one.constraints)
