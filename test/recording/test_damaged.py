# SPDX-License-Identifier: Apache-2.0
"""Bags that are missing, empty, cut off or something else: one line that says what is wrong and what to do."""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
from dataclasses import replace

import pytest
from mcap.writer import CompressionType, Writer
from recording_cases import (
    EPOCH,
    SECOND,
    by_time,
    piston,
    plain_messages,
    pressure,
    recording,
    write_bag,
    write_mcap_bag,
    write_ros1_bag,
)
from rosbags.rosbag2 import CompressionMode

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_recording, write_recording
from cfd_pneumatic.recording.bags.mcap_pieces import CHUNK, HEAD

SUFFIX = {'mcap': '.mcap', 'sqlite3': '.db3'}


def error_of(path):
    with pytest.raises(InputError) as caught:
        read_recording(path)
    message = str(caught.value)
    assert '\n' not in message
    assert message.startswith(f'{path}: ')
    return message[len(f'{path}: ') :]


@pytest.fixture(scope='module')
def long_bags(tmp_path_factory):
    """Return a folder with a bag of several chunks in each storage."""
    folder = tmp_path_factory.mktemp('long')
    for storage in SUFFIX:
        write_recording(folder / storage, recording(12_000, setpoints=False), storage=storage)
    return folder


def cut(source, target, part):
    content = source.read_bytes()
    target.write_bytes(content[: int(part * len(content))])
    return target


@pytest.mark.parametrize('storage', SUFFIX)
@pytest.mark.parametrize('part', [0.7, 0.999])
def test_what_a_cut_off_file_still_holds_is_salvaged(long_bags, tmp_path, storage, part):
    whole = read_recording(long_bags / storage)
    file = cut(long_bags / storage / f'{storage}{SUFFIX[storage]}', tmp_path / f'cut{SUFFIX[storage]}', part)
    read = read_recording(file)
    count = len(read.displacement)
    salvaged = count + len(read.cylinders['cylinder_a'].pressure)
    assert 0.3 * part * 24_000 < salvaged <= 24_000
    assert read.health[0] == f'{file.name} is cut off: salvaged {salvaged:,} messages'
    if storage == 'mcap':
        (note,) = read.health[1:]
        assert re.fullmatch(r'cut.mcap is damaged: left out messages received later than \S+ s after its start', note)
    else:
        assert all('pressure: samples from' in note for note in read.health[1:])  # what was written later is lost
    assert (read.displacement.values == whole.displacement.values[:count]).all()
    assert (read.displacement.times == whole.displacement.times[:count]).all()


def test_what_a_cut_table_s_bag_lacks_is_told_from_the_beginning_of_its_time(tmp_path):
    write_recording(tmp_path / 'bag', replace(recording(12_000, setpoints=False), epoch=0))
    read = read_recording(cut(tmp_path / 'bag' / 'bag.mcap', tmp_path / 'cut.mcap', 0.9))
    (note,) = read.health[1:]
    last = read.cylinders['cylinder_a'].pressure.times[-1]
    assert float(note.partition('later than ')[2].split()[0]) == pytest.approx(last, abs=0.01)


@pytest.mark.parametrize('metadata', [True, False])
@pytest.mark.parametrize('storage', SUFFIX)
def test_a_folder_with_a_cut_off_file_is_salvaged(long_bags, tmp_path, storage, metadata):
    shutil.copytree(long_bags / storage, tmp_path / 'bag')
    cut(long_bags / storage / f'{storage}{SUFFIX[storage]}', tmp_path / 'bag' / f'{storage}{SUFFIX[storage]}', 0.8)
    if not metadata:
        (tmp_path / 'bag' / 'metadata.yaml').unlink()
    read = read_recording(tmp_path / 'bag')
    assert len(read.displacement) > 3000
    assert 'is cut off: salvaged' in read.health[0]


@pytest.mark.parametrize(
    ('storage', 'message'),
    [
        ('mcap', 'is cut off and nothing can be salvaged; mcap recover may mend it'),
        ('sqlite3', 'is cut off and nothing can be salvaged; sqlite3 .recover may mend it'),
    ],
)
def test_nothing_to_salvage(long_bags, tmp_path, storage, message):
    file = cut(long_bags / storage / f'{storage}{SUFFIX[storage]}', tmp_path / f'cut{SUFFIX[storage]}', 0.01)
    assert error_of(file) == message


def test_a_database_with_a_damaged_page(long_bags, tmp_path):
    content = bytearray((long_bags / 'sqlite3' / 'sqlite3.db3').read_bytes())
    middle = len(content) // 2
    content[middle : middle + 5000] = bytes(5000)
    (tmp_path / 'rot.db3').write_bytes(content)
    read = read_recording(tmp_path / 'rot.db3')
    assert read.health[0].startswith('rot.db3 is damaged (sqlite3 cannot read it): salvaged ')
    assert len(read.displacement) > 1000


