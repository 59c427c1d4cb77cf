# SPDX-License-Identifier: Apache-2.0
"""A path is read from any table and bag as it was written, and anything else is refused in a line."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from path_cases import (
    JAZZY,
    JOINT_STATE,
    JOINT_TRAJECTORY,
    NOETIC,
    PATH,
    header,
    joint_states,
    planned_path,
    trajectory,
    write_bag,
    write_ros1_bag,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path import PathMotion, Surface, motion, path_bags, path_tables, read_path

LENGTHS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6, 'inch': 0.0254, 'mil': 2.54e-5}
TIMES = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, 'min': 60.0, 'h': 3600.0, 'd': 86_400.0}

ARC = np.array([(0.0, 0.0, 0.1), (0.03, 0.04, 0.101), (0.03, 0.14, 0.1), (-0.09, 0.19, 0.098)])
"""Points of a path [m]; across z it is 0, 0.05, 0.15 and 0.28 m long."""


def written(folder, text, name='path.csv'):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path, **options):
    """Return the message of a refusal without the path, after checking that it is a line about the path."""
    with pytest.raises(InputError) as caught:
        read_path(path, **options)
    text = str(caught.value)
    assert text.startswith(f'{path}: ')
    assert '\n' not in text
    return text.removeprefix(f'{path}: ')


# tables


@st.composite
def tables(draw):
    """Return the bytes of a table, its kind, and the SI numbers of its rows."""
    names, units = draw(st.sampled_from([(('along', 'error'), LENGTHS), (('time', 'displacement'), TIMES)]))
    base_unit, value_unit = draw(st.sampled_from(sorted(units))), draw(st.sampled_from(sorted(LENGTHS)))
    steps = draw(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=30))
    base = draw(st.floats(-1e3, 1e3)) + np.cumsum([0.0, *steps])
    values = draw(st.lists(st.floats(-1.0, 1.0), min_size=len(base), max_size=len(base)))
    columns = [
        (f'{names[0]}_{base_unit}', [float(number / units[base_unit]) for number in base]),
        (f'{names[1]}_{value_unit}', [number / LENGTHS[value_unit] for number in values]),
        *[(name, ['more'] * len(base)) for name in draw(st.sampled_from([[], ['note'], ['error', 'time']]))],
    ]
    columns = draw(st.permutations(columns))
    delimiter = draw(st.sampled_from(',;\t'))
    decimal = draw(st.sampled_from('.,')) if delimiter != ',' else '.'
    space = draw(st.sampled_from(['', ' ']))
    rows = [[name for name, _ in columns], *zip(*(numbers for _, numbers in columns))]
    lines = [delimiter.join(f'{space}{field}{space}'.replace('.', decimal) for field in row) for row in rows]
    for _ in range(draw(st.integers(0, 3))):
        lines.insert(draw(st.integers(0, len(lines))), draw(st.sampled_from(['# a, comment; of 1', '', delimiter])))
    end = draw(st.sampled_from(['\n', '\r\n', '\r']))
    text = end.join(lines) + draw(st.sampled_from(['', end]))
    encoding = draw(st.sampled_from(['utf-8', 'utf-8-sig', 'utf-16']))
    return text.encode(encoding), names[0], base - base[0], np.array(values)


@given(tables())
def test_a_table_gives_the_numbers_that_were_written(tmp_path_factory, table):
    content, kind, base, values = table
    found = read_path(written(tmp_path_factory.mktemp('table'), content))
    assert isinstance(found, Surface if kind == 'along' else PathMotion)
    numbers = (found.along, found.error) if kind == 'along' else (found.times, found.displacement)
    np.testing.assert_allclose(numbers[0], base, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(numbers[1], values, rtol=1e-12, atol=1e-300)
    assert numbers[0][0] == 0.0


def test_further_columns_may_have_any_texts(tmp_path):
    table = ';error_code;error_mm;along_cm;größe in µm;time_s\n0;E_7;0,5;1;"a;b";x\n1;;-1.5;3;"two\nlines";y\n'
    for encoding in ('utf-8', 'latin-1'):
        found = read_path(written(tmp_path, table.encode(encoding)))
        np.testing.assert_allclose(found.along, [0.0, 0.02])
        np.testing.assert_allclose(found.error, [5e-4, -1.5e-3])


def test_a_motion_of_a_table_knows_no_position(tmp_path):
    found = read_path(written(tmp_path, 'time_ms,displacement_mm\n500,1\n600,2\n'))
    np.testing.assert_allclose(found.times, [0.0, 0.1])
    np.testing.assert_allclose(found.displacement, [1e-3, 2e-3])
    assert found.along is None


HEAD = 'along_m,error_mm\n'
REFUSED = {
    'empty': ('', 'has no rows'),
    'comments': ('# a\n# b\n', 'has no rows'),
    'head alone': (HEAD, 'has 0 rows below its head'),
    'one row': (f'{HEAD}0,1\n', 'has 1 row below its head'),
    'no head': ('0,1\n1,2\n', 'has the head “0, 1”.*along_m,error_mm or time_s,displacement_mm'),
    'other head': ('x,y\n1,2\n', 'has the head “x, y”'),
    'half a head': ('along_m,displacement_mm\n1,2\n', 'has the head “along_m, displacement_mm”'),
    'head with an open quote': ('"along_m,error_mm\n1,2\n', 'has the head “along_m,error_mm”'),
    'no unit': ('along,error\n1,2\n', 'has the head “along, error”'),
    'unknown unit': (
        'along_furlong,error_mm\n1,2\n',
        'column “along_furlong” of unknown unit: name it one of along_m, along_cm',
    ),
    'other quantity': (
        'time_s,displacement_Pa\n1,2\n',
        'column “displacement_Pa” of unknown unit: name it one of displacement_m',
    ),
    'column twice': ('along_m,error_mm,along_mm\n1,2,3\n', r'has 2 columns of along \(along_m, along_mm\)'),
    'name twice': ('along_m,error_mm,error_mm\n1,2,3\n', r'has 2 columns of error \(error_mm, error_mm\)'),
    'both': ('along_m,error_mm,time_s,displacement_m\n1,2,3,4\n', 'columns of a surface .* and of a motion'),
    'text': (f'{HEAD}0,1\n\n# c\n1,high\n', '^line 5: error_mm holds “high”: write a number$'),
    'no number': (f'{HEAD}0,1\n1,\n', '^line 3: error_mm is empty'),
    'underscores': (f'{HEAD}0,1\n1_0,1\n', '^line 3: along_m holds “1_0”'),
    'other digits': (f'{HEAD}0,1\n\N{ARABIC-INDIC DIGIT ONE},1\n', '^line 3: along_m holds'),
    'not a number': (f'{HEAD}0,1\n1,nan\n', '^line 3: error_mm is not finite'),
    'infinite': (f'{HEAD}0,1\ninf,1\n', '^line 3: along_m is not finite'),
    'too large': ('time_d,displacement_m\n0,1\n1e308,1\n', '^line 3: time_d is not finite'),
    'range too large': (f'{HEAD}-1e308,1\n1e308,1\n', '^line 3: along_m must increase from row to row, and “1e308”'),
    'decreasing': (f'{HEAD}0,1\n2,1\n1,1\n', '^line 4: along_m must increase from row to row, and “1” does not'),
    'repeated': (f'{HEAD}0,1\n2,1\n2,1\n', '^line 4: along_m must increase'),
    'merged by the shift': (f'{HEAD}-1,1\n1e-17,1\n2e-17,1\n', '^line 4: along_m must increase'),
    'decimal commas': (f'{HEAD}0,0,1,5\n', '^line 2 has 4 fields, but the head has 2: with decimal commas'),
    'short row': (f'{HEAD}0,1\n1\n', '^line 3 has 1 field, but the head has 2'),
    'two decimals': ('along_m;error_mm\n0;1\n1.000,5;1\n', '^line 3: along_m holds “1.000,5”'),
    'open quote': ('along_m,error_mm,note\n0,1,"a\n1,1,b\n2,1,c\n', '^line 4 is not a row of a table: check its quot'),
    'long field': (f'{HEAD}0,1\n1,{"1" * 200_000}\n', '^line 3 is not a row'),
    'long line': (f'{HEAD}0,1\n1,1{" " * 2**20}\n', '^has a line of more than 1,048,576 characters'),
    'binary': (bytes(range(256)), '^is neither a text file nor a bag'),
    'broken text': (HEAD.encode() + b'0,1\n' * 20_000 + b'\xff\n', '^line 3: along_m must increase'),
    'text that breaks off': (HEAD.encode() + b'# \n' * 30_000 + b'\xff\n', '^is not text all through'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_a_table_that_is_no_path_is_refused(tmp_path, case):
    content, pattern = REFUSED[case]
    assert re.search(pattern, refusal(written(tmp_path, content)))


def test_what_is_not_there_or_no_file_is_refused(tmp_path):
    assert 'No such file' in refusal(tmp_path / 'none.csv')
    assert 'does not exist' in refusal(tmp_path / 'none.mcap')
    assert 'holds no bag' in refusal(tmp_path)
    os.mkfifo(tmp_path / 'pipe.csv')
    assert 'is a named pipe, not a file' in refusal(tmp_path / 'pipe.csv')
    os.mkfifo(tmp_path / 'pipe.mcap')
    assert 'is a named pipe, not a file' in refusal(tmp_path / 'pipe.mcap')


# bags


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_recorded_motion_is_that_of_the_piston(tmp_path, storage):
    positions = 5e-3 * np.sin(np.arange(50) / 5.0)
    bag = write_bag(tmp_path / 'bag', {'/cfd/device/piston_state': joint_states(positions)}, storage=storage)
    for path in (bag, *bag.glob('*.mcap'), *bag.glob('*.db3')):
        found = read_path(path)
        assert isinstance(found, PathMotion)
        np.testing.assert_allclose(found.times, np.arange(50) / 100, atol=1e-12)
        np.testing.assert_array_equal(found.displacement, positions)
        assert (found.along, found.notes) == (None, ())


def test_the_joint_is_chosen_by_its_name(tmp_path):
    positions = 1e-3 * np.arange(20)
    both = joint_states(np.stack([positions, -positions], axis=1), ('slide', 'piston'))
    bag = write_bag(tmp_path / 'both', {'/piston_state': both})
    np.testing.assert_array_equal(read_path(bag).displacement, -positions)
    np.testing.assert_array_equal(read_path(bag, joint='slide').displacement, positions)
    assert re.search('position.nose.*slide, piston', refusal(bag, joint='nose'))

    alone = write_bag(tmp_path / 'alone', {'/piston_state': joint_states(positions, ('slide',))})
    np.testing.assert_array_equal(read_path(alone).displacement, positions)

    unclear = joint_states(np.stack([positions, -positions], axis=1), ('slide', 'arm'))
    bag = write_bag(tmp_path / 'unclear', {'/piston_state': unclear})
    assert refusal(bag) == 'topic /piston_state: has several joints: choose with --joint one of slide, arm'

    nameless = write_bag(tmp_path / 'nameless', {'/piston_state': joint_states(positions, ())})
    assert 'name no joint' in refusal(nameless)


def test_defects_of_a_recorded_motion_are_noted(tmp_path):
    states = joint_states(1e-3 * np.arange(20))
    states[3].position[0] = np.nan
    states[5].header = states[4].header
    found = read_path(write_bag(tmp_path / 'bag', {'/piston_state': states}))
    assert len(found.times) == 18
    assert any('1 sample not finite' in note for note in found.notes)
    assert any('at the time of another' in note for note in found.notes)


@pytest.mark.parametrize(('axis', 'along', 'error'), [
    ('', [0.0, 0.05, 0.15, 0.28], [0.0, 0.001, 0.0, -0.002]),
    ('z', [0.0, 0.05, 0.15, 0.28], [0.0, 0.001, 0.0, -0.002]),
    ('x', np.cumsum([0.0, np.hypot(0.04, 0.001), np.hypot(0.1, 0.001), np.hypot(0.05, 0.002)]), ARC[:, 0]),
    ('y', np.cumsum([0.0, np.hypot(0.03, 0.001), 0.001, np.hypot(0.12, 0.002)]), ARC[:, 1]),
])  # fmt: skip
def test_a_planned_path_is_a_surface(tmp_path, axis, along, error):
    found = read_path(write_bag(tmp_path / 'bag', {'/plan': [planned_path(ARC, frame='')]}), axis=axis)
    assert isinstance(found, Surface)
    np.testing.assert_allclose(found.along, along, atol=1e-15)
    np.testing.assert_allclose(found.error, error, atol=1e-15)
    assert found.notes == ()


@pytest.mark.parametrize('frames', [('', ''), ('', 'tool'), ('tool', ''), ('tool', 'tool')])
def test_a_frame_need_not_be_repeated(tmp_path, frames):
    plan = planned_path(ARC, frame=frames[0])
    plan.header.frame_id = frames[1]
    assert len(read_path(write_bag(tmp_path / 'bag', {'/plan': [plan]})).along) == len(ARC)


def test_of_a_repeated_path_the_last_is_read(tmp_path):
    paths = [planned_path(factor * ARC) for factor in (1.0, 2.0, 3.0)]
    found = read_path(write_bag(tmp_path / 'bag', {'/plan': paths}))
    np.testing.assert_allclose(found.along, [0.0, 0.15, 0.45, 0.84])
    assert found.notes == ('topic /plan has 3 messages: the last is used',)


def test_a_planned_motion_begins_at_zero(tmp_path):
    plan = trajectory([250, 500, 12_000], [(9.0, 0.001), (9.0, 0.002), (9.0, -0.003)], ('wrist', 'piston'))
    bag = write_bag(tmp_path / 'bag', {'/plan': [plan]})
    found = read_path(bag)
    assert isinstance(found, PathMotion)
    np.testing.assert_array_equal(found.times, [0.0, 0.25, 11.75])
    np.testing.assert_array_equal(found.displacement, [0.001, 0.002, -0.003])
    np.testing.assert_array_equal(read_path(bag, joint='wrist').displacement, [9.0, 9.0, 9.0])
    assert refusal(bag, joint='nose') == 'topic /plan: has no joint nose: the joints are wrist, piston'


def test_unused_bytes_at_the_end_of_a_message_are_no_damage(tmp_path):
    """Rclpy's serialize_message leaves bytes of any content there."""
    payload = bytes(JAZZY.serialize_cdr(trajectory([0, 500], [[0.1], [0.2]]), JOINT_TRAJECTORY)) + b'\x91\x2f' * 12
    found = read_path(write_bag(tmp_path / 'bag', {'/plan': [(JOINT_TRAJECTORY, payload)]}))
    np.testing.assert_array_equal(found.displacement, [0.1, 0.2])


