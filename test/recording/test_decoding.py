# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_cases import press_messages, press_types
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages.blocks import MessageBlock
from cfd_pneumatic.messages.decoding import CounterPath, Decoder, TimePaths, in_nanoseconds
from cfd_pneumatic.messages.fields import NUMBERS, parse_path
from cfd_pneumatic.messages.layout import Layout, Serialization

TYPES = get_typestore(Stores.LATEST)
TYPES.register(
    get_types_from_msg('string note\nbyte flag\nfloat64[] loads\nEntry[<=2] entries\nint8 last\n', 'test/msg/Nested')
)
TYPES.register(get_types_from_msg('int16 code\nstring[2] tags\nuint8[3] bits\nfloat64 level\n', 'test/msg/Entry'))
PRESS_TYPES = press_types()
MSGTYPES = [
    'test/msg/Nested',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/FluidPressure',
    'sensor_msgs/msg/Imu',
    'geometry_msgs/msg/WrenchStamped',
    'diagnostic_msgs/msg/DiagnosticArray',
    'std_msgs/msg/Float32MultiArray',
    'trajectory_msgs/msg/JointTrajectory',
]


def block_of(payloads):
    return MessageBlock.from_payloads(range(len(payloads)), payloads)


def any_number(random, kind):
    dtype = np.dtype(NUMBERS[kind])
    if dtype.kind == 'f':
        return float(dtype.type(random.gauss(0, 1)))
    if kind in ('bool', 'byte'):
        return random.choice([0, 1])  # ROS 2 counts a byte from 0 to 255, rosbags from -128 to 127
    limits = np.iinfo(dtype)
    return random.randint(limits.min, limits.max)


def any_field(random, desc):
    kind, detail = desc
    if kind == Nodetype.NAME:
        return any_message(random, detail)
    if kind == Nodetype.BASE:
        return 'abcdé'[: random.randint(0, 5)] if detail[0] == 'string' else any_number(random, detail[0])
    element, length = detail
    count = length if kind == Nodetype.ARRAY else random.randint(0, length or 3)
    items = [any_field(random, element) for _ in range(count)]
    is_number = element[0] == Nodetype.BASE and element[1][0] != 'string'
    return np.array(items, bool if element[1][0] == 'bool' else NUMBERS[element[1][0]]) if is_number else items


def any_message(random, msgtype):
    fields = {name: any_field(random, desc) for name, desc in TYPES.fielddefs[msgtype][1]}
    return TYPES.types[msgtype](**fields)


def numbers_in(value, path=''):
    """Yield path and value of every number in a message of rosbags."""
    if isinstance(value, (list, np.ndarray)):
        for index, item in enumerate(value):
            yield from numbers_in(item, f'{path}[{index}]')
    elif hasattr(value, '__msgtype__'):
        for name, _ in TYPES.fielddefs[value.__msgtype__][1]:
            yield from numbers_in(getattr(value, name), f'{path}.{name}' if path else name)
    elif not isinstance(value, str):
        yield path, value


@pytest.mark.parametrize('msgtype', MSGTYPES)
@pytest.mark.parametrize('way', ['little endian', 'big endian', 'ROS 1'])
@given(random=st.randoms(use_true_random=True))
def test_every_number_is_where_rosbags_puts_it(msgtype, way, random):
    message = any_message(random, msgtype)
    if way == 'ROS 1':
        payload, serialization = TYPES.serialize_ros1(message, msgtype), Serialization.ROS1
    else:
        payload = TYPES.serialize_cdr(message, msgtype, little_endian=way == 'little endian')
        serialization = Serialization.CDR
    layout = Layout(bytes(payload), TYPES, msgtype, serialization)
    for path, value in numbers_in(message):
        place = layout.place(parse_path(path))
        assert np.frombuffer(payload, place.dtype, 1, place.offset)[0] == value, path


def test_messages_of_many_layouts_are_decoded_together():
    """The string before the numbers has seven lengths, so that they are at several places."""
    types, sent = PRESS_TYPES, press_messages(500)
    payloads = [bytes(types.serialize_cdr(message.content, message.msgtype)) for message in sent]
    stamp = CounterPath(parse_path('t_us'), 1e-6)
    decoder = Decoder(types, 'acme_msgs/msg/Press', parse_path('channels[1].reading'), stamp, Serialization.CDR)
    columns = decoder.decode(block_of(payloads))
    assert columns.has_number.all()
    np.testing.assert_array_equal(columns.values, 100.0 * np.arange(500))
    np.testing.assert_array_equal(columns.stamps, [message.content.t_us * 1000 for message in sent])


