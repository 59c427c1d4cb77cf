# SPDX-License-Identifier: Apache-2.0
"""ROS nodes: the only package that imports rclpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.nodes.folders import Folders
    from cfd_pneumatic.nodes.health import LOST
    from cfd_pneumatic.nodes.identifier_node import IdentifierNode
    from cfd_pneumatic.nodes.messages import OUTPUT_QOS, SAMPLE_QOS, nanoseconds, stamp_message
    from cfd_pneumatic.nodes.monitor_node import MonitorNode
    from cfd_pneumatic.nodes.parameters import warn_of_undeclared
    from cfd_pneumatic.nodes.rclpy_patches import patch_rclpy
    from cfd_pneumatic.nodes.recorder_node import RecorderNode
    from cfd_pneumatic.nodes.rig_node import RigNode
    from cfd_pneumatic.nodes.samples import message_class
    from cfd_pneumatic.nodes.sim_node import SimNode
else:
    __getattr__ = loader_of(__name__)
