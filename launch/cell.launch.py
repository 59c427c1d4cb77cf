"""The virtual rig in the device's place, playing a schedule over and over, with the simulator beside it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    device = LaunchConfiguration('device')
    sim = PathJoinSubstitution([FindPackageShare('cfd_pneumatic'), 'launch', 'sim.launch.py'])
    return LaunchDescription(
        [
            DeclareLaunchArgument('device', default_value='/cfd/device', description='namespace of the rig'),
            DeclareLaunchArgument(
                'schedule',
                default_value='surface_following',
                description="what the rig plays: paper_step, out_and_back, surface_following, or '' for piston_command",
            ),
            Node(
                package='cfd_pneumatic',
                executable='rig_node',
                namespace=device,
                parameters=[{'schedule': LaunchConfiguration('schedule'), 'start_subscribers': 1, 'repeat': True}],
                output='screen',
            ),
            IncludeLaunchDescription(sim, launch_arguments={'device': device}.items()),
        ]
    )