def test_a_summary_that_begins_behind_the_end_of_the_file_is_salvaged(long_bags, tmp_path):
    content = bytearray((long_bags / 'mcap' / 'mcap.mcap').read_bytes())
    struct.pack_into('<Q', content, len(content) - 28, 2**64 - 1)
    (tmp_path / 'bag.mcap').write_bytes(content)
    found = read_recording(tmp_path / 'bag.mcap')
    assert len(found.displacement) == 12_000
    assert 'its summary begins behind its end' in found.health[0]


def test_a_database_whose_schema_is_no_text_is_refused(long_bags, tmp_path):
    content = (long_bags / 'sqlite3' / 'sqlite3.db3').read_bytes()
    (tmp_path / 'bag.db3').write_bytes(content.replace(b'CREATE TABLE messages', b'CREATE \xff\xfeBLE messages'))
    assert 'is damaged' in error_of(tmp_path / 'bag.db3')


def test_a_file_whose_only_chunk_is_damaged(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages(), compression=CompressionMode.STORAGE)
    file = tmp_path / 'bag' / 'bag.mcap'
    content = bytearray(file.read_bytes())
    frame = content.index(b'\x28\xb5\x2f\xfd')  # where the compressed messages begin
    content[frame : frame + 4] = bytes(4)
    file.write_bytes(content)
    assert error_of(file) == 'is damaged and nothing can be salvaged; mcap recover may mend it'


@pytest.mark.parametrize('part', [1.0, 0.99999])
def test_a_chunk_with_a_flipped_bit_is_left_out(long_bags, tmp_path, part):
    """Whether the file still has its end or not; all other numbers are as they were written."""
    whole = read_recording(long_bags / 'mcap')
    file = cut(long_bags / 'mcap' / 'mcap.mcap', tmp_path / 'flip.mcap', part)
    content = bytearray(file.read_bytes())
    value = struct.pack('<d', whole.cylinders['cylinder_a'].pressure.values[7000])
    content[content.index(value) + 6] ^= 16
    file.write_bytes(content)
    read = read_recording(file)
    note = next(note for note in read.health if 'is damaged' in note)
    count, begin, end = re.fullmatch(
        r'flip.mcap is damaged: left out (.+ messages, )?messages received between (\S+) s and (\S+) s.* its start',
        note,
    ).groups()
    assert (count is not None) == (part == 1.0)
    assert float(begin) < 70.0 < float(end)
    found, truth = by_time(read), by_time(whole)
    for signal, values in found.items():
        assert len(values) > 4000
        assert values.items() <= truth[signal].items()
        assert whole.epoch + 70 * SECOND not in values


def test_messages_of_a_chunk_whose_head_is_gone_are_not_trusted(tmp_path):
    """Nothing else covers them: the summary is damaged, too."""
    bag = write_mcap_bag(tmp_path / 'bag.mcap', plain_messages(200), compression=CompressionType.NONE, chunk_size=4000)
    truth = by_time(read_recording(bag))
    content = bytearray(bag.read_bytes())
    number = content.index(struct.pack('<d', 2e5 + 100))
    place, chunk = 8, 0
    while place < number:
        chunk, place = place, place + HEAD.size + HEAD.unpack_from(content, place)[1]
    HEAD.pack_into(content, chunk, 0x41, CHUNK.size + 8)  # of no known kind; its messages stand behind it
    content[number] ^= 1
    content[-9] ^= 1  # the summary's checksum
    bag.write_bytes(content)
    read = read_recording(bag)
    assert len(read.displacement) > 100
    for signal, values in by_time(read).items():
        assert values.items() <= truth[signal].items()


def test_two_definitions_of_one_type(tmp_path):
    """Numbers of one publisher would be looked for where the other has them."""
    path = tmp_path / 'two.mcap'
    writer = Writer(str(path))
    writer.start('ros2')
    for definition in (b'float64 fluid_pressure\nfloat64 variance', b'float64 variance\nfloat64 fluid_pressure'):
        schema = writer.register_schema('sensor_msgs/msg/FluidPressure', 'ros2msg', definition)
        channel = writer.register_channel('/d/cylinder_a/pressure', 'cdr', schema)
        writer.add_message(channel, EPOCH, b'\0\1\0\0' + struct.pack('<dd', 1e5, 7.0), EPOCH)
    schema = writer.register_schema('sensor_msgs/msg/JointState', 'ros2msg', b'string[] name\nfloat64[] position')
    channel = writer.register_channel('/d/piston_state', 'cdr', schema)
    writer.finish()
    assert error_of(path) == (
        'topic /d/cylinder_a/pressure has messages of two definitions of sensor_msgs/msg/FluidPressure: '
        'split the bag, or remove the messages of one publisher'
    )


def test_messages_that_a_ros1_index_leaves_out_are_told(tmp_path):
    bag = write_ros1_bag(tmp_path / 'bag.bag')
    content = bytearray(bag.read_bytes())
    count = content.index(b'count=', content.rindex(b'op=\x04')) + 6
    assert (content[count], content[count + 4]) == (20, 20 * 12)
    content[count], content[count + 4] = 19, 19 * 12
    bag.write_bytes(content)
    read = read_recording(bag)
    assert read.health == ('bag.bag is damaged: left out 1 message',)
    assert len(read.displacement) + len(read.cylinders['cylinder_a'].pressure) == 39


