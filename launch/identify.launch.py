# SPDX-License-Identifier: Apache-2.0
"""The identifier of a cell: on request it identifies bags, and sets the result on the cell's simulator."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

from cfd_pneumatic.nodes.launching import CELL, common_arguments, our_node


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
                description='folders below which bags and mapping have to be, with commas in between; none: the '
                'working folder, unless it is the home folder or above it',
            ),
            DeclareLaunchArgument(
                'output_folder',
                default_value='none',
                description='folder below which output_dir has to be; none: the working folder, unless it is the home '
                'folder or above it',
            ),
            DeclareLaunchArgument(
                'bags',
                default_value='none',
                description='paths of the bags to identify jointly, with commas in between; '
                'they may be set later too, as the parameter of that name',
            ),
            DeclareLaunchArgument(
                'output_dir', default_value='identified', description='folder for the reports and parameters.yaml'
            ),
            DeclareLaunchArgument(
                'mapping', default_value='none', description='mapping file of bags with topics other than ours'
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
                description='node on which the result is set; none for no node',
            ),
            our_node('identifier_node', namespace=CELL, parameters=[{**lists, **texts, **switches}]),
        ]
    )
