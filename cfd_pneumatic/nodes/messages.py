# SPDX-License-Identifier: Apache-2.0
"""Parts of messages, and how reliably and deep topics are queued."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy

_DEPTH = 5000  # five seconds at 1 kHz: a process that has to wait for a core loses nothing

SAMPLE_QOS = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Fits every publisher."""

COMMAND_QOS = QoSProfile(depth=_DEPTH)
"""Reliable: no set-point may be lost; as deep as `SAMPLE_QOS`, or a burst would part set-points from their samples."""

OUTPUT_QOS = QoSProfile(depth=_DEPTH)
"""Reliable, as a driver publishes; as deep as what it answers, which may come in a burst."""

AXES = ('x', 'y', 'z')

_SECOND = 1_000_000_000  # [ns]

LATEST = 2**31 * _SECOND - 1
"""The last stamp that fits into a message [ns]."""


def nanoseconds(stamp: Time) -> int:
    """Return a stamp as one number [ns]."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def is_time(seconds: float, rest: float) -> bool:
    """Tell whether a stamp's seconds [s] and nanoseconds [ns] are a time: none before 1970, and no second of rest."""
    return seconds >= 0 and rest < _SECOND


def stamp_message(stamp: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, rest = divmod(stamp, _SECOND)
    return Time(sec=seconds, nanosec=rest)
