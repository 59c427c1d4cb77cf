# SPDX-License-Identifier: Apache-2.0
"""Arguments and nodes that the launch files share."""

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
"""The paper's parameters, used without identified parameters."""

CELL = LaunchConfiguration('cell')
DEVICE = LaunchConfiguration('device')
PARAMETERS = LaunchConfiguration('parameters')
USE_SIM_TIME = LaunchConfiguration('use_sim_time')


def common_arguments() -> list[LaunchDescriptionEntity]:
    """Declare `cell`, `use_sim_time` and `enclave`."""
    return [
        DeclareLaunchArgument(
            'cell', default_value='/cfd', description='namespace of the cell, a separate namespace for each device'
        ),
        OpaqueFunction(function=_check_absolute, args=['cell']),
        DeclareLaunchArgument(
            'use_sim_time',
            default_value='false',
            choices=['true', 'false'],
            description='true: use the time of /clock, as with a simulated robot or a bag that is played',
        ),
        DeclareLaunchArgument(
            'enclave',
            default_value=CELL,
            description='parent of the enclaves of the nodes, as /cfd/sim_node; used only with security',
        ),
    ]


def device_argument() -> list[LaunchDescriptionEntity]:
    """Declare `device`, the namespace of the topics that the nodes receive."""
    return [
        DeclareLaunchArgument(
            'device',
            default_value=[CELL, '/device'],
            description="namespace in which the device's drivers, or the virtual rig, publish",
        ),
        OpaqueFunction(function=_check_absolute, args=['device']),
    ]


def _check_absolute(context: LaunchContext, argument: str) -> None:
    """Refuse a relative namespace, which ROS would resolve in the namespace of each node."""
    namespace = LaunchConfiguration(argument).perform(context)
    if not namespace.startswith('/'):
        raise RuntimeError(f'{argument}:={namespace} must begin with a slash: use {argument}:=/{namespace}')


def topic_arguments(topics: Sequence[str]) -> list[LaunchDescriptionEntity]:
    """Declare an argument for each topic of the device, and for its joint."""
    return [
        DeclareLaunchArgument(
            'joint',
            default_value=PISTON_JOINT,
            description='name of the piston joint, unless a parameter file has the name',
        ),
        *(
            DeclareLaunchArgument(
                topic, default_value=[DEVICE, f'/{topic}'], description=f'topic of the device: {meaning(topic)}'
            )
            for topic in topics
        ),
    ]


def device_listener(program: str, role: str, topics: Sequence[str], **options: Any) -> Node:
    """
    Return a node that subscribes to topics of a device.

    Parameters
    ----------
    program
        The node's executable.
    role
        Role in the cell: the last part of the namespace, unless `options` has a namespace.
    topics
        Topics of the device; other topics are in the node's namespace.
    options
        Further arguments of `launch_ros.actions.Node`.

    """
    return package_node(
        program,
        namespace=options.pop('namespace', [CELL, f'/{role}']),
        parameters=[{'joint': ParameterValue(LaunchConfiguration('joint'), value_type=str)}, PARAMETERS],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in topics],
        **options,
    )


def listener_launch(
    program: str, role: str, topics: Sequence[str], parameters: DeclareLaunchArgument
) -> LaunchDescription:
    """Return the launch description of a node that subscribes to a device, with all arguments."""
    return LaunchDescription(
        [
            *common_arguments(),
            *device_argument(),
            *topic_arguments(topics),
            parameters,
            DeclareLaunchArgument('namespace', default_value=[CELL, f'/{role}'], description=f'namespace of {program}'),
            device_listener(program, role, topics, namespace=LaunchConfiguration('namespace')),
        ]
    )


def package_node(program: str, parameters: Sequence[Any], **options: Any) -> Node:
    """Return a node of this package, with parameters and further arguments of `launch_ros.actions.Node`."""
    return Node(
        package=PACKAGE,
        executable=program,
        parameters=[*parameters, {'use_sim_time': USE_SIM_TIME}],
        output='screen',
        ros_arguments=['--enclave', [LaunchConfiguration('enclave'), f'/{program}']],
        **options,
    )