def test_bytes_may_be_in_either_order(tmp_path):
    payload = bytes(JAZZY.serialize_cdr(planned_path(ARC), PATH, little_endian=False))
    found = read_path(write_bag(tmp_path / 'bag', {'/plan': [(PATH, payload)]}))
    np.testing.assert_allclose(found.along, [0.0, 0.05, 0.15, 0.28])


def test_bags_of_ros_1_are_read(tmp_path):
    path = write_ros1_bag(tmp_path / 'plan.bag', {'/plan': [planned_path(ARC, types=NOETIC)]})
    np.testing.assert_allclose(read_path(path).along, [0.0, 0.05, 0.15, 0.28])
    states = joint_states(1e-3 * np.arange(9), types=NOETIC)
    path = write_ros1_bag(tmp_path / 'run.bag', {'/cfd/device/piston_state': states})
    np.testing.assert_array_equal(read_path(path).displacement, 1e-3 * np.arange(9))


def test_a_bag_may_hold_several_topics(tmp_path):
    states = joint_states(1e-3 * np.arange(9))
    contents = {
        '/joint_states': joint_states(1e-4 * np.arange(9)),
        '/cfd/device/piston_state': states,
        '/plan': [planned_path(ARC)],
        '/stamp': [header()],
    }
    bag = write_bag(tmp_path / 'bag', contents)
    assert refusal(bag) == (
        f'has 2 topics of a path: choose with --topic one of /cfd/device/piston_state ({JOINT_STATE}), /plan ({PATH})'
    )
    assert isinstance(read_path(bag, topic='plan'), Surface)
    assert read_path(bag, topic='/cfd/device/piston_state').displacement[-1] == 8e-3
    assert read_path(bag, topic='joint_states').displacement[-1] == pytest.approx(8e-4)
    assert re.search('no messages on topic /other: the topics are .*/plan', refusal(bag, topic='/other'))
    assert re.search('/stamp holds std_msgs/msg/Header: .*the topics are .*/plan', refusal(bag, topic='/stamp'))


