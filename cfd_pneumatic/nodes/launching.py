"""What the launch files share: the arguments that they have in common, and a node beside a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from launch import LaunchContext, LaunchDescriptionEntity, Substitution
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'cfd_pneumatic'
SHARE = FindPackageShare(PACKAGE)
TABLE_1 = PathJoinSubstitution([SHARE, 'config', 'table_1.yaml'])
"""The paper's parameters, where none were identified."""

CELL = LaunchConfiguration('cell')
DEVICE = LaunchConfiguration('device')
PARAMETERS = LaunchConfiguration('parameters')
USE_SIM_TIME = LaunchConfiguration('use_sim_time')


def launch_file(name: str) -> Substitution:
    """Return the path of another of our launch files."""
    return PathJoinSubstitution([SHARE, 'launch', f'{name}.launch.py'])


def common_arguments() -> list[LaunchDescriptionEntity]:
    """Declare `cell` and `use_sim_time`."""
    return [
        DeclareLaunchArgument('cell', default_value='/cfd', description='namespace of the cell, one for each device'),
        OpaqueFunction(function=_check_absolute, args=['cell']),
        DeclareLaunchArgument(
            'use_sim_time',
            default_value='false',
            choices=['true', 'false'],
            description='true: time is that of /clock, as of a simulated robot or a bag that is played',
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


def beside_device(
    program: str, role: str, inputs: Sequence[str], parameters: DeclareLaunchArgument
) -> list[LaunchDescriptionEntity]:
    """
    Return a node that hears a device, with the arguments that it takes.

    Parameters
    ----------
    program
        The node's executable.
    role
        What it is in its cell: the last part of its namespace.
    inputs
        The topics that it hears in the namespace of the device; the others are in its own.
    parameters
        Declaration of the argument of that name, a parameter file.

    """
    return [
        *common_arguments(),
        *device_argument(),
        parameters,
        DeclareLaunchArgument('namespace', default_value=[CELL, f'/{role}'], description=f'namespace of {program}'),
        our_node(
            program,
            namespace=LaunchConfiguration('namespace'),
            parameters=[PARAMETERS],
            remappings=[(topic, [DEVICE, f'/{topic}']) for topic in inputs],
        ),
    ]


def our_node(program: str, parameters: Sequence[Any], **options: Any) -> Node:
    """Return a node of this package, with parameters and what `launch_ros.actions.Node` takes besides."""
    return Node(
        package=PACKAGE,
        executable=program,
        parameters=[*parameters, {'use_sim_time': USE_SIM_TIME}],
        output='screen',
        **options,
    )
