"""The messages of a file come in blocks, whatever the file is, as rosbags gives them one by one."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer
from recording_cases import EPOCH, SECOND, Message, piston, plain_messages, pressure, write_bag
from rosbags.rosbag2 import Reader

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.recording.blocks import OneByOne
from cfd_pneumatic.recording.chunks import ChunkedMcap, chunk_indexes
from cfd_pneumatic.recording.messages import FLOAT64
from cfd_pneumatic.recording.rows import SqliteRows

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
        chunked = ChunkedMcap(path, reader.connections, reader.start_time, chunk_indexes(path))
        return by_topic(chunked.blocks(wanted)), by_topic(OneByOne(reader, reader.start_time).blocks(wanted))


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


@settings(max_examples=settings.default.max_examples // 3)
@given(messages=any_messages, topics=st.sets(st.sampled_from(TOPICS), min_size=1))
def test_rows_give_what_rosbags_gives(tmp_path_factory, messages, topics):
    contents = [Message(TOPICS[channel], FLOAT64, time, payload) for channel, time, payload in messages]
    path = write_bag(tmp_path_factory.mktemp('sqlite3') / 'any', contents, storage='sqlite3', in_order=False)
    with Reader(path / 'any.db3') as reader:
        wanted = [connection for connection in reader.connections if connection.topic in topics]
        rows = SqliteRows(reader.storage.dbconn, reader.connections, reader.start_time)
        one_by_one = OneByOne(reader, reader.start_time)
        if wanted:
            assert by_topic(rows.blocks(wanted)) == by_topic(one_by_one.blocks(wanted))


def test_chunks_in_the_reverse_order_of_time_are_turned_round(tmp_path):
    messages = [(0, time, b'%d' % time) for time in range(100, 0, -1)]
    path = write_mcap(tmp_path / 'back.mcap', messages, chunk_size=200)
    assert len(chunk_indexes(path)) > 10
    chunked, one_by_one = chunked_and_one_by_one(path, {'/a'})
    assert chunked == one_by_one == {'/a': [(time, b'%d' % time) for time in range(1, 101)]}


@pytest.mark.parametrize(
    'options', [{'use_chunking': False}, {'index_types': IndexType.NONE}, {'index_types': IndexType.CHUNK}]
)
def test_without_an_index_there_are_no_chunks_to_go_by(tmp_path, options):
    assert chunk_indexes(write_mcap(tmp_path / 'plain.mcap', [(0, 1, b'x')], **options)) == []


def test_an_index_that_leads_astray_is_damage(tmp_path):
    bag = write_bag(tmp_path / 'bag', plain_messages())
    (index,) = chunk_indexes(bag / 'bag.mcap')
    content = bytearray((bag / 'bag.mcap').read_bytes())
    entry = next(iter(index.message_index_offsets.values())) + 15
    content[entry + 8 : entry + 16] = (40).to_bytes(8, 'little')
    (bag / 'bag.mcap').write_bytes(content)
    with pytest.raises(
        InputError, match='is damaged: the index of a chunk does not lead to its messages; mcap recover'
    ):
        read_recording(bag)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_messages_come_in_the_order_of_reception(tmp_path, storage):
    """Two that have one stamp: the one received first is kept, wherever it stands in the file."""
    contents = [piston(2.0, EPOCH, received=EPOCH + SECOND), piston(1.0, EPOCH), piston(3.0, EPOCH + SECOND // 2)]
    write_bag(tmp_path / 'bag', [*contents, pressure(2e5, EPOCH)], storage=storage, in_order=False)
    assert read_recording(tmp_path / 'bag').displacement.values.tolist() == [1.0, 3.0]
