# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import shutil

import made
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_cases import (
    EPOCH,
    SECOND,
    Message,
    assert_same,
    piston,
    plain_messages,
    pressure,
    recording,
    setpoint,
    write_bag,
    write_ros1_bag,
)
from rosbags.rosbag2 import CompressionMode

from cfd_pneumatic import convention
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal, read_recording, write_recording


@st.composite
def any_signal(draw):
    """Draw a signal that begins at time zero, at times of whole nanoseconds; neighbouring values differ."""
    steps = draw(st.lists(st.integers(1, 10**10), max_size=5))
    values = draw(st.lists(st.integers(-(10**6), 10**6), min_size=len(steps) + 1, max_size=len(steps) + 1, unique=True))
    return Signal(np.cumsum([0, *steps]) / SECOND, np.array(values) / 7)


@st.composite
def any_recording(draw):
    chosen = draw(st.sampled_from([('cylinder_a',), ('cylinder_b',), ('cylinder_a', 'cylinder_b')]))
    cylinders = {name: CylinderSignals(draw(any_signal()), draw(st.none() | any_signal())) for name in chosen}
    epoch = draw(st.integers(0, 2 * 10**18))
    return Recording('any', epoch, draw(any_signal()), cylinders, draw(st.none() | any_signal()), ())


