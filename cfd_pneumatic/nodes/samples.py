# SPDX-License-Identifier: Apache-2.0
"""
Samples in messages: a stamp and one number, read from serialised messages and written into them.

rclpy takes longer to make a `JointState` of its bytes than the model takes for a step, and there are five answers to a
sample. So stamp and number are taken from the bytes, where the layout of the message before says, and filled into an
answer that was serialised once. Whether rclpy takes the bytes likewise is tried when a reader or writer is made; where
it doesn't, messages are made after all, and the node says so.
"""

from __future__ import annotations

import copy
import importlib
import re
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from cfd_pneumatic.convention import FLUID_PRESSURE, JOINT_STATE, WRENCH_STAMPED
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.messages import (
    NANOSECOND,
    NANOSECONDS,
    SECOND,
    FieldPath,
    Form,
    Layout,
    LayoutError,
    Place,
    Serialization,
    Step,
    types_with,
)
from cfd_pneumatic.nodes.messages import is_time, nanoseconds, stamp_message

Sample = tuple['int | None', float]
"""A stamp [ns], None where it is no time, and a number."""

_TYPE_NAME = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')  # the grammar of ROS 2
_LONGEST_SHOWN = 100  # characters of a type's name in a message

_TRIED = (12_000_000_034, 56.78)

_LARGEST = 64 * 1024
"""Size of a message in which a sample is looked for [bytes]: a thousand joints. A larger one takes long to parse."""


class SampleReader(Protocol):
    """Reads the samples of a topic."""

    @property
    def names(self) -> list[str]:
        """Names of the entries in the last message, as JointState has them."""

    def read(self, message: bytes) -> Sample | None:
        """Return what a serialised message tells; None where it has no such number, or is none of its type."""


class SampleWriter(Protocol):
    """Makes the messages of a topic."""

    def filled(self, stamp: int, number: float) -> Any:
        """Return a message with a stamp [ns] and a number, or its bytes: a publisher takes both."""


def joint_reader(node: Node, joint: str) -> SampleReader:
    """Return what reads the position of a joint [m]."""
    example = _blank(JOINT_STATE)
    example.name = [joint]
    return _reader(node, JOINT_STATE, FieldPath((Step('position', joint),)), example)


def pressure_reader(node: Node) -> SampleReader:
    """Return what reads a pressure [Pa]."""
    return _reader(node, FLUID_PRESSURE, _PRESSURE, _blank(FLUID_PRESSURE))


def force_reader(node: Node, axis: str) -> SampleReader:
    """Return what reads a force along an axis [N]."""
    return _reader(node, WRENCH_STAMPED, _force(axis), _blank(WRENCH_STAMPED))


def pressure_writer(node: Node, frame_id: str) -> SampleWriter:
    """Return what makes messages of a pressure [Pa]."""
    return _writer(node, Form(FLUID_PRESSURE, frame_id=frame_id), _PRESSURE, frame_id)


def force_writer(node: Node, frame_id: str, axis: str) -> SampleWriter:
    """Return what makes messages of a force along an axis [N]."""
    return _writer(node, Form(WRENCH_STAMPED, axis=axis, frame_id=frame_id), _force(axis), frame_id)


def is_message_type(name: str) -> bool:
    """Return whether a name is that of a message type that ROS 2 ships."""
    return _TYPE_NAME.fullmatch(name) is not None and name in types_with(name).fielddefs


def message_class(msgtype: str) -> Any:
    """
    Return the class of a message type such as std_msgs/msg/Float64.

    The name may come from a stranger in the graph, and to import a module runs the module. So only the packages of
    messages that ROS 2 ships are imported.

    Raises
    ------
    InputError
        If the name is not the name of a message type, or its package is not installed.

    """
    if not is_message_type(msgtype):
        raise InputError(f'{printable(msgtype)[:_LONGEST_SHOWN]} is not a message type that ROS 2 ships')
    package, _, name = msgtype.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f'the package {package} is not installed with the message {name}: install it') from error


