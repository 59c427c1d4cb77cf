# SPDX-License-Identifier: Apache-2.0
"""Start the monitor of a device, in a separate namespace."""

from launch.actions import DeclareLaunchArgument

from cfd_pneumatic.convention import MONITOR_INPUTS
from cfd_pneumatic.nodes.launching import listener_launch


def generate_launch_description():
    parameters = DeclareLaunchArgument(
        'parameters', description='parameter file: the parameters.yaml of the identification of this device'
    )
    return listener_launch('monitor_node', 'monitor', MONITOR_INPUTS, parameters)
