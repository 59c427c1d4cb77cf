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


def nanoseconds(stamp: Time) -> int:
    """Return a stamp as one number [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamp_message(stamp: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)
