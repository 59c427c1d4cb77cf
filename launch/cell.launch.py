# SPDX-License-Identifier: Apache-2.0
"""A cell: the device, or the virtual rig in its place, with the simulator and the monitor beside it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.parameter_descriptions import ParameterValue

from cfd_pneumatic.convention import MONITOR_INPUTS, SIM_INPUTS
from cfd_pneumatic.nodes.launching import (
    DEVICE,
    PARAMETERS,
    TABLE_1,
    beside_device,
    common_arguments,
    device_argument,
    heard_arguments,
    our_node,
)


def generate_launch_description():
    schedule, joint = (ParameterValue(LaunchConfiguration(name), value_type=str) for name in ('schedule', 'joint'))
    return LaunchDescription(
        [
            *common_arguments(),
            *device_argument(),
            *heard_arguments(dict.fromkeys((*SIM_INPUTS, *MONITOR_INPUTS))),
            DeclareLaunchArgument(
                'rig',
                default_value='true',
                choices=['true', 'false'],
                description="true: the virtual rig is the device; false: a real device's drivers run",
            ),
            DeclareLaunchArgument(
                'schedule',
                default_value='surface_following',
                description='what the rig plays over and over: paper_step, out_and_back, surface_following, or a '
                'schedule.csv; none for a piston that follows piston_command [m]',
            ),
            DeclareLaunchArgument(
                'parameters',
                default_value=TABLE_1,
                description='parameter file of simulator and monitor: the parameters.yaml of the identification of '
                "this device; the paper's Table 1 where none is given",
            ),
            DeclareLaunchArgument(
                'monitor',
                default_value='auto',
                choices=['auto', 'true', 'false'],
                description='auto: the device is watched where parameters are given, for the watch needs its own',
            ),
            our_node(
                'rig_node',
                namespace=DEVICE,
                parameters=[{'schedule': schedule, 'start_subscribers': 1, 'repeat': True, 'joint': joint}],
                remappings=[(topic, LaunchConfiguration(topic)) for topic in MONITOR_INPUTS],
                condition=IfCondition(LaunchConfiguration('rig')),
            ),
            beside_device('sim_node', 'sim', SIM_INPUTS),
            beside_device('monitor_node', 'monitor', MONITOR_INPUTS, condition=IfCondition(monitor_is_wanted())),
        ]
    )


def monitor_is_wanted():
    """Return 'True' where the monitor was asked for, or can be expected."""
    asked = LaunchConfiguration('monitor')
    return PythonExpression(
        ["'", asked, "' == 'true' or '", asked, "' == 'auto' and r'", PARAMETERS, "' != r'", TABLE_1, "'"]
    )
