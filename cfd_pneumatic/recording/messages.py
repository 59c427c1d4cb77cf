"""The message types of our convention: their names, their obvious fields, and how to make them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

JOINT_STATE = 'sensor_msgs/msg/JointState'
FLUID_PRESSURE = 'sensor_msgs/msg/FluidPressure'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
FLOAT64 = 'std_msgs/msg/Float64'
WRENCH = 'geometry_msgs/msg/Wrench'
VECTOR3 = 'geometry_msgs/msg/Vector3'
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


def _message(msgtype: str, **fields: Any) -> Any:
    return standard_types().types[msgtype](**fields)


def _header(stamp: int) -> Any:
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    return _message(HEADER, stamp=_message(TIME, sec=seconds, nanosec=nanoseconds), frame_id='')


def joint_state(stamp: int, joint: str, position: float) -> object:
    """Return a sensor_msgs/JointState of one joint; stamp [ns], position [m]."""
    none = np.empty(0)
    return _message(
        JOINT_STATE, header=_header(stamp), name=[joint], position=np.array([position]), velocity=none, effort=none
    )


def fluid_pressure(stamp: int, pressure: float) -> object:
    """Return a sensor_msgs/FluidPressure; stamp [ns], absolute pressure [Pa]."""
    return _message(FLUID_PRESSURE, header=_header(stamp), fluid_pressure=pressure, variance=0.0)


def wrench_stamped(stamp: int, force: float) -> object:
    """Return a geometry_msgs/WrenchStamped with a force along x; stamp [ns], force [N]."""
    wrench = _message(
        WRENCH, force=_message(VECTOR3, x=force, y=0.0, z=0.0), torque=_message(VECTOR3, x=0.0, y=0.0, z=0.0)
    )
    return _message(WRENCH_STAMPED, header=_header(stamp), wrench=wrench)


def float64(value: float) -> object:
    """Return a std_msgs/Float64."""
    return _message(FLOAT64, data=value)
