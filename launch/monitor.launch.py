"""The watch over a device: its topics in one namespace, the monitor's in another."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

MEASURED = (
    'piston_state',
    'cylinder_a/setpoint',
    'cylinder_b/setpoint',
    'cylinder_a/pressure',
    'cylinder_b/pressure',
    'measured_force',
)


def generate_launch_description():
    device = LaunchConfiguration('device')
    return LaunchDescription(
        [
            DeclareLaunchArgument('device', default_value='/cfd/device', description='namespace of the device'),
            DeclareLaunchArgument('namespace', default_value='/cfd/monitor', description='namespace of the monitor'),
            DeclareLaunchArgument('parameters', description='parameters.yaml of the identification of this device'),
            DeclareLaunchArgument('use_sim_time', default_value='false', description='take time from /clock'),
            Node(
                package='cfd_pneumatic',
                executable='monitor_node',
                namespace=LaunchConfiguration('namespace'),
                parameters=[LaunchConfiguration('parameters'), {'use_sim_time': LaunchConfiguration('use_sim_time')}],
                remappings=[(topic, [device, '/', topic]) for topic in MEASURED],
                output='screen',
            ),
        ]
    )
