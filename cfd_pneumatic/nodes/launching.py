# SPDX-License-Identifier: Apache-2.0
"""What the launch files share: the arguments that they have in common, and the nodes beside a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from cfd_pneumatic.convention import PISTON_JOINT, meaning

PACKAGE = 'cfd_pneumatic'
SHARE = FindPackageShare(PACKAGE)
TABLE_1 = PathJoinSubstitution([SHARE, 'config', 'table_1.yaml'])
"""The paper's parameters, where none were identified."""

CELL = LaunchConfiguration('cell')
DEVICE = LaunchConfiguration('device')
PARAMETERS = LaunchConfiguration('parameters')
USE_SIM_TIME = LaunchConfiguration('use_sim_time')


def common_arguments() -> list[LaunchDescriptionEntity]:
    """Declare `cell`, `use_sim_time` and `enclave`."""
    return [
        DeclareLaunchArgument('cell', default_value='/cfd', description='namespace of the cell, one for each device'),
        OpaqueFunction(function=_check_absolute, args=['cell']),
        DeclareLaunchArgument(
            'use_sim_time',
            default_value='false',
            choices=['true', 'false'],
            description='true: time is that of /clock, as of a simulated robot or a bag that is played',
        ),
        DeclareLaunchArgument(
            'enclave',
            default_value=CELL,
            description='enclave below which each node has its own, as /cfd/sim_node; of use with security alone',
        ),
    ]


def device_argument() -> list[LaunchDescriptionEntity]:
    """Declare `device`, whose topics the nodes beside it hear."""
    return [
        DeclareLaunchArgument(
            'device',
            default_value=[CELL, '/device'],
            description="namespace in which the device's drivers, or the virtual rig, publish",
        ),
        OpaqueFunction(function=_check_absolute, args=['device']),
    ]


def _check_absolute(context: LaunchContext, argument: str) -> None:
    """Refuse a namespace that each node would take for one below its own."""
    namespace = LaunchConfiguration(argument).perform(context)
    if not namespace.startswith('/'):
        raise RuntimeError(f'{argument}:={namespace} is to begin with a slash: {argument}:=/{namespace}')


def heard_arguments(topics: Sequence[str]) -> list[LaunchDescriptionEntity]:
    """Declare for each of the device's topics an argument of its name, and for its joint."""
    return [
        DeclareLaunchArgument(
            'joint', default_value=PISTON_JOINT, description='name of the piston joint, where no parameter file says it'
        ),
        *(
            DeclareLaunchArgument(
                topic, default_value=[DEVICE, f'/{topic}'], description=f'topic of the device: {meaning(topic)}'
            )
            for topic in topics
        ),
    ]


def beside_device(program: str, role: str, topics: Sequence[str], **options: Any) -> Node:
    """
    Return a node that hears a device.

    Parameters
    ----------
    program
        The node's executable.
    role
        What it is in its cell: the last part of its namespace, unless `options` say another.
    topics
        Those of the device that it hears; the others are in its own namespace.
    options
        What `launch_ros.actions.Node` takes besides.

    """
    return our_node(
        program,
        namespace=options.pop('namespace', [CELL, f'/{role}']),
        parameters=[{'joint': ParameterValue(LaunchConfiguration('joint'), value_type=str)}, PARAMETERS],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in topics],
        **options,
    )


def alone_beside_device(
    program: str, role: str, topics: Sequence[str], parameters: DeclareLaunchArgument
) -> LaunchDescription:
    """Return what a launch file describes that starts one node beside a device, with all arguments that it takes."""
    return LaunchDescription(
        [
            *common_arguments(),
            *device_argument(),
            *heard_arguments(topics),
            parameters,
            DeclareLaunchArgument('namespace', default_value=[CELL, f'/{role}'], description=f'namespace of {program}'),
            beside_device(program, role, topics, namespace=LaunchConfiguration('namespace')),
        ]
    )


def our_node(program: str, parameters: Sequence[Any], **options: Any) -> Node:
    """Return a node of this package, with parameters and what `launch_ros.actions.Node` takes besides."""
    return Node(
        package=PACKAGE,
        executable=program,
        parameters=[*parameters, {'use_sim_time': USE_SIM_TIME}],
        output='screen',
        ros_arguments=['--enclave', [LaunchConfiguration('enclave'), f'/{program}']],
        **options,
    )
