# SPDX-License-Identifier: Apache-2.0
"""Start a cell: the device or the virtual rig, the simulator, and the monitor."""

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
    common_arguments,
    device_argument,
    device_listener,
    package_node,
    topic_arguments,
)


def generate_launch_description():
    schedule, joint = (ParameterValue(LaunchConfiguration(name), value_type=str) for name in ('schedule', 'joint'))
    return LaunchDescription(
        [
            *common_arguments(),
            *device_argument(),
            *topic_arguments(dict.fromkeys((*SIM_INPUTS, *MONITOR_INPUTS))),
            DeclareLaunchArgument(
                'rig',
                default_value='true',
                choices=['true', 'false'],
                description="true: the virtual rig is the device; false: a real device's drivers run",
            ),
            DeclareLaunchArgument(
                'schedule',
                default_value='surface_following',
                description='schedule that the rig repeats: paper_step, out_and_back, surface_following, or a '
                'schedule.csv; none: the piston follows piston_command [m]',
            ),
            DeclareLaunchArgument(
                'parameters',
                default_value=TABLE_1,
                description='parameter file of simulator and monitor: the parameters.yaml of the identification of '
                "this device; default: the paper's Table 1",
            ),
            DeclareLaunchArgument(
                'monitor',
                default_value='auto',
                choices=['auto', 'true', 'false'],
                description='auto: the monitor runs if parameters are given, because it needs those of this device',
            ),
            package_node(
                'rig_node',
                namespace=DEVICE,
                parameters=[{'schedule': schedule, 'start_subscribers': 1, 'repeat': True, 'joint': joint}],
                remappings=[(topic, LaunchConfiguration(topic)) for topic in MONITOR_INPUTS],
                condition=IfCondition(LaunchConfiguration('rig')),
            ),
            device_listener('sim_node', 'sim', SIM_INPUTS),
            device_listener('monitor_node', 'monitor', MONITOR_INPUTS, condition=IfCondition(monitor_is_wanted())),
        ]
    )


def monitor_is_wanted():
    """Return 'True' if the monitor is requested, or if it is `auto` and parameters are given."""
    monitor = LaunchConfiguration('monitor')
    return PythonExpression(
        ["'", monitor, "' == 'true' or '", monitor, "' == 'auto' and r'", PARAMETERS, "' != r'", TABLE_1, "'"]
    )
