# SPDX-License-Identifier: Apache-2.0
"""Bags with paths, written by rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

JOINT_STATE = 'sensor_msgs/msg/JointState'
PATH = 'nav_msgs/msg/Path'
JOINT_TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'

JAZZY = get_typestore(Stores.ROS2_JAZZY)
NOETIC = get_typestore(Stores.ROS1_NOETIC)

BEGIN = 1_700_000_000_000_000_000
"""Time of the first message [ns]."""

MILLISECOND = 1_000_000
NONE = np.empty(0)

Contents = dict[str, list[Any]]
"""Messages by topic; a pair of a type and bytes is a serialised message."""


def message(msgtype: str, types=JAZZY, **fields: Any) -> Any:
    return types.types[msgtype](**fields)


def header(stamp: int = BEGIN, frame: str = 'base', types=JAZZY) -> Any:
    """Return a header; stamp [ns]."""
    time = message('builtin_interfaces/msg/Time', types, sec=stamp // 10**9, nanosec=stamp % 10**9)
    sequence = {'seq': 0} if types is NOETIC else {}
    return message('std_msgs/msg/Header', types, stamp=time, frame_id=frame, **sequence)


def joint_states(positions, names=('piston',), types=JAZZY) -> list[Any]:
    """Return joint states at 100 Hz, shape (n,) or (n, joints) [m]."""
    return [
        message(
            JOINT_STATE,
            types,
            header=header(BEGIN + 10 * MILLISECOND * index, types=types),
            name=list(names),
            position=np.atleast_1d(np.asarray(row, float)),
            velocity=NONE,
            effort=NONE,
        )
        for index, row in enumerate(positions)
    ]


def planned_path(points, frame: str = 'base', types=JAZZY) -> Any:
    """Return a nav_msgs/Path through points, shape (n, 3) [m]; the poses are in a frame."""
    upright = message('geometry_msgs/msg/Quaternion', types, x=0.0, y=0.0, z=0.0, w=1.0)
    poses = [
        message(
            'geometry_msgs/msg/PoseStamped',
            types,
            header=header(frame=frame, types=types),
            pose=message(
                'geometry_msgs/msg/Pose',
                types,
                position=message('geometry_msgs/msg/Point', types, x=float(x), y=float(y), z=float(z)),
                orientation=upright,
            ),
        )
        for x, y, z in points
    ]
    return message(PATH, types, header=header(types=types), poses=poses)


def trajectory(times, positions, names=('piston',)) -> Any:
    """Return a trajectory_msgs/JointTrajectory; times [ms], positions of shape (n, joints) [m]."""
    points = [
        message(
            'trajectory_msgs/msg/JointTrajectoryPoint',
            positions=np.asarray(row, float),
            velocities=NONE,
            accelerations=NONE,
            effort=NONE,
            time_from_start=message(
                'builtin_interfaces/msg/Duration', sec=int(time // 1000), nanosec=int(time % 1000) * MILLISECOND
            ),
        )
        for time, row in zip(times, positions)
    ]
    return message(JOINT_TRAJECTORY, header=header(), joint_names=list(names), points=points)


def write_bag(folder: Path, contents: Contents, *, storage: str = 'mcap', types=JAZZY) -> Path:
    """Write messages at 100 Hz as a ROS 2 bag."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for topic, messages in contents.items():
            msgtype = messages[0][0] if isinstance(messages[0], tuple) else messages[0].__msgtype__
            connection = writer.add_connection(topic, msgtype, typestore=types)
            for index, content in enumerate(messages):
                payload = content[1] if isinstance(content, tuple) else types.serialize_cdr(content, msgtype)
                writer.write(connection, BEGIN + 10 * MILLISECOND * index, bytes(payload))
    return folder


def write_ros1_bag(path: Path, contents: Contents) -> Path:
    """Write messages at 100 Hz as a ROS 1 bag."""
    with Ros1Writer(path) as writer:
        for topic, messages in contents.items():
            msgtype = messages[0].__msgtype__
            connection = writer.add_connection(topic, msgtype, typestore=NOETIC)
            for index, content in enumerate(messages):
                payload = NOETIC.serialize_ros1(content, msgtype)
                writer.write(connection, BEGIN + 10 * MILLISECOND * index, payload)
    return path
