"""A cell: the device, or the virtual rig in its place, with the simulator and the monitor beside it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.parameter_descriptions import ParameterValue

from cfd_pneumatic.nodes.launching import (
    CELL,
    DEVICE,
    PARAMETERS,
    TABLE_1,
    USE_SIM_TIME,
    common_arguments,
    device_argument,
    launch_file,
    our_node,
)


def generate_launch_description():
    schedule = ParameterValue(LaunchConfiguration('schedule'), value_type=str)
    return LaunchDescription(
        [
            *common_arguments(),
            *device_argument(),
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
                parameters=[{'schedule': schedule, 'start_subscribers': 1, 'repeat': True}],
                condition=IfCondition(LaunchConfiguration('rig')),
            ),
            beside('sim', condition=None),
            beside('monitor', condition=IfCondition(monitor_is_wanted())),
        ]
    )


def monitor_is_wanted():
    """Return 'True' where the monitor was asked for, or can be expected."""
    asked = LaunchConfiguration('monitor')
    return PythonExpression(
        ["'", asked, "' == 'true' or '", asked, "' == 'auto' and r'", PARAMETERS, "' != r'", TABLE_1, "'"]
    )


def beside(role, condition):
    """Include the launch file of what is beside the device, in a scope of its own: each has its own namespace."""
    arguments = {
        'cell': CELL,
        'device': DEVICE,
        'namespace': [CELL, f'/{role}'],
        'parameters': PARAMETERS,
        'use_sim_time': USE_SIM_TIME,
    }
    included = IncludeLaunchDescription(launch_file(role), launch_arguments=arguments.items())
    return GroupAction([included], condition=condition)
