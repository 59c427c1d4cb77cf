# SPDX-License-Identifier: Apache-2.0
"""The ROS shells: the only place that imports rclpy."""
