"""Message types that ROS 2 ships, and which number each is about."""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from cfd_pneumatic.convention import FLOAT64, FLUID_PRESSURE, JOINT_STATE, WRENCH_STAMPED

WRENCH = 'geometry_msgs/msg/Wrench'
FLOAT32 = 'std_msgs/msg/Float32'
HEADER = 'std_msgs/msg/Header'
TIME = 'builtin_interfaces/msg/Time'

NANOSECONDS = 1_000_000_000
"""In a second."""


def obvious_field(msgtype: str, *, joint: str, force_axis: str) -> str | None:
    """Return the path of the number that a message of a standard type is about, None for other types."""
    return {
        JOINT_STATE: f'position[{joint}]',
        FLUID_PRESSURE: 'fluid_pressure',
        WRENCH_STAMPED: f'wrench.force.{force_axis}',
        WRENCH: f'force.{force_axis}',
        FLOAT64: 'data',
        FLOAT32: 'data',
    }.get(msgtype)


@cache
def standard_types() -> Typestore:
    """Return the message types that ROS 2 ships. Shared: do not register types in it."""
    return get_typestore(Stores.LATEST)
