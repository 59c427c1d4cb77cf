# SPDX-License-Identifier: Apache-2.0
"""Stamps of messages, and QoS of topics."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy

_DEPTH = 5000  # five seconds at 1 kHz: a process that waits for a core loses no messages

SAMPLE_QOS = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort: compatible with every publisher."""

COMMAND_QOS = QoSProfile(depth=_DEPTH)
"""Reliable: no set-point may be lost. As deep as `SAMPLE_QOS`, so that set-points and samples stay in order."""

OUTPUT_QOS = QoSProfile(depth=_DEPTH)
"""Reliable, as drivers publish; as deep as `SAMPLE_QOS`, because samples may arrive in bursts."""

AXES = ('x', 'y', 'z')

_SECOND = 1_000_000_000  # [ns]

LATEST = 2**31 * _SECOND - 1
"""Largest stamp that a message can hold [ns]."""


def nanoseconds(stamp: Time) -> int:
    """Convert a stamp to nanoseconds [ns]."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def is_time(seconds: float, fraction: float) -> bool:
    """Return whether seconds [s] and nanoseconds [ns] are a valid stamp: not negative, and below a second."""
    return seconds >= 0 and fraction < _SECOND


def stamp_message(stamp: int) -> Time:
    """Convert a stamp [ns] to a message."""
    seconds, fraction = divmod(stamp, _SECOND)
    return Time(sec=seconds, nanosec=fraction)
