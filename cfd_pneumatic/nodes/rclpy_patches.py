# SPDX-License-Identifier: Apache-2.0
"""Changes of rclpy, for programs alone: whoever imports a node gets rclpy as it is."""

from __future__ import annotations

from typing import Any

from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.time_source import TimeSource

from cfd_pneumatic.nodes.messages import is_time

_THROTTLE = 5.0  # a warning that keeps coming is repeated this often [s]

_take_clock = TimeSource.clock_callback


def patch_rclpy() -> None:
    """Keep rclpy from ending a node over a `/clock` that is no time, or over a parameter of an unknown type."""
    TimeSource.clock_callback = _take_time  # type: ignore[method-assign, assignment]
    # A parameter of an unknown type is refused as one without a value is.
    Parameter.Type._missing_ = classmethod(lambda types, _: types.NOT_SET)  # type: ignore[method-assign, assignment]


def _take_time(source: TimeSource, message: Any) -> None:
    """Take a message on `/clock` if it is a time."""
    if is_time(message.clock.sec, message.clock.nanosec):
        _take_clock(source, message)
    else:
        get_logger('clock').warning('ignored: /clock is no time', throttle_duration_sec=_THROTTLE)