def test_a_bag_without_a_path_names_its_topics(tmp_path):
    bag = write_bag(tmp_path / 'bag', {'/joint_states': joint_states([0.0, 1.0]), '/stamp': [header()]})
    text = refusal(bag)
    assert 'neither piston_state nor nav_msgs/msg/Path nor trajectory_msgs/msg/JointTrajectory' in text
    assert text.endswith(f'the topics are /joint_states ({JOINT_STATE}), /stamp (std_msgs/msg/Header)')


def test_an_axis_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no axis 'w': choose one of x, y, z$"):
        read_path(tmp_path / 'bag', axis='w')


PLANS = {
    'no poses': (planned_path([]), 'its last message has no poses'),
    'one pose': (planned_path(ARC[:1]), 'fewer than 2 points'),
    'pose twice': (planned_path(ARC[[0, 1, 1, 2]]), 'does not increase from point 2 to the next'),
    'pose above another': (planned_path([(0, 0, 0), (0, 0, 1), (1, 0, 0)]), 'not increase from point 1 to the next'),
    'pose not finite': (planned_path([(0, 0, 0), (1, 0, np.nan)]), 'error of the surface is not finite at point 2'),
    'position not finite': (planned_path([(0, 0, 0), (np.inf, 0, 0)]), 'position .* is not finite at point 2'),
    'too far': (planned_path([(-1e308, 0, 0), (1e308, 0, 0)]), 'position .* is not finite at point 2'),
    'poses of two frames': (planned_path(ARC, frame='tool'), r'several frames \(base, tool\)'),
    'no points': (trajectory([], []), 'its last message has no points'),
    'no joints': (trajectory([0, 1], [[0.0], [1.0]], ()), 'name no joint'),
    'several joints': (trajectory([0], [[0.0, 1.0]], ('a', 'b')), 'several joints: choose with --joint one of a, b'),
    'point without position': (trajectory([0, 1], [[0.0], []]), 'point 2 has no position of the joint'),
    'time twice': (trajectory([0, 5, 5], [[0.0], [1.0], [2.0]]), 'the time does not increase from point 2'),
    'not finite': (trajectory([0, 5], [[0.0], [np.inf]]), 'the displacement is not finite at point 2'),
}


