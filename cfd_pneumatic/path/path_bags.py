# SPDX-License-Identifier: Apache-2.0
"""Read a path from a bag: the recorded motion of a piston, a planned path, or a planned motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import JOINT_STATE, PISTON_JOINT, PISTON_STATE
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.messages import NANOSECONDS, decode_whole
from cfd_pneumatic.path.motion import MOST_POINTS, PathMotion, Surface
from cfd_pneumatic.recording import Bag, Topic, count_of, list_topics, listed, read_displacement

PATH = 'nav_msgs/msg/Path'
JOINT_TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'

AXES = ('x', 'y', 'z')


def read_path_bag(path: Path, *, joint: str, axis: str, topic: str) -> Surface | PathMotion:
    """
    Read a path from a bag.

    Parameters
    ----------
    path : Path
        A bag: folder or file.
    joint : str
        Name of the piston among the joints; if empty, the only joint or the joint `piston`.
    axis : str
        Axis of a nav_msgs/Path along which the piston moves: x, y or z.
    topic : str
        Topic; if empty, the only topic that holds a path.

    Raises
    ------
    InputError
        If the bag cannot be read, or does not hold exactly one path.

    """
    with Bag(path) as bag:
        source = _choose_topic(bag, topic)
        if source.msgtype == JOINT_STATE:
            return _read_joint_states(bag, source, joint)
        with _errors_name(source):
            message, notes = _last_message(bag, source)
            return _surface_of(message, axis, notes) if source.msgtype == PATH else _motion_of(message, joint, notes)


@contextmanager
def _errors_name(topic: Topic) -> Iterator[None]:
    """Let errors begin with the name of a topic."""
    try:
        yield
    except InputError as error:
        raise InputError(f'topic {printable(topic.name)}: {error}') from error


def _choose_topic(bag: Bag, wanted: str) -> Topic:
    """Return the topic of the path: the wanted topic, or the only one that holds a path."""
    held = {name: topic for name, topic in bag.topics.items() if topic.count}
    if wanted:
        chosen = held.get(f'/{wanted.strip("/")}')
        if chosen is None:
            raise InputError(f'has no messages on topic {printable(wanted)}: the topics are {list_topics(held)}')
        if chosen.msgtype not in (JOINT_STATE, PATH, JOINT_TRAJECTORY):
            raise InputError(
                f'topic {printable(chosen.name)} holds {printable(chosen.msgtype)}: '
                f'choose a topic of {JOINT_STATE}, {PATH} or {JOINT_TRAJECTORY}; the topics are {list_topics(held)}'
            )
        return chosen
    found = {
        name: topic
        for name, topic in held.items()
        if topic.msgtype in (PATH, JOINT_TRAJECTORY)
        or (topic.msgtype == JOINT_STATE and name.endswith(f'/{PISTON_STATE}'))
    }
    if not found:
        raise InputError(
            f'has no topic of a path, neither {PISTON_STATE} nor {PATH} nor {JOINT_TRAJECTORY}: '
            f'choose a JointState of the piston with --topic; the topics are {list_topics(held)}'
        )
    if len(found) > 1:
        raise InputError(f'has {len(found)} topics of a path: choose with --topic one of {list_topics(found)}')
    return next(iter(found.values()))


def _read_joint_states(bag: Bag, topic: Topic, joint: str) -> PathMotion:
    """Return the recorded motion of a joint."""
    with _errors_name(topic):
        if topic.count > MOST_POINTS:
            raise InputError(f'has more than {MOST_POINTS:,} messages: cut the bag')
        joint = joint or _choose_joint(_first_message(bag, topic).name, '')
    signal, notes = read_displacement(bag, topic.name, joint)
    with _errors_name(topic):
        return PathMotion(signal.times, signal.values, notes=_notes(bag.notes, notes))


def _first_message(bag: Bag, topic: Topic) -> Any:
    """Return the first message of a topic."""
    first = next((block.payload(0) for _, block in bag.blocks([topic.name]) if len(block)), None)
    if first is None:
        raise InputError('has no messages: record it again')
    return decode_whole(first, topic.connections, bag.serialization)


def _last_message(bag: Bag, topic: Topic) -> tuple[Any, tuple[str, ...]]:
    """Return the last message of a topic, and notes to the user."""
    last, count = None, 0
    for _, block in bag.blocks([topic.name]):
        count += len(block)
        last = block.payload(len(block) - 1) if len(block) else last
    if last is None:
        raise InputError('has no messages: record it again')
    message = decode_whole(last, topic.connections, bag.serialization)
    repeated = [f'topic {topic.name} has {count_of(count, "message")}: the last is used'] if count > 1 else []
    return message, _notes(bag.notes, repeated)


def _surface_of(message: Any, axis: str, notes: tuple[str, ...]) -> Surface:
    """Return the surface in a nav_msgs/Path: its coordinate along an axis over the distance across the axis."""
    if not message.poses:
        raise InputError('its last message has no poses: publish a path')
    frames = {message.header.frame_id, *(pose.header.frame_id for pose in message.poses)} - {''}
    if len(frames) > 1:
        raise InputError(f'has poses in several frames ({listed(sorted(frames))}): transform them to a single frame')
    points = np.array([(pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) for pose in message.poses])
    height = points[:, AXES.index(axis)]
    with np.errstate(over='ignore', invalid='ignore'):
        steps = np.hypot(*np.diff(np.delete(points, AXES.index(axis), axis=1), axis=0).T)
        return Surface(np.concatenate([[0.0], np.cumsum(steps)]), height - height[0], notes)


def _motion_of(message: Any, joint: str, notes: tuple[str, ...]) -> PathMotion:
    """Return the motion of a joint in a trajectory_msgs/JointTrajectory."""
    if not message.points:
        raise InputError('its last message has no points: publish a path')
    index = message.joint_names.index(_choose_joint(message.joint_names, joint))
    short = next((number for number, point in enumerate(message.points, 1) if len(point.positions) <= index), None)
    if short is not None:
        raise InputError(f'point {short:,} has no position of the joint: publish a position for each joint')
    times = [NANOSECONDS * point.time_from_start.sec + point.time_from_start.nanosec for point in message.points]
    return PathMotion(_seconds(times), np.array([point.positions[index] for point in message.points]), notes=notes)


def _seconds(times: Sequence[int]) -> Array:
    """Return times [ns] as seconds since the first."""
    return (np.array(times, np.int64) - times[0]) / NANOSECONDS


def _choose_joint(names: Sequence[str], wanted: str) -> str:
    """Return the joint of the piston: the wanted joint, the only joint, or the joint `piston`."""
    if not names:
        raise InputError('its messages name no joint: publish the names of the joints')
    chosen = wanted or (names[0] if len(set(names)) == 1 else PISTON_JOINT)
    if chosen in names:
        return chosen
    if wanted:
        raise InputError(f'has no joint {printable(wanted)}: the joints are {listed(names)}')
    raise InputError(f'has several joints: choose with --joint one of {listed(names)}')


def _notes(*groups: Sequence[str]) -> tuple[str, ...]:
    return tuple(printable(note) for group in groups for note in group)
