# SPDX-License-Identifier: Apache-2.0
"""
Readers and writers of samples: a stamp and a number in a serialised message.

rclpy needs longer to deserialise a `JointState` than the model needs for a step, and each sample has five answers. So
readers take stamp and number from the bytes, at the places of the message before. Writers fill them into an answer that
was serialised once. A trial compares the bytes with rclpy's when a reader or writer is created. If they differ, rclpy
handles the messages, and the node logs a warning.
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
"""A stamp [ns], None if the stamp is invalid, and a number."""

_TYPE_NAME = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')  # the grammar of ROS 2
_LONGEST_SHOWN = 100  # characters of a type's name in a message

_TEST_SAMPLE = (12_000_000_034, 56.78)

_LARGEST = 64 * 1024
"""Largest message that is read [bytes]: a thousand joints. A larger message takes too long to parse."""


class SampleReader(Protocol):
    """Reads the samples of a topic."""

    @property
    def names(self) -> list[str]:
        """Names of the entries in the last message, as JointState has them."""

    def read(self, message: bytes) -> Sample | None:
        """Return the sample of a serialised message; None if the number is missing or the type is wrong."""


class SampleWriter(Protocol):
    """Makes the messages of a topic."""

    def filled(self, stamp: int, number: float) -> Any:
        """Return a message with a stamp [ns] and a number, or its bytes: a publisher takes both."""


def joint_reader(node: Node, joint: str) -> SampleReader:
    """Return a reader for the position of a joint [m]."""
    example = _empty_message(JOINT_STATE)
    example.name = [joint]
    return _reader(node, JOINT_STATE, FieldPath((Step('position', joint),)), example)


def pressure_reader(node: Node) -> SampleReader:
    """Return a reader for a pressure [Pa]."""
    return _reader(node, FLUID_PRESSURE, _PRESSURE, _empty_message(FLUID_PRESSURE))


def force_reader(node: Node, axis: str) -> SampleReader:
    """Return a reader for a force along an axis [N]."""
    return _reader(node, WRENCH_STAMPED, _force(axis), _empty_message(WRENCH_STAMPED))


def pressure_writer(node: Node, frame_id: str) -> SampleWriter:
    """Return a writer for messages of a pressure [Pa]."""
    return _writer(node, Form(FLUID_PRESSURE, frame_id=frame_id), _PRESSURE, frame_id)


def force_writer(node: Node, frame_id: str, axis: str) -> SampleWriter:
    """Return a writer for messages of a force along an axis [N]."""
    return _writer(node, Form(WRENCH_STAMPED, axis=axis, frame_id=frame_id), _force(axis), frame_id)


def is_message_type(name: str) -> bool:
    """Return whether a name is that of a message type that ROS 2 ships."""
    return _TYPE_NAME.fullmatch(name) is not None and name in types_with(name).fielddefs


def message_class(msgtype: str) -> Any:
    """
    Return the class of a message type such as std_msgs/msg/Float64.

    Any node in the graph may send the name, and an import runs the module. So only packages of messages that ROS 2
    ships are imported.

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


class _LayoutReader:
    """Reads bytes by the layout of the message before."""

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
            self._learn_layout(message)
        if self._places is None:
            return None
        seconds, fraction, number = (place.number(message) for place in self._places)
        return int(seconds) * NANOSECONDS + int(fraction) if is_time(seconds, fraction) else None, number

    def _learn_layout(self, message: bytes) -> None:
        """Find the places of stamp and number."""
        self._layout, self._places = None, None
        try:
            self._layout = layout = Layout(message, types_with(self._msgtype), self._msgtype, Serialization.CDR)
        except LayoutError:
            return
        seconds, fraction, number = map(layout.place, (SECOND, NANOSECOND, self._path))
        if seconds and fraction and number:
            self._places = seconds, fraction, number


class _MessageReader:
    """Reads messages that rclpy deserialises."""

    def __init__(self, msgtype: str, path: FieldPath) -> None:
        self._class, self._path = message_class(msgtype), path
        self.names: list[str] = []

    def read(self, message: bytes) -> Sample | None:
        self.names = []
        if len(message) > _LARGEST:
            return None
        try:
            parsed = deserialize_message(message, self._class)
        except Exception:  # the middleware raises any exception for bytes that it cannot parse
            return None
        self.names = list(getattr(parsed, 'name', []))
        number = _number_at(parsed, self._path)
        stamp = parsed.header.stamp
        return None if number is None else (nanoseconds(stamp) if is_time(stamp.sec, stamp.nanosec) else None, number)


class _MessageWriter:
    """Writes messages that rclpy serialises."""

    def __init__(self, form: Form, path: FieldPath, frame_id: str) -> None:
        self._blank, self._path = _empty_message(form.msgtype), path
        self._blank.header.frame_id = frame_id

    def filled(self, stamp: int, number: float) -> Any:
        message = copy.deepcopy(self._blank)
        _write_sample(message, self._path, (stamp, number))
        return message


_PRESSURE = FieldPath((Step('fluid_pressure'),))


def _force(axis: str) -> FieldPath:
    return FieldPath((Step('wrench'), Step('force'), Step(axis)))


def _reader(node: Node, msgtype: str, path: FieldPath, example: Any) -> SampleReader:
    """Return a reader of samples; `example` is a message with the path."""
    _write_sample(example, path, _TEST_SAMPLE)
    if _LayoutReader(msgtype, path).read(bytes(serialize_message(example))) == _TEST_SAMPLE:
        return _LayoutReader(msgtype, path)
    _warn(node, msgtype)
    return _MessageReader(msgtype, path)


def _writer(node: Node, form: Form, path: FieldPath, frame_id: str) -> SampleWriter:
    """Return a writer of messages: the form if rclpy reads its bytes, otherwise a message of rclpy."""
    try:
        message = deserialize_message(form.filled(*_TEST_SAMPLE), message_class(form.msgtype))
        written = (nanoseconds(message.header.stamp), _number_at(message, path), message.header.frame_id)
    except Exception:  # the middleware raises any exception for bytes that it cannot parse
        written = None
    if written == (*_TEST_SAMPLE, frame_id):
        return form
    _warn(node, form.msgtype)
    return _MessageWriter(form, path, frame_id)


def _number_at(message: Any, path: FieldPath) -> float | None:
    """Return the number of a message at a path."""
    for step in path.steps:
        names, message = getattr(message, 'name', ()), getattr(message, step.name)
        if step.index is not None:
            return dict(zip(names, message)).get(step.index)
    return float(message)


def _write_sample(message: Any, path: FieldPath, sample: tuple[int, float]) -> None:
    """Write a sample into a message; an array at the path gets the number as its only entry."""
    stamp, number = sample
    message.header.stamp = stamp_message(stamp)
    *above, last = path.steps
    for step in above:
        message = getattr(message, step.name)
    setattr(message, last.name, number if last.index is None else [number])


def _empty_message(msgtype: str) -> Any:
    return message_class(msgtype)()


def _warn(node: Node, msgtype: str) -> None:
    node.get_logger().warning(
        f'{msgtype} is serialised in an unexpected layout. rclpy handles its messages, which takes longer'
    )
