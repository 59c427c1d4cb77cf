# SPDX-License-Identifier: Apache-2.0
"""The simulator beside a device: it hears the device, and publishes in a namespace of its own."""

from launch.actions import DeclareLaunchArgument

from cfd_pneumatic.convention import SIM_INPUTS
from cfd_pneumatic.nodes.launching import TABLE_1, alone_beside_device


def generate_launch_description():
    parameters = DeclareLaunchArgument(
        'parameters',
        default_value=TABLE_1,
        description="parameter file: the parameters.yaml of an identification; the paper's Table 1 where none is given",
    )
    return alone_beside_device('sim_node', 'sim', SIM_INPUTS, parameters)
