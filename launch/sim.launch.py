"""The simulator beside a device: its topics in one namespace, its inputs from the device's."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

INPUTS = ('piston_state', 'cylinder_a/setpoint', 'cylinder_b/setpoint', 'force_setpoint')


def generate_launch_description():
    device = LaunchConfiguration('device')
    return LaunchDescription(
        [
            DeclareLaunchArgument('device', default_value='/cfd/device', description='namespace of the device'),
            DeclareLaunchArgument('namespace', default_value='/cfd/sim', description='namespace of the simulator'),
            DeclareLaunchArgument(
                'parameters',
                default_value=PathJoinSubstitution([FindPackageShare('cfd_pneumatic'), 'config', 'table_1.yaml']),
                description='parameter file of the simulator, such as the parameters.yaml of an identification',
            ),
            DeclareLaunchArgument('use_sim_time', default_value='false', description='take time from /clock'),
            Node(
                package='cfd_pneumatic',
                executable='sim_node',
                namespace=LaunchConfiguration('namespace'),
                parameters=[LaunchConfiguration('parameters'), {'use_sim_time': LaunchConfiguration('use_sim_time')}],
                remappings=[(topic, [device, '/', topic]) for topic in INPUTS],
                output='screen',
            ),
        ]
    )
