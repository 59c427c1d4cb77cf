# SPDX-License-Identifier: Apache-2.0
"""The messages of a file come in blocks, whatever the file is, as rosbags gives them one by one."""

from __future__ import annotations

import made
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from recording_cases import (
    EPOCH,
    SECOND,
    Message,
    assert_same,
    piston,
    plain_messages,
    pressure,
    recording,
    write_bag,
    write_mcap_bag,
)
from rosbags.rosbag2 import Reader

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages.blocks import GroupingReader
from cfd_pneumatic.messages.types import JOINT_STATE
from cfd_pneumatic.recording import read_recording, write_recording
from cfd_pneumatic.recording.bags.mcap_reading import McapFile

TOPICS = ('/a', '/b', '/b', '/c')  # a topic may have several channels

any_messages = st.lists(
    st.tuples(st.integers(0, len(TOPICS) - 1), st.integers(0, 50), st.binary(max_size=40)), min_size=1, max_size=60
)


def write_mcap(path, messages, **options):
    """Write messages (channel, time, payload) in the order given, with records of other kinds between."""
    writer = Writer(str(path), **options)
    writer.start('ros2')
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channels = [writer.register_channel(topic, 'cdr', schema) for topic in TOPICS]
    for count, (channel, time, payload) in enumerate(messages):
        writer.add_message(channels[channel], time, payload, time)
        if count % 7 == 3:
            writer.add_attachment(time, time, 'photo', 'image/png', b'\5' * 100)
            writer.add_metadata('who', {'name': 'was it'})
    writer.finish()
    return path


def by_topic(blocks):
    """Return time and payload of the messages in blocks, by topic."""
    found = {}
    for connection, block in blocks:
        payloads = [block.payload(index) for index in range(len(block))]
        found.setdefault(connection.topic, []).extend(zip(block.times.tolist(), payloads))
    return {topic: messages for topic, messages in found.items() if messages}


def chunked_and_one_by_one(path, topics):
    with Reader(path) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in topics]
        return by_topic(McapFile(path).blocks(wanted)), by_topic(
            GroupingReader(reader, reader.start_time).blocks(wanted)
        )


@given(
    messages=any_messages,
    chunk_size=st.sampled_from([1, 100, 300, 10**6]),
    compression=st.sampled_from(CompressionType),
    crcs=st.booleans(),
    topics=st.sets(st.sampled_from(TOPICS), min_size=1),
)
def test_chunks_give_what_rosbags_gives(tmp_path_factory, messages, chunk_size, compression, crcs, topics):
    path = write_mcap(
        tmp_path_factory.mktemp('mcap') / 'any.mcap',
        messages,
        chunk_size=chunk_size,
        compression=compression,
        enable_crcs=crcs,
    )
    chunked, one_by_one = chunked_and_one_by_one(path, topics)
    assert chunked == one_by_one
    assert sum(map(len, chunked.values())) == sum(TOPICS[channel] in topics for channel, _, _ in messages)


def test_chunks_in_the_reverse_order_of_time_are_turned_round(tmp_path):
    messages = [(0, time, b'%d' % time) for time in range(100, 0, -1)]
    path = write_mcap(tmp_path / 'back.mcap', messages, chunk_size=200)
    chunked, one_by_one = chunked_and_one_by_one(path, {'/a'})
    assert chunked == one_by_one == {'/a': [(time, b'%d' % time) for time in range(1, 101)]}


@pytest.mark.parametrize(
    'options', [{'use_chunking': False}, {'index_types': IndexType.NONE}, {'index_types': IndexType.CHUNK}]
)
def test_a_file_without_an_index_is_gone_through(tmp_path, options):
    messages = [(time % 4, time, b'%d' % time) for time in range(1, 101)]
    path = write_mcap(tmp_path / 'plain.mcap', messages, chunk_size=200, use_statistics=True, **options)
    read = by_topic(McapFile(path).blocks(McapFile(path).connections))
    assert read == {topic: [(time, data) for one, time, data in messages if TOPICS[one] == topic] for topic in TOPICS}


def test_messages_outside_of_chunks_are_read(tmp_path):
    with (tmp_path / 'some.mcap').open('wb') as stream:
        writer = Writer(stream, chunk_size=1)  # each message in a chunk
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/a', 'cdr', schema)
        for time in range(1, 11):
            if time % 3:
                writer.add_message(channel, time, b'%d' % time, time)
            else:
                record = RecordBuilder()
                records.Message(channel, time, b'%d' % time, time, 0).write(record)
                stream.write(record.end())
        writer.finish()
    file = McapFile(tmp_path / 'some.mcap')
    assert by_topic(file.blocks(file.connections)) == {'/a': [(time, b'%d' % time) for time in range(1, 11)]}


@pytest.mark.parametrize('checksums', [True, False])
def test_an_index_that_leads_astray(tmp_path, checksums):
    """Where a checksum says that the chunk is right, the index does no harm."""
    bag = tmp_path / 'bag'
    if checksums:
        write_recording(bag, recording(20, setpoints=False))
    else:
        write_bag(bag, plain_messages())
    with (bag / 'bag.mcap').open('rb') as stream:
        (index,) = make_reader(stream).get_summary().chunk_indexes
    content = bytearray((bag / 'bag.mcap').read_bytes())
    entry = next(iter(index.message_index_offsets.values())) + 15
    content[entry + 8 : entry + 16] = (40).to_bytes(8, 'little')
    (bag / 'bag.mcap').write_bytes(content)
    if checksums:
        assert_same(read_recording(bag), recording(20, setpoints=False))
    else:
        with pytest.raises(InputError, match=r'bag: is damaged and nothing can be salvaged; mcap recover may mend it$'):
            read_recording(bag)


def test_a_block_that_is_shorter_than_what_is_looked_for_in_it(tmp_path):
    """Messages of another layout than those before, in a chunk that is smaller than the names in these."""
    contents = []
    for index, names in enumerate((['x' * 500, 'piston'], ['piston'], ['piston'])):
        time = EPOCH + index * SECOND
        joints = made.joint_state(time, 'piston', 0.0)
        joints.name, joints.position = names, np.arange(10.0 * index, 10.0 * index + len(names))
        contents += [Message('/d/piston_state', JOINT_STATE, time, joints)]
        contents += [pressure(2e5, time, topic='/d/cylinder_a/pressure')]
    write_mcap_bag(tmp_path / 'some.mcap', contents, chunk_size=1)  # each message in a chunk
    assert read_recording(tmp_path / 'some.mcap').displacement.values.tolist() == [1.0, 10.0, 20.0]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_messages_come_in_the_order_of_reception(tmp_path, storage):
    """Two that have one stamp: the one received first is kept, wherever it stands in the file."""
    contents = [piston(2.0, EPOCH, received=EPOCH + SECOND), piston(1.0, EPOCH), piston(3.0, EPOCH + SECOND // 2)]
    write_bag(tmp_path / 'bag', [*contents, pressure(2e5, EPOCH)], storage=storage, in_order=False)
    assert read_recording(tmp_path / 'bag').displacement.values.tolist() == [1.0, 3.0]