@pytest.mark.parametrize('case', PLANS)
def test_a_plan_that_is_no_path_is_refused(tmp_path, case):
    plan, pattern = PLANS[case]
    text = refusal(write_bag(tmp_path / 'bag', {'/plan': [plan]}))
    assert text.startswith('topic /plan: ')
    assert re.search(pattern, text)


def test_more_points_than_are_accepted_are_refused(tmp_path, monkeypatch):
    assert motion.MOST_POINTS == 2_000_000
    monkeypatch.setattr(path_bags, 'MOST_POINTS', 3)
    monkeypatch.setattr(path_tables, 'MOST_POINTS', 3)
    assert len(read_path(written(tmp_path, f'{HEAD}0,0\n1,0\n2,0\n')).along) == 3
    assert 'more than 3 rows' in refusal(written(tmp_path, f'{HEAD}0,0\n1,0\n2,0\n3,0\n'))
    bag = write_bag(tmp_path / 'bag', {'/piston_state': joint_states(np.arange(4))})
    assert 'topic /piston_state: has more than 3 messages' in refusal(bag)


@pytest.mark.parametrize('size', [0, 3, 4, 30, -1])
def test_a_message_that_ends_early_is_damaged(tmp_path, size):
    for msgtype, plan in {PATH: planned_path(ARC), JOINT_TRAJECTORY: trajectory([0, 5], [[0.0], [1.0]])}.items():
        payload = bytes(JAZZY.serialize_cdr(plan, msgtype))[:size]
        bag = write_bag(tmp_path / msgtype.rpartition('/')[2], {'/plan': [(msgtype, payload)]})
        assert re.search('topic /plan: a .* is damaged', refusal(bag))


