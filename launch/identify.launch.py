# SPDX-License-Identifier: Apache-2.0
"""Start the identifier of a cell: it identifies bags on request, and sets the result on the cell's simulator."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

from cfd_pneumatic.nodes.launching import CELL, common_arguments, package_node


def generate_launch_description():
    switch = {'default_value': 'false', 'choices': ['true', 'false']}
    lists = {name: ['[', LaunchConfiguration(name), ']'] for name in ('input_folders', 'bags')}
    texts = {
        name: ParameterValue(LaunchConfiguration(name), value_type=str)
        for name in ('output_folder', 'output_dir', 'mapping', 'apply_to')
    }
    switches = {name: LaunchConfiguration(name) for name in ('close_loop', 'per_setpoint', 'overwrite')}
    return LaunchDescription(
        [
            *common_arguments(),
            DeclareLaunchArgument(
                'input_folders',
                default_value='none',
                description='folders below which bags and mapping must be, separated by commas; none: the '
                'working folder, unless it is the home folder or above it',
            ),
            DeclareLaunchArgument(
                'output_folder',
                default_value='none',
                description='folder below which output_dir must be; none: the working folder, unless it is the home '
                'folder or above it',
            ),
            DeclareLaunchArgument(
                'bags',
                default_value='none',
                description='paths of the bags to identify jointly, separated by commas; '
                'the parameter bags may also be set later',
            ),
            DeclareLaunchArgument(
                'output_dir', default_value='identified', description='folder for the reports and parameters.yaml'
            ),
            DeclareLaunchArgument(
                'mapping', default_value='none', description='mapping file for bags with other topics'
            ),
            DeclareLaunchArgument(
                'close_loop', description='true: name the physical effects that the model lacks, and add them', **switch
            ),
            DeclareLaunchArgument('per_setpoint', description='true: fit a table of operating points', **switch),
            DeclareLaunchArgument(
                'overwrite', description='true: replace files in output_dir that identify_bag did not write', **switch
            ),
            DeclareLaunchArgument(
                'apply_to',
                default_value=[CELL, '/sim/sim_node'],
                description='node on which the result is set; none: no node',
            ),
            package_node('identifier_node', namespace=CELL, parameters=[{**lists, **texts, **switches}]),
        ]
    )
