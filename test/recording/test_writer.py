# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
import shutil
import sqlite3
import zlib

import made
import pytest
from mcap import records
from mcap.stream_reader import StreamReader
from recording_cases import EPOCH, assert_same, recording

from cfd_pneumatic import convention
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import types as messages
from cfd_pneumatic.recording import BagWriter, read_recording, write_recording
from cfd_pneumatic.recording.bags.mcap_writing import McapWriter
from cfd_pneumatic.recording.bags.sqlite_files import SqliteWriter


def fill(bag):
    bag.add_topic('/cfd/device/piston_state', convention.JOINT_STATE)
    bag.add_topic('/cfd/device/cylinder_a/pressure', convention.FLUID_PRESSURE)
    fill_more(bag, range(3))


def fill_more(bag, indices=range(3, 6)):
    for index in indices:
        time = EPOCH + index * 1000
        made.write_message(bag, '/cfd/device/piston_state', time, made.joint_state(time, 'piston', 0.5))
        made.write_message(bag, '/cfd/device/cylinder_a/pressure', time, made.fluid_pressure(time, 2e5))


def fail_to_write(path, **options):
    with BagWriter(path, **options) as bag:
        fill(bag)
        raise KeyError


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_bag_is_written_message_by_message(tmp_path, storage):
    with BagWriter(tmp_path / 'new' / 'bag', storage=storage) as bag:
        fill(bag)
        assert not (tmp_path / 'new' / 'bag').exists()
    assert len(read_recording(tmp_path / 'new' / 'bag').displacement) == 3
    assert os.listdir(tmp_path / 'new') == ['bag']


def test_an_mcap_has_checksums(tmp_path):
    write_recording(tmp_path / 'bag', recording(12_000))
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as stream:
        found = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in found if isinstance(record, records.Chunk)]
    assert len(chunks) > 1
    for chunk in chunks:
        assert chunk.uncompressed_crc == zlib.crc32(chunk.data)
    assert found[-1].summary_crc


def test_nothing_is_left_of_a_bag_that_failed(tmp_path):
    with pytest.raises(KeyError):
        fail_to_write(tmp_path / 'bag')
    assert os.listdir(tmp_path) == []


def test_an_earlier_bag_stays_unless_it_is_to_be_overwritten(tmp_path):
    first, second = recording(10), recording(20)
    write_recording(tmp_path / 'bag', first)
    with pytest.raises(InputError) as caught:
        write_recording(tmp_path / 'bag', second)
    assert str(caught.value) == (
        f'{tmp_path}/bag exists already: choose another name, or replace it with --overwrite '
        '(in Python: overwrite=True)'
    )
    assert_same(read_recording(tmp_path / 'bag'), first, setpoint_error=1e-9)
    write_recording(tmp_path / 'bag', second, overwrite=True)
    assert_same(read_recording(tmp_path / 'bag'), second, setpoint_error=1e-9)
    assert os.listdir(tmp_path) == ['bag']