def test_rows_of_no_topic_are_told(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages(), storage='sqlite3')
    with sqlite3.connect(tmp_path / 'bag' / 'bag.db3') as database:
        database.execute('UPDATE messages SET topic_id = 77 WHERE id IN (5, 7)')
    assert read_recording(tmp_path / 'bag').health[0] == 'bag.db3 is damaged: 2 messages of no topic left out'


def test_a_cut_off_ros1_bag(tmp_path):
    bag = cut(write_ros1_bag(tmp_path / 'whole.bag'), tmp_path / 'cut.bag', 0.5)
    assert error_of(bag).startswith('cannot be read: ')
    assert error_of(bag).endswith('; rosbag reindex may mend it')


def test_a_path_that_is_not_there(tmp_path):
    assert error_of(tmp_path / 'nowhere') == 'does not exist: give the path of a recording'


def test_a_folder_without_a_bag(tmp_path):
    assert error_of(tmp_path) == 'holds no bag, neither metadata.yaml nor .mcap or .db3 files'


def test_a_folder_of_bags(tmp_path):
    for name in ('one', 'two'):
        write_bag(tmp_path / name, plain_messages())
    assert error_of(tmp_path) == 'is a folder of bags: give one of one, two'


def test_several_bags_in_a_folder_are_not_one(tmp_path):
    for name in ('one', 'two'):
        write_bag(tmp_path / name, plain_messages())
        shutil.move(tmp_path / name / f'{name}.mcap', tmp_path)
    assert error_of(tmp_path) == 'holds several bags without metadata.yaml: give one of one.mcap, two.mcap'


def test_an_empty_bag(tmp_path):
    write_bag(tmp_path / 'bag', [])
    assert error_of(tmp_path / 'bag') == 'holds no messages: was anything published while it was recorded?'


@pytest.mark.parametrize('name', ['empty.mcap', 'empty.db3', 'empty.bag'])
def test_an_empty_file(tmp_path, name):
    (tmp_path / name).touch()
    assert error_of(tmp_path / name).startswith(('is damaged (', 'cannot be read: '))


@pytest.mark.parametrize('name', ['letter.mcap', 'letter.db3', 'letter.bag'])
def test_a_file_that_is_no_bag(tmp_path, name):
    (tmp_path / name).write_text('Dear engineer,\n' * 50)
    assert error_of(tmp_path / name).startswith(('is damaged (', 'is not a bag of ROS 1; '))


def test_broken_metadata_is_done_without(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages())
    (tmp_path / 'bag' / 'metadata.yaml').write_text('rosbag2_bagfile_information: {version: 5}\n')
    read = read_recording(tmp_path / 'bag')
    assert len(read.displacement) == 20
    assert read.health == (
        'metadata.yaml was not used: it lacks rosbag2_bagfile_information with relative_file_paths and '
        'storage_identifier',
    )


BOMB = 'm0: &m0 [1]\n' + ''.join(f'm{at + 1}: &m{at + 1} [{", ".join([f"*m{at}"] * 10)}]\n' for at in range(6))


@pytest.mark.parametrize(
    ('more', 'said'),
    [
        (BOMB, 'metadata.yaml was not used: unfolds to more than 50,000 values: '),
        (f'x: {"y" * 2**20}\n', 'metadata.yaml was not used: has more than 1 MiB'),
        ('m0: &m0 {k: 1}\nm1: {<<: *m0, a: 1}\nm2: &m0 [2]\n', ''),
    ],
    ids=['a bomb', 'too long', 'a merge'],
)
def test_metadata_may_have_aliases_and_are_done_without_where_they_unfold_too_far(tmp_path, more, said):
    write_recording(tmp_path / 'bag', recording())
    with (tmp_path / 'bag' / 'metadata.yaml').open('a') as file:
        file.write(more)
    read = read_recording(tmp_path / 'bag')
    assert ''.join(read.health).startswith(said)
    assert bool(read.health) == bool(said)
    assert len(read.displacement) == len(recording().displacement)


def test_a_compressed_bag_without_metadata(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages(), compression=CompressionMode.FILE)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert error_of(tmp_path / 'bag') == 'is compressed and has no metadata.yaml: unpack its files with zstd -d'


def test_what_was_not_merged_into_a_database_is_told(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages(), storage='sqlite3')
    (tmp_path / 'bag' / 'bag.db3-wal').write_bytes(b'rows')
    note = 'bag.db3-wal is not read: open bag.db3 once with sqlite3 to merge it'
    assert read_recording(tmp_path / 'bag').health == (note,)
    assert read_recording(tmp_path / 'bag' / 'bag.db3').health == (note,)


def test_a_topic_without_messages(tmp_path):
    write_bag(tmp_path / 'bag', [piston(0.0, EPOCH), pressure(2e5, EPOCH)], storage='sqlite3')
    with sqlite3.connect(tmp_path / 'bag' / 'bag.db3') as database:
        database.execute("DELETE FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name LIKE '%pressure')")
    assert error_of(tmp_path / 'bag') == (
        'topic /cfd/device/cylinder_a/pressure, the cylinder_a pressure, has no messages'
    )