class _ByLayout:
    """Reads bytes, which are mostly laid out like those before."""

    def __init__(self, msgtype: str, path: FieldPath) -> None:
        self._msgtype, self._path = msgtype, path
        self._layout: Layout | None = None
        self._places: tuple[Place, Place, Place] | None = None

    @property
    def names(self) -> list[str]:
        return [] if self._layout is None else self._layout.names()

    def read(self, message: bytes) -> Sample | None:
        if len(message) > _LARGEST:
            self._layout = None
            return None
        if self._layout is None or not self._layout.fits(message):
            self._learn(message)
        if self._places is None:
            return None
        seconds, rest, number = (place.number(message) for place in self._places)
        return int(seconds) * NANOSECONDS + int(rest) if is_time(seconds, rest) else None, number

    def _learn(self, message: bytes) -> None:
        """Find out where stamp and number are."""
        self._layout, self._places = None, None
        try:
            self._layout = layout = Layout(message, types_with(self._msgtype), self._msgtype, Serialization.CDR)
        except LayoutError:
            return
        seconds, rest, number = map(layout.place, (SECOND, NANOSECOND, self._path))
        if seconds and rest and number:
            self._places = seconds, rest, number


class _ByMessage:
    """Has rclpy make a message of the bytes."""

    def __init__(self, msgtype: str, path: FieldPath) -> None:
        self._class, self._path = message_class(msgtype), path
        self.names: list[str] = []

    def read(self, message: bytes) -> Sample | None:
        self.names = []
        if len(message) > _LARGEST:
            return None
        try:
            made = deserialize_message(message, self._class)
        except Exception:  # whatever the middleware has for it
            return None
        self.names = list(getattr(made, 'name', []))
        number = _number_in(made, self._path)
        stamp = made.header.stamp
        return None if number is None else (nanoseconds(stamp) if is_time(stamp.sec, stamp.nanosec) else None, number)


class _Message:
    """A message of rclpy's, filled anew for each sample."""

    def __init__(self, form: Form, path: FieldPath, frame_id: str) -> None:
        self._blank, self._path = _blank(form.msgtype), path
        self._blank.header.frame_id = frame_id

    def filled(self, stamp: int, number: float) -> Any:
        made = copy.deepcopy(self._blank)
        _put(made, self._path, (stamp, number))
        return made


_PRESSURE = FieldPath((Step('fluid_pressure'),))


def _force(axis: str) -> FieldPath:
    return FieldPath((Step('wrench'), Step('force'), Step(axis)))


def _reader(node: Node, msgtype: str, path: FieldPath, example: Any) -> SampleReader:
    """Return what reads samples; `example` is a message that has the path."""
    _put(example, path, _TRIED)
    if _ByLayout(msgtype, path).read(bytes(serialize_message(example))) == _TRIED:
        return _ByLayout(msgtype, path)
    _warn(node, msgtype)
    return _ByMessage(msgtype, path)


def _writer(node: Node, form: Form, path: FieldPath, frame_id: str) -> SampleWriter:
    """Return what makes messages by a form, or without one."""
    try:
        made = deserialize_message(form.filled(*_TRIED), message_class(form.msgtype))
        told = (nanoseconds(made.header.stamp), _number_in(made, path), made.header.frame_id)
    except Exception:  # whatever the middleware has for it
        told = None
    if told == (*_TRIED, frame_id):
        return form
    _warn(node, form.msgtype)
    return _Message(form, path, frame_id)


def _number_in(message: Any, path: FieldPath) -> float | None:
    """Return the number of a message at a path."""
    for step in path.steps:
        names, message = getattr(message, 'name', ()), getattr(message, step.name)
        if step.index is not None:
            return dict(zip(names, message)).get(step.index)
    return float(message)


def _put(message: Any, path: FieldPath, sample: tuple[int, float]) -> None:
    """Write a sample into a message; an array at the path has it as its only entry."""
    stamp, number = sample
    message.header.stamp = stamp_message(stamp)
    *above, last = path.steps
    for step in above:
        message = getattr(message, step.name)
    setattr(message, last.name, number if last.index is None else [number])


def _blank(msgtype: str) -> Any:
    return message_class(msgtype)()


def _warn(node: Node, msgtype: str) -> None:
    node.get_logger().warning(
        f'{msgtype} is serialised otherwise than expected here: messages are made one by one, which takes longer'
    )