def test_a_link_to_nowhere_in_a_bag_s_place_does_not_hide_the_bag(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        fill(bag)
        (tmp_path / 'bag').symlink_to('nowhere')
        (tmp_path / 'bag_2').symlink_to('nowhere')
    assert bag.path == tmp_path / 'bag_3'
    assert len(read_recording(bag.path).displacement) == 3


@pytest.mark.parametrize('mode', [0o755, 0o700])
def test_an_empty_folder_is_filled_and_keeps_its_mode(tmp_path, mode):
    """A folder of another mode than a new one is not exchanged, as a mount point can't be."""
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag').chmod(mode)
    for storage, samples in (('mcap', 10), ('sqlite3', 20), ('mcap', 30)):
        write_recording(tmp_path / 'bag', recording(samples), storage=storage, overwrite=samples > 10)
        assert len(read_recording(tmp_path / 'bag').displacement) == samples
        assert len(os.listdir(tmp_path / 'bag')) == 2
        assert (tmp_path / 'bag').stat().st_mode & 0o777 == mode
    assert os.listdir(tmp_path) == ['bag']


def test_what_somebody_puts_into_a_bag_meanwhile_stays(tmp_path):
    write_recording(tmp_path / 'bag', recording(10))
    with BagWriter(tmp_path / 'bag', overwrite=True) as bag:
        fill(bag)
        (tmp_path / 'bag' / 'notes').write_text('mine')
    assert len(read_recording(tmp_path / 'bag').displacement) == 3
    assert (tmp_path / 'bag' / 'notes').read_text() == 'mine'


def test_a_bag_in_a_folder_that_was_filled_meanwhile_is_in_a_folder_of_its_own(tmp_path):
    (tmp_path / 'bag').mkdir(mode=0o700)
    with BagWriter(tmp_path / 'bag') as bag:
        fill(bag)
        (tmp_path / 'bag' / 'notes').write_text('mine')
    assert bag.path == tmp_path / 'bag' / 'bag_2'
    assert len(read_recording(bag.path).displacement) == 3
    assert sorted(os.listdir(tmp_path / 'bag')) == ['bag_2', 'notes']


@pytest.mark.parametrize('mode', [0o755, 0o700])
def test_what_was_written_before_a_disk_was_full_is_left_in_an_empty_folder(tmp_path, mode):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag').chmod(mode)
    bag = BagWriter(tmp_path / 'bag')
    fill(bag)
    bag.flush()
    bag.keep_incomplete()
    assert os.listdir(tmp_path / 'bag') == ['bag.mcap']
    assert len(read_recording(tmp_path / 'bag' / 'bag.mcap').displacement) == 3


def fill_while(path, doing, **options):
    """Write a bag of 6 samples; something happens to its folder after half of them."""
    with BagWriter(path, **options) as bag:
        fill(bag)
        bag.flush()
        doing()
        fill_more(bag)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('is_replaced', [False, True])
def test_a_bag_is_completed_in_a_folder_that_was_moved_and_the_error_names_the_place(tmp_path, storage, is_replaced):
    before, after = tmp_path / 'before', tmp_path / 'after'

    def move():
        before.rename(after)
        if is_replaced:
            before.mkdir()

    with pytest.raises(InputError) as caught:
        fill_while(before / 'bag', move, storage=storage)
    assert str(caught.value) == (
        'the folder of the bag was moved while the bag was written. '
        f'The bag is complete, but not at {before}/bag: move or use {after}/bag'
    )
    assert len(read_recording(after / 'bag').displacement) == 6
    assert os.listdir(after) == ['bag']
    assert not before.exists() or os.listdir(before) == []


def test_a_bag_in_a_folder_that_was_moved_and_moved_back_is_where_it_was_named(tmp_path):
    before, after = tmp_path / 'before', tmp_path / 'after'
    with BagWriter(before / 'bag') as bag:
        fill(bag)
        before.rename(after)
        assert bag.relocate()
        assert not bag.relocate()
        after.rename(before)
    assert os.listdir(before) == ['bag']


def test_a_bag_in_an_empty_folder_that_was_moved_is_inside_of_it(tmp_path):
    """A folder of another mode than a new one is not exchanged, as a mount point can't be."""
    named, moved = tmp_path / 'bag', tmp_path / 'moved'
    named.mkdir(mode=0o700)
    with pytest.raises(InputError, match=f'move or use {moved}/bag$'):
        fill_while(named, lambda: named.rename(moved))
    assert len(read_recording(moved / 'bag').displacement) == 6
    assert os.listdir(moved) == ['bag']


def test_nothing_is_left_of_a_bag_that_failed_in_a_folder_that_was_moved(tmp_path):
    before, after = tmp_path / 'before', tmp_path / 'after'

    def move():
        before.rename(after)
        raise KeyError

    with pytest.raises(KeyError):
        fill_while(before / 'bag', move)
    assert os.listdir(after) == []


def test_a_folder_that_was_removed_is_reported(tmp_path):
    folder = tmp_path / 'before'
    with pytest.raises(InputError, match=f'cannot write {folder}/bag: {folder} was removed, moved to another'):
        fill_while(folder / 'bag', lambda: shutil.rmtree(folder))


def test_an_earlier_bag_stays_when_its_successor_fails(tmp_path):
    write_recording(tmp_path / 'bag', recording(10))
    with pytest.raises(KeyError):
        fail_to_write(tmp_path / 'bag', overwrite=True)
    assert len(read_recording(tmp_path / 'bag').displacement) == 10


def test_what_is_not_a_bag_is_not_overwritten(tmp_path):
    (tmp_path / 'notes').mkdir()
    (tmp_path / 'notes' / 'monday').touch()
    (tmp_path / 'file').touch()
    for name in ('notes', 'file'):
        with pytest.raises(InputError) as caught:
            write_recording(tmp_path / name, recording(), overwrite=True)
        assert str(caught.value) == f'{tmp_path / name} is not a bag and is not overwritten: choose another name'


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(InputError) as caught:
        write_recording(tmp_path / 'file' / 'bag', recording())
    assert str(caught.value) == f'cannot write {tmp_path}/file/bag: {tmp_path}/file is not a folder'


def test_only_one_at_a_time_writes_a_bag(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        fill(bag)
        with pytest.raises(InputError, match='bag is being written by another run'):
            BagWriter(tmp_path / 'bag')
    assert os.listdir(tmp_path) == ['bag']


def test_a_bag_stands_beside_what_somebody_put_into_its_place_meanwhile(tmp_path):
    (tmp_path / 'bag_2').touch()
    with BagWriter(tmp_path / 'bag') as bag:
        fill(bag)
        (tmp_path / 'bag').mkdir()
        (tmp_path / 'bag' / 'mine').touch()
    assert bag.path == tmp_path / 'bag_3'
    assert len(read_recording(bag.path).displacement) == 3
    assert (tmp_path / 'bag' / 'mine').exists()


def test_a_disk_that_is_full(tmp_path, monkeypatch):
    def fail(*arguments):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(McapWriter, 'write_chunk', fail)
    with pytest.raises(InputError) as caught:
        write_recording(tmp_path / 'bag', recording())
    assert str(caught.value) == (
        f'cannot write {tmp_path}/bag: No space left on device; make room, or choose another folder'
    )
    assert os.listdir(tmp_path) == []


def test_a_database_that_has_no_room(tmp_path, monkeypatch):
    def fail(*arguments):
        raise sqlite3.OperationalError('database or disk is full')

    monkeypatch.setattr(SqliteWriter, 'write_chunk', fail)
    with pytest.raises(InputError, match=r'database or disk is full; make room, or choose another folder$'):
        write_recording(tmp_path / 'bag', recording(), storage='sqlite3')
    assert os.listdir(tmp_path) == []


def test_an_unknown_type_is_refused(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        fill(bag)
        with pytest.raises(InputError) as caught:
            bag.add_topic('/x', 'acme_msgs/msg/Press')
    assert str(caught.value) == (
        'topic /x cannot be recorded: its type acme_msgs/msg/Press is not one that ROS 2 ships'
    )


def test_everyday_types_are_as_ros_2_ships_them():
    everyday, shipped = messages.types_with(convention.JOINT_STATE), messages.standard_types()
    assert everyday is not shipped
    for msgtype in messages._EVERYDAY:
        assert everyday.fielddefs[msgtype] == shipped.fielddefs[msgtype]
        assert everyday.generate_msgdef(msgtype, ros_version=2) == shipped.generate_msgdef(msgtype, ros_version=2)
        assert everyday.hash_rihs01(msgtype) == shipped.hash_rihs01(msgtype)


def test_times_that_do_not_fit_a_stamp(tmp_path):
    with pytest.raises(InputError, match=r'^made up: times of 3e\+09 to 3e\+09 s do not fit a stamp: check their unit'):
        write_recording(tmp_path / 'bag', recording(epoch=3 * 10**18))
    assert os.listdir(tmp_path) == []
