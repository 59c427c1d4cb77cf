"""Samples are read from serialised messages as rclpy reads them, whatever came before them."""

from __future__ import annotations

import math

import pytest
from geometry_msgs.msg import WrenchStamped
from hypothesis import example, given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Header

from cfd_pneumatic.nodes.inputs import force_reader, joint_reader, pressure_reader
from cfd_pneumatic.nodes.messages import LATEST, nanoseconds, stamp_message

STAMPS = st.integers(0, 2**31 * 10**9 - 1)


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
def test_a_joint_is_read_in_whatever_order_messages_come(messages: list[JointState]) -> None:
    reader = joint_reader('piston')
    for message in messages:
        assert reader.read(serialize_message(message)) == told_by_rclpy(message)
        assert reader.names == list(message.name)


@given(st.lists(st.tuples(headers(), st.floats()), min_size=1, max_size=5))
def test_pressures_and_forces_are_read(samples: list[tuple[Header, float]]) -> None:
    pressure, force = pressure_reader(), force_reader('y')
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
def test_a_stamp_is_read_where_it_is_a_time(sec: int, rest: int, number: float) -> None:
    message = FluidPressure(fluid_pressure=number)
    message.header.stamp.sec, message.header.stamp.nanosec = sec, rest
    is_time = sec >= 0 and rest < 10**9
    stamp, _ = pressure_reader().read(serialize_message(message))
    assert stamp == (nanoseconds(message.header.stamp) if is_time else None)
    assert stamp is None or 0 <= stamp <= LATEST


def test_what_is_no_message_of_the_type_is_no_sample() -> None:
    reader = joint_reader('piston')
    message = bytes(serialize_message(JointState(name=['piston'], position=[math.pi])))
    assert reader.read(message) == (0, math.pi)
    for nonsense in (b'', message[:20], b'\x00\x07' + message[2:]):
        assert reader.read(nonsense) is None
        assert reader.names == []
    assert reader.read(message) == (0, math.pi)