@settings(max_examples=settings.default.max_examples // 4)
@given(made=any_recording(), storage=st.sampled_from(['mcap', 'sqlite3']))
def test_what_is_written_is_read_again(tmp_path_factory, made, storage):
    path = tmp_path_factory.mktemp('bags') / 'bag'
    write_recording(path, made, storage=storage)
    assert_same(read_recording(path), made, setpoint_error=1e-9)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return a recording and the same in two bags."""
    made = recording(cylinders=('cylinder_a', 'cylinder_b'), force=True)
    folder = tmp_path_factory.mktemp('bags')
    for storage in ('mcap', 'sqlite3'):
        write_recording(folder / storage, made, storage=storage, namespace='/left/device')
    return made, folder


@pytest.mark.parametrize('name', ['mcap', 'mcap/mcap.mcap', 'sqlite3', 'sqlite3/sqlite3.db3'])
def test_a_bag_is_a_folder_or_its_file(bags, name):
    made, folder = bags
    assert_same(read_recording(folder / name), made, setpoint_error=1e-9)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_folder_without_metadata_is_read(bags, tmp_path, storage):
    made, folder = bags
    shutil.copytree(folder / storage, tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert_same(read_recording(tmp_path / 'bag'), made, setpoint_error=1e-9)


@pytest.mark.parametrize('metadata', [True, False])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_split_bag_is_one_recording(tmp_path, storage, metadata):
    suffix = {'mcap': 'mcap', 'sqlite3': 'db3'}[storage]
    bag = tmp_path / 'bag'
    bag.mkdir()
    for part in (0, 1, 10):  # as names these sort otherwise
        name = f'bag_{part}'
        write_bag(tmp_path / name, plain_messages(10, EPOCH + part * SECOND // 10), storage=storage)
        shutil.copy(tmp_path / name / f'{name}.{suffix}', bag)
    if metadata:
        content = yaml.safe_load((tmp_path / 'bag_0' / 'metadata.yaml').read_text())
        information = content['rosbag2_bagfile_information']
        information['relative_file_paths'] = [f'bag_{part}.{suffix}' for part in (0, 1, 10)]
        (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))
    read = read_recording(bag)
    assert len(read.displacement) == 30
    assert not any('order' in note for note in read.health)


@pytest.mark.parametrize(
    ('storage', 'mode'),
    [('mcap', 'FILE'), ('mcap', 'MESSAGE'), ('mcap', 'STORAGE'), ('sqlite3', 'FILE'), ('sqlite3', 'MESSAGE')],
)
def test_a_compressed_bag_is_read(tmp_path, storage, mode):
    write_bag(tmp_path / 'bag', plain_messages(), storage=storage, compression=CompressionMode[mode])
    assert len(read_recording(tmp_path / 'bag').displacement) == 20


def test_a_ros1_bag_is_read(tmp_path):
    read = read_recording(write_ros1_bag(tmp_path / 'old.bag'))
    assert read.epoch == EPOCH
    np.testing.assert_array_equal(read.displacement.values, 1e-4 * np.arange(20))
    np.testing.assert_array_equal(read.cylinders['cylinder_a'].pressure.values, 2e5 + np.arange(20))


def test_topics_of_ros1_may_lack_the_leading_slash(tmp_path):
    path = write_ros1_bag(tmp_path / 'old.bag', namespace='cfd/device')
    assert len(read_recording(path).displacement) == 20
    assert len(read_recording(path, namespace='/cfd/device').displacement) == 20


def test_one_cylinder_is_enough_and_its_setpoint_need_not_be_there(tmp_path):
    write_recording(tmp_path / 'bag', recording(cylinders=('cylinder_b',), setpoints=False))
    read = read_recording(tmp_path / 'bag')
    assert list(read.cylinders) == ['cylinder_b']
    assert read.cylinders['cylinder_b'].setpoint is None
    assert read.force is None


def test_a_setpoint_without_a_pressure_is_left_out(tmp_path):
    lone = setpoint(1e5, EPOCH, topic='/cfd/device/cylinder_b/setpoint')
    write_bag(tmp_path / 'bag', [*plain_messages(), lone])
    assert list(read_recording(tmp_path / 'bag').cylinders) == ['cylinder_a']


def test_a_setpoint_is_gauge_and_acts_from_its_time(tmp_path):
    commands = [(1e5, 0), (1e5, 20), (2e5, 50)]
    contents = [setpoint(gauge, EPOCH + ms * SECOND // 1000) for gauge, ms in commands]
    write_bag(tmp_path / 'bag', plain_messages() + contents)
    found = read_recording(tmp_path / 'bag', ambient_pressure=1e5).cylinders['cylinder_a'].setpoint
    np.testing.assert_array_equal(found.times, [0.0, 0.05])
    np.testing.assert_array_equal(found.values, [2e5, 3e5])


def test_an_applied_setpoint_acted_up_to_its_stamp_and_is_preferred(tmp_path):
    topic = '/cfd/device/cylinder_a/setpoint_applied'
    values = [1e5, 1e5, 3e5, 3e5, 2e5]
    applied = [pressure(value, EPOCH + index * SECOND // 100, topic=topic) for index, value in enumerate(values)]
    write_bag(tmp_path / 'bag', [*plain_messages(), *applied, setpoint(9e5, EPOCH)])
    found = read_recording(tmp_path / 'bag').cylinders['cylinder_a'].setpoint
    np.testing.assert_array_equal(found.times, [0.0, 0.01, 0.03])
    np.testing.assert_array_equal(found.values, [1e5, 3e5, 2e5])


def test_header_stamps_count_and_times_of_reception_where_there_is_none(tmp_path):
    late = SECOND // 10
    contents = [piston(0.0, EPOCH, received=EPOCH + late), piston(1.0, 0, received=EPOCH + 2 * late)]
    contents += [pressure(2e5, EPOCH, received=EPOCH + late)]
    write_bag(tmp_path / 'bag', contents)
    read = read_recording(tmp_path / 'bag')
    assert read.epoch == EPOCH
    np.testing.assert_array_equal(read.displacement.times, [0.0, 0.2])


def test_times_of_reception_follow_stamps_of_another_clock(tmp_path):
    """A simulator's time begins at zero, a set-point without a header was received at the time of day."""
    stamps = [SECOND + index * SECOND // 100 for index in range(10)]
    contents = [piston(0.1 * index, stamp, received=EPOCH + stamp) for index, stamp in enumerate(stamps)]
    contents += [pressure(2e5, stamp, received=EPOCH + stamp) for stamp in stamps]
    contents += [setpoint(1e5, EPOCH + stamps[5])]
    write_bag(tmp_path / 'bag', contents)
    read = read_recording(tmp_path / 'bag')
    np.testing.assert_allclose(read.cylinders['cylinder_a'].setpoint.times, [0.05])
    assert read.health == (
        'cylinder_a setpoint: moved by -1700000000.123 s from the clock of reception to that of the stamps',
    )


def joints(stamp, names, positions):
    message = made.joint_state(stamp, '', 0.0)
    message.name, message.position = names, np.array(positions)
    return Message('/cfd/device/piston_state', convention.JOINT_STATE, stamp, message)


def test_a_joint_is_found_by_its_name_wherever_it_is(tmp_path):
    contents = [
        joints(EPOCH, ['ram', 'piston'], [9.0, 1.0]),
        joints(EPOCH + 1_000_000, ['piston', 'ram'], [2.0, 9.0]),
        joints(EPOCH + 2_000_000, ['ram'], [9.0]),
        joints(EPOCH + 3_000_000, ['piston', 'ram'], [4.0, 9.0]),
        pressure(2e5, EPOCH),
    ]
    write_bag(tmp_path / 'bag', contents)
    read = read_recording(tmp_path / 'bag')
    np.testing.assert_array_equal(read.displacement.values, [1.0, 2.0, 4.0])
    np.testing.assert_array_equal(read.displacement.times, [0.0, 0.001, 0.003])
    assert 'displacement: 1 message without position[piston]' in read.health
    np.testing.assert_array_equal(read_recording(tmp_path / 'bag', joint='ram').displacement.values, [9.0] * 4)


def test_a_joint_that_is_not_there(tmp_path):
    write_bag(tmp_path / 'bag', [joints(EPOCH, ['ram', 'gripper'], [9.0, 1.0]), pressure(2e5, EPOCH)])
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / 'bag')
    assert str(caught.value) == (
        f'{tmp_path}/bag: no message on topic /cfd/device/piston_state has position[piston]; '
        'the names are “ram, gripper”'
    )


def test_the_axis_of_the_force(tmp_path):
    wrench = made.wrench_stamped(EPOCH, 1.0)
    wrench.wrench.force.z = 3.0
    force = Message('/cfd/device/measured_force', convention.WRENCH_STAMPED, EPOCH, wrench)
    write_bag(tmp_path / 'bag', [*plain_messages(), force])
    assert read_recording(tmp_path / 'bag').force.values == [1.0]
    assert read_recording(tmp_path / 'bag', force_axis='z').force.values == [3.0]


def two_devices():
    there = [
        Message(m.topic.replace('/cfd/device', '/cell_2'), m.msgtype, m.time, m.content) for m in plain_messages(30)
    ]
    return plain_messages() + there


def test_a_namespace_chooses_among_several_devices(tmp_path):
    write_bag(tmp_path / 'bag', two_devices())
    assert len(read_recording(tmp_path / 'bag', namespace='cell_2/').displacement) == 30
    assert len(read_recording(tmp_path / 'bag', namespace='/cfd/device').displacement) == 20


def test_topics_without_a_namespace(tmp_path):
    write_recording(tmp_path / 'bag', recording(), namespace='/')
    assert len(read_recording(tmp_path / 'bag').displacement) == 50
    assert len(read_recording(tmp_path / 'bag', namespace='/').displacement) == 50


TOPICS = (
    '/cfd/device/cylinder_a/pressure (sensor_msgs/msg/FluidPressure), '
    '/cfd/device/piston_state (sensor_msgs/msg/JointState)'
)


def error_of(path, **options):
    with pytest.raises(InputError) as caught:
        read_recording(path, **options)
    message = str(caught.value)
    assert '\n' not in message
    assert message.startswith(f'{path}: ')
    return message[len(f'{path}: ') :]


def test_several_devices_and_none_chosen(tmp_path):
    write_bag(tmp_path / 'bag', two_devices())
    assert error_of(tmp_path / 'bag') == 'several devices are recorded: choose a namespace, one of /cell_2, /cfd/device'


def test_a_namespace_that_does_not_fit(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages())
    assert error_of(tmp_path / 'bag', namespace='/cfd/sim') == (
        'no cylinder_a/pressure or cylinder_b/pressure in the namespace /cfd/sim; namespaces that do: /cfd/device; '
        f'the topics are {TOPICS}'
    )


def test_a_bag_without_the_topics_lists_those_it_has(tmp_path):
    write_bag(tmp_path / 'bag', [piston(0.0, EPOCH), setpoint(1.0, EPOCH, topic='/chatter')])
    assert error_of(tmp_path / 'bag') == (
        'no cylinder_a/pressure or cylinder_b/pressure: give a mapping file for the topics that there are: '
        '/cfd/device/piston_state (sensor_msgs/msg/JointState), /chatter (std_msgs/msg/Float64)'
    )


def test_a_topic_of_another_type(tmp_path):
    other = setpoint(1.0, EPOCH, topic='/cfd/device/cylinder_a/pressure')
    write_bag(tmp_path / 'bag', [piston(0.0, EPOCH), other])
    assert error_of(tmp_path / 'bag') == (
        'topic /cfd/device/cylinder_a/pressure holds std_msgs/msg/Float64, not sensor_msgs/msg/FluidPressure: '
        'give a mapping file'
    )


def test_signals_without_a_common_time(tmp_path):
    contents = [piston(0.0, EPOCH), piston(0.0, EPOCH + SECOND), pressure(2e5, EPOCH + 5 * SECOND)]
    write_bag(tmp_path / 'bag', contents)
    assert error_of(tmp_path / 'bag') == (
        'the displacement (0.000 to 1.000 s) and the cylinder_a pressure (5.000 to 5.000 s) have no time in common: '
        'if their clocks differ, give `stamp: receive` in a mapping file'
    )


def test_an_axis_that_is_none(tmp_path):
    with pytest.raises(InputError, match="the force has no axis 'q': choose one of x, y, z"):
        read_recording(tmp_path, force_axis='q')


def test_nan_is_dropped_and_counted(tmp_path):
    contents = plain_messages()
    contents[3].content.position[0] = np.nan
    contents[4].content.position[0] = np.inf
    write_bag(tmp_path / 'bag', contents)
    read = read_recording(tmp_path / 'bag')
    assert len(read.displacement) == 18
    assert read.health[0] == 'displacement: dropped 2 samples not finite'


def test_nothing_but_nan(tmp_path):
    contents = [piston(np.nan, EPOCH), pressure(2e5, EPOCH)]
    write_bag(tmp_path / 'bag', contents)
    assert error_of(tmp_path / 'bag') == 'displacement holds no finite number'


def test_a_clock_that_is_set_back(tmp_path):
    contents = [piston(0.0, EPOCH + 9 * SECOND, received=EPOCH), piston(0.0, EPOCH, received=EPOCH + SECOND)]
    write_bag(tmp_path / 'bag', [*contents, pressure(2e5, EPOCH)])
    assert error_of(tmp_path / 'bag') == (
        'displacement: time goes back by 9.000 s at sample 2: the clock was set back or two recordings are in one; '
        'split it there'
    )
