# SPDX-License-Identifier: Apache-2.0
"""Message types that ROS 2 ships, and the main number of each."""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cfd_pneumatic.convention import FLOAT64, FLUID_PRESSURE, JOINT_STATE, WRENCH_STAMPED

WRENCH = 'geometry_msgs/msg/Wrench'
FLOAT32 = 'std_msgs/msg/Float32'
HEADER = 'std_msgs/msg/Header'
TIME = 'builtin_interfaces/msg/Time'

# definitions of ROS 2 for the types that this package reads and writes
_EVERYDAY = {
    JOINT_STATE: 'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort',
    FLUID_PRESSURE: 'std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance',
    WRENCH_STAMPED: 'std_msgs/Header header\ngeometry_msgs/Wrench wrench',
    WRENCH: 'geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque',
    'geometry_msgs/msg/Vector3': 'float64 x\nfloat64 y\nfloat64 z',
    HEADER: 'builtin_interfaces/Time stamp\nstring frame_id',
    TIME: 'int32 sec\nuint32 nanosec',
    FLOAT64: 'float64 data',
    FLOAT32: 'float32 data',
}

NANOSECONDS = 1_000_000_000
"""In a second."""


def obvious_field(msgtype: str, *, joint: str, force_axis: str) -> str | None:
    """Return the path of the main number of a standard message type; None for other types."""
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


def types_with(msgtype: str) -> Typestore:
    """Return types that ROS 2 ships, including `msgtype`; loading the everyday types takes a tenth of the time."""
    return _everyday_types() if msgtype in _EVERYDAY else standard_types()


@cache
def _everyday_types() -> Typestore:
    types = get_typestore(Stores.EMPTY)
    types.register(
        {
            name: fields
            for msgtype, text in _EVERYDAY.items()
            for name, fields in get_types_from_msg(text, msgtype).items()
        }
    )
    return types
