# SPDX-License-Identifier: Apache-2.0
"""Recordings and bags for the tests."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import made
import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cfd_pneumatic import convention
from cfd_pneumatic.messages import types as messages
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get('CFD_PNEUMATIC_DATA', ROOT.parent / 'shared' / 'data')) / 'pneumatic_actuator'
EPOCH = 1_700_000_000_123_456_789
SECOND = 1_000_000_000


def recording(samples=50, *, cylinders=('cylinder_a',), setpoints=True, force=False, epoch=EPOCH):
    """Return a recording in which each signal has times of its own."""
    times = np.arange(samples) / 100
    steps = Signal(np.array([0.0, 0.2]), np.array([201_325.0, 301_325.0]))
    return Recording(
        name='made up',
        epoch=epoch,
        displacement=Signal(times, 1e-3 * np.sin(times)),
        cylinders={
            cylinder: CylinderSignals(
                Signal((np.arange(samples) * 10 + 1) / 1000, 2e5 + 1e3 * np.cos(times)), steps if setpoints else None
            )
            for cylinder in cylinders
        },
        force=Signal((np.arange(samples) * 10 + 2) / 1000, 100.0 + times) if force else None,
        health=(),
    )


def signals(recorded):
    """Return the signals of a recording by name."""
    found = {'displacement': recorded.displacement, 'force': recorded.force}
    for cylinder, parts in recorded.cylinders.items():
        found.update({f'{cylinder} pressure': parts.pressure, f'{cylinder} setpoint': parts.setpoint})
    return {name: signal for name, signal in found.items() if signal is not None}


def by_time(recorded):
    """Return the values of each signal by time [ns]."""
    return {
        name: dict(zip((recorded.epoch + np.rint(signal.times * SECOND).astype(int)).tolist(), signal.values.tolist()))
        for name, signal in signals(recorded).items()
    }


def assert_same(one, other, *, setpoint_error=0.0):
    """Set-points pass through gauge pressures, which costs the last bit; all else is equal bit by bit."""
    assert one.epoch == other.epoch
    assert signals(one).keys() == signals(other).keys()
    for name, signal in signals(one).items():
        np.testing.assert_array_equal(signal.times, signals(other)[name].times, name)
        error = setpoint_error if name.endswith('setpoint') else 0.0
        np.testing.assert_allclose(signal.values, signals(other)[name].values, rtol=0, atol=error, err_msg=name)


@dataclass
class Message:
    """A message for `write_bag`: its topic, type, time of reception [ns] and the message or its payload."""

    topic: str
    msgtype: str
    time: int
    content: object


def piston(position, stamp, *, received=None, joint='piston', topic='/cfd/device/piston_state'):
    """Return a JointState message; times [ns]."""
    time = stamp if received is None else received
    return Message(topic, convention.JOINT_STATE, time, made.joint_state(stamp, joint, position))


def pressure(value, stamp, *, received=None, topic='/cfd/device/cylinder_a/pressure'):
    """Return a FluidPressure message; times [ns]."""
    time = stamp if received is None else received
    return Message(topic, convention.FLUID_PRESSURE, time, made.fluid_pressure(stamp, value))


def setpoint(gauge, received, *, topic='/cfd/device/cylinder_a/setpoint'):
    """Return a Float64 message; time [ns]."""
    return Message(topic, convention.FLOAT64, received, made.float64(gauge))


def plain_messages(samples=20, start=EPOCH):
    """Return messages of a displacement and a pressure, at 10 ms."""
    times = [start + index * SECOND // 100 for index in range(samples)]
    return [piston(1e-4 * index, time) for index, time in enumerate(times)] + [
        pressure(2e5 + index, time) for index, time in enumerate(times)
    ]


def write_bag(path, contents, *, storage='mcap', types=None, compression=CompressionMode.NONE, in_order=True):
    """Write messages, in the order of their times or as they are given, as a ROS 2 bag."""
    types = types or messages.standard_types()
    writer = Writer(path, version=8, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for message in contents:
            if message.topic not in topics:
                topics[message.topic] = writer.add_connection(message.topic, message.msgtype, typestore=types)
        for message in sorted(contents, key=lambda message: message.time) if in_order else contents:
            payload = message.content
            if not isinstance(payload, bytes):
                payload = types.serialize_cdr(payload, message.msgtype)
            writer.write(topics[message.topic], message.time, payload)
    return path


def write_mcap_bag(path, contents, **options):
    """Write messages, in the order of their times, as an mcap file with the mcap library, which stores checksums."""
    types = messages.standard_types()
    writer = McapWriter(str(path), **options)
    writer.start('ros2')
    channels = {}
    for message in sorted(contents, key=lambda message: message.time):
        if message.topic not in channels:
            definition, _ = types.generate_msgdef(message.msgtype, ros_version=2)
            schema = writer.register_schema(message.msgtype, 'ros2msg', definition.encode())
            channels[message.topic] = writer.register_channel(message.topic, 'cdr', schema)
        payload = bytes(types.serialize_cdr(message.content, message.msgtype))
        writer.add_message(channels[message.topic], message.time, payload, message.time)
    writer.finish()
    return path


def write_ros1_bag(path, samples=20, namespace='/cfd/device'):
    """Write a ROS 1 bag of a displacement and a pressure."""
    types = get_typestore(Stores.ROS1_NOETIC)
    time, header = types.types['builtin_interfaces/msg/Time'], types.types['std_msgs/msg/Header']
    joint_state, fluid_pressure = types.types[convention.JOINT_STATE], types.types[convention.FLUID_PRESSURE]
    with Ros1Writer(path) as writer:
        pistons = writer.add_connection(f'{namespace}/piston_state', convention.JOINT_STATE, typestore=types)
        pressures = writer.add_connection(
            f'{namespace}/cylinder_a/pressure', convention.FLUID_PRESSURE, typestore=types
        )
        for index in range(samples):
            stamp = EPOCH + index * SECOND // 100
            head = header(seq=index, stamp=time(*divmod(stamp, SECOND)), frame_id='ab')
            none, position = np.empty(0), np.array([0.5, 1e-4 * index])
            joints = joint_state(header=head, name=['x', 'piston'], position=position, velocity=none, effort=none)
            air = fluid_pressure(header=head, fluid_pressure=2e5 + index, variance=0.0)
            writer.write(pistons, stamp, types.serialize_ros1(joints, convention.JOINT_STATE))
            writer.write(pressures, stamp, types.serialize_ros1(air, convention.FLUID_PRESSURE))
    return path


PRESS = """\
uint64 t_us
string state
acme_msgs/Channel[] channels
float32[4] analog
"""
CHANNEL = 'string label\nfloat64 reading\n'


def press_types():
    """Return ROS 2's types and those of a make of its own."""
    types = get_typestore(Stores.LATEST)
    types.register(get_types_from_msg(CHANNEL, 'acme_msgs/msg/Channel'))
    types.register(get_types_from_msg(PRESS, 'acme_msgs/msg/Press'))
    return types


def press_messages(samples=20):
    """Return messages of another make: micrometres in a list of channels, volts in an array, a string that grows."""
    types = press_types()
    channel, press = types.types['acme_msgs/msg/Channel'], types.types['acme_msgs/msg/Press']
    return [
        Message(
            '/press/state',
            'acme_msgs/msg/Press',
            EPOCH + index * SECOND // 100 + 5_000_000,
            press(
                t_us=EPOCH // 1000 + index * 10_000,
                state='x' * (index % 7),
                channels=[channel(label='oil', reading=1.0), channel(label='ram', reading=100.0 * index)],
                analog=np.array([0.0, 0.0, 1.0, 2.0 + 0.125 * index], np.float32),
            ),
        )
        for index in range(samples)
    ]


def write_press_types(folder):
    """Write the definitions of `press_messages` as files."""
    package = folder / 'acme_msgs' / 'msg'
    package.mkdir(parents=True)
    (package / 'Press.msg').write_text(PRESS)
    (package / 'Channel.msg').write_text(CHANNEL)
    return folder
