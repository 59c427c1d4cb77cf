# SPDX-License-Identifier: Apache-2.0
"""Start the simulator of a device, in a separate namespace."""

from launch.actions import DeclareLaunchArgument

from cfd_pneumatic.convention import SIM_INPUTS
from cfd_pneumatic.nodes.launching import TABLE_1, listener_launch


def generate_launch_description():
    parameters = DeclareLaunchArgument(
        'parameters',
        default_value=TABLE_1,
        description="parameter file: the parameters.yaml of an identification; default: the paper's Table 1",
    )
    return listener_launch('sim_node', 'sim', SIM_INPUTS, parameters)
