# SPDX-License-Identifier: Apache-2.0
"""Messages made one by one, as rosbags makes them: what ours are compared with."""

from __future__ import annotations

from typing import Any

import numpy as np

from cfd_pneumatic.convention import FLOAT64, FLUID_PRESSURE, JOINT_STATE, WRENCH_STAMPED
from cfd_pneumatic.messages.blocks import MessageBlock
from cfd_pneumatic.messages.types import NANOSECONDS, WRENCH, standard_types
from cfd_pneumatic.recording import BagWriter

VECTOR3 = 'geometry_msgs/msg/Vector3'
HEADER = 'std_msgs/msg/Header'
TIME = 'builtin_interfaces/msg/Time'


def write_message(bag: BagWriter, topic: str, time: int, message: Any) -> None:
    """Write a message on a topic at a time [ns]."""
    payload = standard_types().serialize_cdr(message, message.__msgtype__)
    bag.write(topic, MessageBlock.from_payloads([time], [bytes(payload)]))


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