@given(st.data())
def test_a_changed_byte_gives_a_path_or_a_refusal(tmp_path_factory, data):
    msgtype, plan = data.draw(
        st.sampled_from([(PATH, planned_path(ARC)), (JOINT_TRAJECTORY, trajectory([0, 5], [[0.0], [1.0]]))])
    )
    payload = bytearray(JAZZY.serialize_cdr(plan, msgtype))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.sampled_from([0, 1, 127, 128, 255]))
    bag = write_bag(tmp_path_factory.mktemp('changed') / 'bag', {'/plan': [(msgtype, bytes(payload))]})
    try:
        found = read_path(bag)
    except InputError:
        assert refusal(bag)
        return
    base = found.along if isinstance(found, Surface) else found.times
    assert np.all(np.diff(base) > 0.0)


def test_a_large_message_is_refused_before_it_is_decoded(tmp_path):
    payload = bytes(JAZZY.serialize_cdr(planned_path(ARC), PATH)) + bytes(16 * 2**20)
    bag = write_bag(tmp_path / 'bag', {'/plan': [(PATH, payload)]})
    assert 'has more than 16 MiB' in refusal(bag)


def test_a_type_that_the_bag_defines_differently_is_refused(tmp_path):
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg('float64[] poses\n', PATH))
    other = types.types[PATH](poses=np.arange(3.0))
    bag = write_bag(tmp_path / 'bag', {'/plan': [other]}, types=types)
    assert 'the bag defines nav_msgs/msg/Path differently from ROS' in refusal(bag)


