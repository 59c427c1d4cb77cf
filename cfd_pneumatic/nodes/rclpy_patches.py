# SPDX-License-Identifier: Apache-2.0
"""Changes of rclpy for programs only: the import of a node leaves rclpy unchanged."""

from __future__ import annotations

from typing import Any

from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.time_source import TimeSource

from cfd_pneumatic.nodes.messages import is_time

_THROTTLE = 5.0  # a continuing warning is repeated after this time [s]

_set_clock = TimeSource.clock_callback


def patch_rclpy() -> None:
    """Prevent rclpy from ending a node because of an invalid `/clock` or a parameter of an unknown type."""
    TimeSource.clock_callback = _set_valid_time  # type: ignore[method-assign, assignment]
    # A parameter of an unknown type is refused like a parameter without a value.
    Parameter.Type._missing_ = classmethod(lambda types, _: types.NOT_SET)  # type: ignore[method-assign, assignment]


def _set_valid_time(source: TimeSource, message: Any) -> None:
    """Set the time from `/clock` if the message is a valid time."""
    if is_time(message.clock.sec, message.clock.nanosec):
        _set_clock(source, message)
    else:
        get_logger('clock').warning('ignored: /clock is no valid time', throttle_duration_sec=_THROTTLE)