def test_lengths_that_differ_at_equal_size_are_told_apart():
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg('string a\nfloat64 x\nstring b\n', 'test/msg/Two'))
    two = types.types['test/msg/Two']
    sent = [two(a='a' * length, x=float(length), b='b' * (16 - length)) for length in range(17)]
    payloads = [bytes(types.serialize_cdr(message, 'test/msg/Two')) for message in sent]
    assert len({len(payload) for payload in payloads}) < len(payloads)
    columns = Decoder(types, 'test/msg/Two', parse_path('x'), None, Serialization.CDR).decode(block_of(payloads))
    np.testing.assert_array_equal(columns.values, np.arange(17.0))


def test_stamps_keep_their_nanoseconds():
    header = TYPES.types['std_msgs/msg/Header']
    time, air = TYPES.types['builtin_interfaces/msg/Time'], TYPES.types['sensor_msgs/msg/FluidPressure']
    message = air(header(time(1_700_000_000, 123_456_789), ''), 1.0, 0.0)
    payload = bytes(TYPES.serialize_cdr(message, 'sensor_msgs/msg/FluidPressure'))
    stamp = TimePaths(parse_path('header.stamp.sec'), parse_path('header.stamp.nanosec'))
    decoder = Decoder(TYPES, 'sensor_msgs/msg/FluidPressure', parse_path('fluid_pressure'), stamp, Serialization.CDR)
    assert decoder.decode(block_of([payload])).stamps.tolist() == [1_700_000_000_123_456_789]


@pytest.mark.parametrize('spare', [0, 4, 8, 12])
def test_room_that_rmw_serialize_leaves_behind_empty_sequences_is_no_damage(spare):
    """With rclpy's `serialize_message` programs write bags; it counts the alignment of numbers that are not there."""
    header = TYPES.types['std_msgs/msg/Header'](TYPES.types['builtin_interfaces/msg/Time'](3, 4), '')
    none = np.empty(0)
    message = TYPES.types['sensor_msgs/msg/JointState'](header, ['piston'], np.array([0.5]), none, none)
    payload = bytes(TYPES.serialize_cdr(message, 'sensor_msgs/msg/JointState')) + bytes(spare)
    path = parse_path('position[piston]')
    decoder = Decoder(TYPES, 'sensor_msgs/msg/JointState', path, None, Serialization.CDR)
    assert decoder.decode(block_of([payload])).values.tolist() == [0.5]


def test_an_entry_beyond_the_end_is_not_found():
    message = TYPES.types['std_msgs/msg/Float32MultiArray'](
        TYPES.types['std_msgs/msg/MultiArrayLayout']([], 0), np.ones(2, np.float32)
    )
    payload = bytes(TYPES.serialize_cdr(message, 'std_msgs/msg/Float32MultiArray'))
    decoder = Decoder(TYPES, 'std_msgs/msg/Float32MultiArray', parse_path('data[2]'), None, Serialization.CDR)
    assert not decoder.decode(block_of([payload])).has_number.any()


@pytest.mark.parametrize(
    ('payload', 'reason'),
    [
        (b'\0\1\0\0' + b'\0' * 20, 'a message has 24 bytes, but its definition requires 12'),
        (b'\0\1\0\0', 'a message has 4 bytes, but its definition requires 12'),
        (b'\x28\xb5\x2f\xfd', 'a message begins with 28b5, which is not plain CDR'),
        (b'', 'a message begins with , which is not plain CDR'),
    ],
)
def test_a_payload_of_another_type_is_refused(payload, reason):
    decoder = Decoder(TYPES, 'std_msgs/msg/Float64', parse_path('data'), None, Serialization.CDR)
    with pytest.raises(InputError) as caught:
        decoder.decode(block_of([payload]))
    assert str(caught.value).startswith(f'{reason}: the bag is damaged, or std_msgs/msg/Float64 is not defined as')


@given(st.binary(max_size=60), st.sampled_from(list(Serialization)))
def test_no_bytes_make_the_decoder_stumble(payload, serialization):
    decoder = Decoder(PRESS_TYPES, 'acme_msgs/msg/Press', parse_path('analog[3]'), None, serialization)
    with suppress(InputError):
        decoder.decode(block_of([payload]))


def test_integers_keep_their_nanoseconds_and_nan_is_no_time():
    assert in_nanoseconds(np.array([1_700_000_000_123_456], np.uint64), 1e-6).tolist() == [1_700_000_000_123_456_000]
    assert in_nanoseconds(np.array([1.5, np.nan]), 1.0).tolist() == [1_500_000_000, 0]