def test_a_damaged_bag_gives_what_is_readable_with_a_note(tmp_path):
    bag = write_bag(tmp_path / 'bag', {'/piston_state': joint_states(1e-3 * np.arange(2000))})
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-200])
    found = read_path(file)
    assert len(found.times) > 1000
    assert any('salvaged' in note for note in found.notes)


# what all paths have in common


@pytest.mark.parametrize(
    ('base', 'value', 'pattern'),
    [
        ([0.0], [0.0], 'fewer than 2'),
        ([0.0, 1.0], [0.0], 'one number for each point'),
        ([[0.0, 1.0]], [[0.0, 1.0]], 'one number for each point'),
        ([0.5, 1.0], [0.0, 0.0], 'begins at 0.5: it must begin at 0'),
        ([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], 'does not increase from point 2'),
        ([0.0, np.nan], [0.0, 0.0], 'not finite at point 2'),
        ([0.0, 1.0], [0.0, np.inf], 'not finite at point 2'),
    ],
)
@pytest.mark.parametrize('kind', [Surface, PathMotion])
def test_arrays_that_are_no_path_are_refused(kind, base, value, pattern):
    with pytest.raises(InputError, match=pattern):
        kind(np.array(base), np.array(value))


def test_positions_of_a_motion_are_checked():
    with pytest.raises(InputError, match='the position along the path is not finite at point 1'):
        PathMotion(np.array([0.0, 1.0]), np.zeros(2), np.array([np.nan, 1.0]))


def test_a_head_may_be_a_comment_as_numpy_writes_it(tmp_path):
    table = np.column_stack([np.linspace(0.0, 0.1, 5), [0.0, 1e-4, 2e-4, 1e-4, 0.0]])
    np.savetxt(tmp_path / 'surface.csv', table, delimiter=',', header='measured on Monday\nalong_m,error_m')
    surface = read_path(tmp_path / 'surface.csv')
    np.testing.assert_allclose(surface.error, table[:, 1])
