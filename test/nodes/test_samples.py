# SPDX-License-Identifier: Apache-2.0
"""
Samples are read from serialised messages as rclpy reads them, whatever came before them, and written as rclpy would.

Where rclpy serialises otherwise, which is simulated here by a layout that never fits, messages are made instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from geometry_msgs.msg import WrenchStamped
from hypothesis import example, given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Header

from cfd_pneumatic.messages.form import Form
from cfd_pneumatic.nodes import samples
from cfd_pneumatic.nodes.messages import LATEST, nanoseconds, stamp_message
from cfd_pneumatic.nodes.samples import (
    SampleReader,
    SampleWriter,
    force_reader,
    force_writer,
    joint_reader,
    pressure_reader,
    pressure_writer,
)

STAMPS = st.integers(0, 2**31 * 10**9 - 1)
WARNING = 'is serialised in an unexpected layout. rclpy handles its messages, which takes longer'


class Logger:
    """Takes what a node would warn of."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def get_logger(self) -> Logger:
        return self

    def warning(self, text: str) -> None:
        self.said.append(text)


class Tools(NamedTuple):
    joint: SampleReader
    pressure: SampleReader
    force: SampleReader
    pressures: SampleWriter
    forces: SampleWriter


@pytest.fixture(scope='module', params=['bytes', 'messages'])
def tools(request: pytest.FixtureRequest) -> Tools:
    """Return what reads and writes samples, by their bytes or by messages made of them."""
    node = Logger()
    with pytest.MonkeyPatch.context() as patch:
        if request.param == 'messages':
            patch.setattr(samples._LayoutReader, 'read', lambda *_: None)
            patch.setattr(Form, 'filled', lambda *_: b'nonsense')
        made = Tools(
            joint_reader(node, 'piston'),
            pressure_reader(node),
            force_reader(node, 'y'),
            pressure_writer(node, 'cfd'),
            force_writer(node, 'cfd', 'y'),
        )
    assert len(node.said) == (0 if request.param == 'bytes' else 5)
    assert all(text.endswith(WARNING) for text in node.said)
    return made


@st.composite
def headers(draw: st.DrawFn) -> Header:
    return Header(stamp=stamp_message(draw(STAMPS)), frame_id=draw(st.sampled_from(['', 'cfd', 'base_link'])))


@st.composite
def joint_states(draw: st.DrawFn) -> JointState:
    """Draw messages of few layouts, so that one is met again, and another one follows."""
    names = draw(st.sampled_from([['piston'], ['elbow', 'piston'], ['piston', 'elbow'], ['elbow'], ['eleventh'], []]))
    count = draw(st.sampled_from([len(names), len(names), 0, 1]))
    positions = draw(st.lists(st.floats(-1e3, 1e3), min_size=count, max_size=count))
    return JointState(
        header=draw(headers()), name=names, position=positions, velocity=draw(st.sampled_from([[], [1.0]]))
    )


def told_by_rclpy(message: JointState) -> tuple[int, float] | None:
    positions = dict(zip(message.name, message.position))
    return (nanoseconds(message.header.stamp), positions['piston']) if 'piston' in positions else None


@given(st.lists(joint_states(), min_size=1, max_size=12))
def test_a_joint_is_read_in_whatever_order_messages_come(tools: Tools, messages: list[JointState]) -> None:
    reader = tools.joint
    for message in messages:
        assert reader.read(serialize_message(message)) == told_by_rclpy(message)
        assert reader.names == list(message.name)


@given(st.lists(st.tuples(headers(), st.floats()), min_size=1, max_size=5))
def test_pressures_and_forces_are_read(tools: Tools, samples: list[tuple[Header, float]]) -> None:
    pressure, force = tools.pressure, tools.force
    for header, number in samples:
        told = pytest.approx((nanoseconds(header.stamp), number), abs=0.0, rel=0.0, nan_ok=True)
        assert (
            pressure.read(serialize_message(FluidPressure(header=header, fluid_pressure=number, variance=1.0))) == told
        )
        message = WrenchStamped(header=header)
        message.wrench.force.x, message.wrench.force.y = 1.0, number
        assert force.read(serialize_message(message)) == told


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1), st.floats())
@example(2**31 - 1, 10**9 - 1, 0.0)
@example(2**31 - 1, 2**32 - 1, 0.0)
@example(-1, 999_999_999, 0.0)
def test_a_stamp_is_read_where_it_is_a_time(tools: Tools, sec: int, rest: int, number: float) -> None:
    message = FluidPressure(fluid_pressure=number)
    message.header.stamp.sec, message.header.stamp.nanosec = sec, rest
    is_time = sec >= 0 and rest < 10**9
    stamp, _ = tools.pressure.read(serialize_message(message))
    assert stamp == (nanoseconds(message.header.stamp) if is_time else None)
    assert stamp is None or 0 <= stamp <= LATEST


@given(STAMPS, st.floats())
def test_pressures_and_forces_are_written(tools: Tools, stamp: int, number: float) -> None:
    for writer, kind in ((tools.pressures, FluidPressure), (tools.forces, WrenchStamped)):
        made = writer.filled(stamp, number)
        message = deserialize_message(made, kind) if isinstance(made, bytes) else made
        expected = kind(header=Header(stamp=stamp_message(stamp), frame_id='cfd'))
        if kind is FluidPressure:
            expected.fluid_pressure = number
        else:
            expected.wrench.force.y = number
        assert serialize_message(message) == serialize_message(expected)  # NaN is not NaN


def test_what_is_no_message_of_the_type_is_no_sample() -> None:
    reader = joint_reader(Logger(), 'piston')
    message = bytes(serialize_message(JointState(name=['piston'], position=[math.pi])))
    assert reader.read(message) == (0, math.pi)
    for nonsense in (b'', message[:20], b'\x00\x07' + message[2:]):
        assert reader.read(nonsense) is None
        assert reader.names == []
    assert reader.read(message) == (0, math.pi)
