"""ROS parameters of the model: declared with unit, range and description, checked before they act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import NAMES, SPECS, TABLE_1, OperatingPoints
from cfd_pneumatic.model.effects import Effect

_HINTS = {
    ('INTEGER', 'DOUBLE'): ' (write 1.0 for 1)',
    ('INTEGER_ARRAY', 'DOUBLE_ARRAY'): ' (write 1.0 for 1)',
    ('BOOL', 'STRING'): ' (quote it, as YAML takes a bare y or on for true)',
}


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


def wrong_type(node: Node, parameters: Sequence[Parameter]) -> str | None:
    """Return which of these parameters is not of its declared type, or None; rclpy's own reason leaves the name out."""
    for parameter in parameters:
        if node.has_parameter(parameter.name):
            declared = Parameter.Type(node.describe_parameter(parameter.name).type).name
            given = parameter.type_.name
            if given != declared:
                return f'{parameter.name} is {given} where {declared} belongs{_HINTS.get((given, declared), "")}'
    return None


def declare_operating_points(node: Node, cylinder: str) -> None:
    """
    Declare a cylinder's scheduled gains: `cylinder_a.setpoints`, `cylinder_a.k_x` and so on.

    Their default is the paper's Table 1; a gain that is not given is Table 1's at the set-points that are.
    """
    setpoints = node.declare_parameter(
        f'{cylinder}.setpoints',
        list(map(float, TABLE_1.setpoints)),
        numbers('Pa', 'gauge set pressures at which the gains are given', 'finite, strictly increasing'),
    ).value
    try:
        default = TABLE_1.at(setpoints)
    except ValueError as error:
        raise InputError(f'{cylinder}: {error}') from error
    for spec in SPECS:
        node.declare_parameter(
            f'{cylinder}.{spec.name}',
            list(map(float, getattr(default, spec.name))),
            numbers(
                spec.unit,
                f'{spec.description}, one for each set-point',
                f'{spec.lower:g} to {spec.upper:g} {spec.unit}, as many as setpoints',
            ),
        )


def operating_points(node: Node, cylinder: str, changes: Mapping[str, Any]) -> OperatingPoints:
    """
    Return a cylinder's scheduled gains as they are with some changes.

    Raises
    ------
    InputError
        If lengths differ or a value is out of its range, with the parameter's name.

    """
    rows = {name: _value(node, f'{cylinder}.{name}', changes) for name in ('setpoints', *NAMES)}
    try:
        return OperatingPoints.from_rows({name: np.asarray(row, dtype=float) for name, row in rows.items()})
    except ValueError as error:
        raise InputError(f'{cylinder}.{error}') from error


def declare_effects(node: Node, prefix: str, among: Mapping[str, Effect]) -> None:
    """
    Declare physical effects of a kind below a prefix: `cylinder_a.leakage.enabled`, `.conductance` and so on.

    All are off. Parameters are null by default: an effect that is enabled and given none changes nothing.
    """
    for effect in among.values():
        node.declare_parameter(
            f'{prefix}.{effect.name}.enabled',
            False,
            switch(f'{effect.description}; its parameters by default change nothing'),
        )
        for parameter in effect.parameters:
            node.declare_parameter(
                f'{prefix}.{effect.name}.{parameter.name}',
                float(parameter.null),
                number(
                    parameter.unit,
                    parameter.lower,
                    parameter.upper,
                    f'{effect.description}: {parameter.description}',
                ),
            )


def effects(
    node: Node, prefix: str, among: Mapping[str, Effect], changes: Mapping[str, Any]
) -> dict[str, tuple[float, ...]]:
    """Return the parameters of each of these effects that is enabled, as they are with some changes."""
    return {
        name: tuple(_value(node, f'{prefix}.{name}.{parameter.name}', changes) for parameter in effect.parameters)
        for name, effect in among.items()
        if _value(node, f'{prefix}.{name}.enabled', changes)
    }


def _value(node: Node, name: str, changes: Mapping[str, Any]) -> Any:
    return changes[name] if name in changes else node.get_parameter(name).value
