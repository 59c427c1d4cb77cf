# SPDX-License-Identifier: Apache-2.0
"""ROS parameters of the model: declarations with unit, range and description, and checks."""

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
"""Value of a text that is not given: a shell cannot pass an empty text."""


def given_value(value: Any) -> Any:
    """Return a parameter's value, or an empty text for `none`."""
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
    """Return the descriptor of a list of numbers; rclpy checks no ranges of lists, so the node must."""
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


def convert_numbers(node: Node, parameters: Sequence[Parameter]) -> list[Parameter]:
    """
    Convert texts to numbers if numbers are declared and the texts are numbers.

    `ros2 param set` and `ros2 param load` send 1e-06 as a text: YAML reads numbers without a point as texts.
    """
    return [
        _convert_number(node, parameter) if node.has_parameter(parameter.name) else parameter
        for parameter in parameters
    ]


def _convert_number(node: Node, parameter: Parameter) -> Parameter:
    declared, value = Parameter.Type(node.describe_parameter(parameter.name).type), parameter.value
    if declared == Parameter.Type.DOUBLE and isinstance(value, str) and _NUMBER.fullmatch(value):
        return Parameter(parameter.name, declared, float(value))
    if declared == Parameter.Type.DOUBLE_ARRAY and parameter.type_ in _TEXTS:
        texts = value.strip('[]').split(',') if isinstance(value, str) else value
        if all(_NUMBER.fullmatch(text.strip()) for text in texts):
            return Parameter(parameter.name, declared, [float(text) for text in texts])
    return parameter


def wrong_type(node: Node, parameters: Sequence[Parameter]) -> str | None:
    """Return a text on the first parameter of a wrong type, or None; rclpy's text has no name."""
    for parameter in parameters:
        if node.has_parameter(parameter.name):
            declared = Parameter.Type(node.describe_parameter(parameter.name).type).name
            given = parameter.type_.name
            if given != declared:
                return f'{parameter.name} is {given}, and must be {declared}{_HINTS.get((given, declared), "")}'
    return None


def warn_of_undeclared(node: Node) -> None:
    """Warn of given parameters that a node does not have."""
    for name in node._parameter_overrides:
        if not node.has_parameter(name):
            near = get_close_matches(name, node._parameters, n=1)
            hint = f'. Did you mean {near[0]}?' if near else ''
            node.get_logger().warning(f'this node has no parameter {name}: its value has no effect{hint}')


def declare_device(node: Node) -> None:
    """
    Declare every parameter of a device.

    Gains that are not given are those of Table 1 at the given set-points.

    Raises
    ------
    InputError
        If the set-points are invalid.

    """
    declared: dict[str, Value] = {}
    for name, descriptor in DESCRIPTORS.items():
        default = default_of(name, declared)
        ros_default = list(default) if isinstance(default, tuple) else default
        declared[name] = node.declare_parameter(name, ros_default, _ros_descriptor(descriptor)).value


def device_of(node: Node, changes: Mapping[str, Any]) -> Device:
    """
    Return the device that a node's parameters describe, with some changes.

    Raises
    ------
    InputError
        If lengths differ or a value is out of its range; the message has the parameter's name.

    """
    values = {name: changes[name] if name in changes else node.get_parameter(name).value for name in DESCRIPTORS}
    return Device({name: value if isinstance(value, bool | float) else tuple(value) for name, value in values.items()})


def _ros_descriptor(descriptor: Descriptor) -> ParameterDescriptor:
    if isinstance(descriptor.default, bool):
        return switch(descriptor.description, descriptor.at_start)
    if isinstance(descriptor.default, float):
        return number(descriptor.unit, descriptor.lower, descriptor.upper, descriptor.description, descriptor.at_start)
    if descriptor.lists_names:
        return texts(descriptor.description)
    return numbers(descriptor.unit, descriptor.description, descriptor.constraints)
