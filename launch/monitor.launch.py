# SPDX-License-Identifier: Apache-2.0
"""The watch over a device: it hears the device, and publishes in a namespace of its own."""

from launch.actions import DeclareLaunchArgument

from cfd_pneumatic.convention import MONITOR_INPUTS
from cfd_pneumatic.nodes.launching import alone_beside_device


def generate_launch_description():
    parameters = DeclareLaunchArgument(
        'parameters', description='parameter file: the parameters.yaml of the identification of this device'
    )
    return alone_beside_device('monitor_node', 'monitor', MONITOR_INPUTS, parameters)
