# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import sqlite3

import numpy as np
import pytest
from recording_cases import EPOCH, ROOT, plain_messages, press_messages, press_types, write_bag, write_press_types

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording import read_mapping, read_recording
from cfd_pneumatic.units import INCH, PSI

GOOD = """\
displacement: {topic: piston_state, unit: m}
cylinder_a:
  pressure: {topic: cylinder_a/pressure, unit: Pa, reference: absolute}
"""

PRESS = """\
types: messages
displacement: {topic: /press/state, field: 'channels[1].reading', unit: um, sign: -1, stamp: t_us, stamp_unit: us}
cylinder_a:
  pressure:
    topic: /press/state
    field: analog[3]
    unit: psi
    scale: 25/5
    offset: -1
    reference: gauge
    stamp: t_us
    stamp_unit: us
    time_offset: -0.002
cylinder_b:
  pressure: {topic: /press/state, field: 'analog[2]', unit: bar, reference: absolute, stamp: receive}
"""


def written(folder, text):
    path = folder / 'mapping.yaml'
    path.write_text(text)
    return read_mapping(path)


@pytest.fixture(scope='module')
def press(tmp_path_factory):
    """Return a folder with a bag of another make, in both storages, and the definitions of its messages."""
    folder = tmp_path_factory.mktemp('press')
    for storage in ('mcap', 'sqlite3'):
        write_bag(folder / storage, press_messages(), storage=storage, types=press_types())
    with sqlite3.connect(folder / 'sqlite3' / 'sqlite3.db3') as database:
        database.execute('DELETE FROM message_definitions')  # as ROS 2 Humble records
    write_press_types(folder / 'messages')
    return folder


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_messages_of_another_make_are_read(press, storage):
    read = read_recording(press / storage, mapping=written(press, PRESS))
    index = np.arange(20)
    assert read.epoch == EPOCH // 1000 * 1000 - 2_000_000
    np.testing.assert_allclose(read.displacement.values, -1e-4 * index, rtol=1e-15)
    np.testing.assert_allclose(read.displacement.times, 0.002 + 0.01 * index, atol=1e-9)
    oil = read.cylinders['cylinder_a'].pressure
    np.testing.assert_allclose(oil.times, 0.01 * index, atol=1e-9)
    np.testing.assert_allclose(oil.values, 101_325 + (5 * (2 + 0.125 * index) - 1) * PSI, rtol=1e-15)
    np.testing.assert_allclose(read.cylinders['cylinder_b'].pressure.times, 0.007 + 0.01 * index, atol=1e-6)
    np.testing.assert_array_equal(read.cylinders['cylinder_b'].pressure.values, 1e5)


def test_definitions_may_lie_in_the_package_itself(press):
    text = PRESS.replace('types: messages', 'types: messages/acme_msgs')
    assert len(read_recording(press / 'sqlite3', mapping=written(press, text)).displacement) == 20


def test_topics_are_relative_to_the_namespace_and_standard_types_need_no_field(tmp_path):
    write_bag(tmp_path / 'bag', plain_messages())
    read = read_recording(tmp_path / 'bag', mapping=written(tmp_path, GOOD), namespace='/cfd/device')
    plain = read_recording(tmp_path / 'bag')
    np.testing.assert_array_equal(read.displacement.values, plain.displacement.values)
    np.testing.assert_array_equal(
        read.cylinders['cylinder_a'].pressure.values, plain.cylinders['cylinder_a'].pressure.values
    )


def test_volts_as_in_the_paper(tmp_path):
    text = GOOD.replace('unit: m', 'unit: inch, scale: 1/3.1736').replace('unit: Pa', 'unit: psi, scale: 25/5')
    displacement, pressure = written(tmp_path, text).channels
    assert displacement.si(np.array(3.1736), 0.0) == pytest.approx(INCH)
    assert pressure.si(np.array(5.0), 0.0) == pytest.approx(25 * PSI)


def test_the_mapping_of_the_measured_data_is_valid():
    assert len(read_mapping(ROOT / 'config' / 'pneumatic_actuator.yaml').channels) == 3


BAD = {
    'no entry': ('', 'is empty: it must hold keys and values'),
    'a list': ('[1, 2]', 'must hold keys and values, not a list'),
    'no signal': ('force: {topic: a, unit: N}', 'line 1: cylinder_a is missing: give the pressure of a cylinder'),
    'no pressure': (
        'displacement: {topic: a, unit: m}',
        'line 1: cylinder_a is missing: give the pressure of a cylinder',
    ),
    'only a set-point': (
        'displacement: {topic: a, unit: m}\ncylinder_b: {setpoint: {topic: a, unit: Pa, reference: gauge}}',
        'line 2: cylinder_b: pressure is missing',
    ),
    'unknown entry': (
        f'{GOOD}cylinder_c: 1\n',
        'line 4: unknown key, did you mean cylinder_b? The keys are displacement, force, cylinder_a, cylinder_b, '
        'others, table, types',
    ),
    'upper case': (
        GOOD.replace('cylinder_a', 'CYLINDER_B'),
        'line 2: unknown key, did you mean cylinder_b? The keys are displacement, force, cylinder_a, cylinder_b, '
        'others, table, types',
    ),
    'unknown role': (
        f'{GOOD}  temperature: 1\n',
        'line 4: cylinder_a: unknown key: the keys are pressure, setpoint, setpoint_applied',
    ),
    'unknown key': (
        GOOD.replace('unit: m', 'units: m'),
        'line 1: displacement: unknown key, did you mean unit? The keys are topic, field, stamp, stamp_unit, unit, '
        'scale, offset, sign, time_offset',
    ),
    'unknown unit': (
        GOOD.replace('Pa', 'kg'),
        'line 3: cylinder_a.pressure: unit must be a unit of pressure: Pa, hPa, kPa, MPa, mbar, bar or psi',
    ),
    'unit of another quantity': (
        GOOD.replace('unit: m', 'unit: bar'),
        'line 1: displacement: unit must be a unit of length: m, cm, mm, um, inch or mil',
    ),
    'no unit': (GOOD.replace(', unit: m}', '}'), 'line 1: displacement: unit is missing'),
    'no topic': (GOOD.replace('topic: piston_state, ', ''), 'line 1: displacement: topic is missing'),
    'no reference': (GOOD.replace(', reference: absolute', ''), 'line 3: cylinder_a.pressure: reference is missing'),
    'unknown reference': (
        GOOD.replace('absolute', 'abs'),
        'line 3: cylinder_a.pressure: reference must be gauge or absolute',
    ),
    'sign': (GOOD.replace('unit: m', 'unit: m, sign: 2'), 'line 1: displacement: sign must be 1 or -1'),
    'scale': (
        GOOD.replace('unit: m', 'unit: m, scale: big'),
        'line 1: displacement: scale must be a finite number, or a fraction of two',
    ),
    'scale by zero': (
        GOOD.replace('unit: m', 'unit: m, scale: 1/0'),
        'line 1: displacement: scale must be a finite number, or a fraction of two',
    ),
    'scale 0': (
        GOOD.replace('unit: m', 'unit: m, scale: 0/5'),
        'line 1: displacement: scale must not be 0: it is the value of one raw unit in `unit`',
    ),
    'scale without end': (
        GOOD.replace('unit: m', 'unit: m, scale: .inf'),
        'line 1: displacement: scale must be a finite number, or a fraction of two',
    ),
    'a key twice': (
        GOOD.replace('unit: m', 'unit: m, unit: mm'),
        'line 1: the key is already in line 1: remove one of the two',
    ),
    'an entry twice': (
        f'{GOOD}displacement: {{topic: other, unit: mm}}\n',
        'line 4: the key is already in line 1: remove one of the two',
    ),
    'offset': (
        GOOD.replace('unit: m', 'unit: m, offset: .nan'),
        'line 1: displacement: offset must be a finite number, or a fraction of two',
    ),
    'field path': (
        GOOD.replace('unit: m', "unit: m, field: 'a..b'"),
        'line 1: displacement: field is not a field path: write it like wrench.force.x or data[3]',
    ),
    'types': (f'{GOOD}types: nowhere', 'line 4: types must be an existing folder, relative to the folder of this file'),
    'column in a mapping for bags': (
        GOOD.replace('topic: piston_state', 'column: 1'),
        'line 1: displacement: `column` is for tables: the mapping needs the entry `table`, with the time',
    ),
    'topic in a mapping for tables': (
        f'{GOOD}table: {{time: {{column: 1, unit: s}}}}',
        'line 1: displacement: unknown key: the keys are column, unit, scale, offset, sign, time_offset',
    ),
    'delimiter': (
        f'{GOOD}table: {{time: {{column: 1, unit: s}}, delimiter: or}}',
        'line 4: table: delimiter must be one character, space, whitespace, tab, comma or semicolon',
    ),
    'column': (
        f'{GOOD}table: {{time: {{column: 0, unit: s}}}}',
        'line 4: table.time: column must be a name or a number from 1 on',
    ),
    'header rows': (
        f'{GOOD}table: {{time: {{column: 1, unit: s}}, header_rows: -1}}',
        'line 4: table: header_rows must be a number of rows, from 0 to 1,000,000,000',
    ),
}


@pytest.mark.parametrize(('text', 'message'), BAD.values(), ids=BAD.keys())
def test_a_bad_mapping_is_told_by_file_entry_and_key(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        written(tmp_path, text)
    assert str(caught.value) == f'{tmp_path}/mapping.yaml: {message.format(folder=tmp_path)}'


def test_a_mapping_that_is_not_there_or_not_yaml(tmp_path):
    with pytest.raises(InputError, match=r'^.*/none.yaml: cannot be read: No such file or directory$'):
        read_mapping(tmp_path / 'none.yaml')
    with pytest.raises(InputError, match=r'^.*/mapping.yaml: is not YAML: line 1, column 7: while parsing [^\n]*$'):
        written(tmp_path, 'a: [1,')


NUMBERS = 'its numbers are t_us, channels[0].reading, analog[0]'
BAD_FOR_THE_BAG = {
    'missing topic': (
        ('topic: /press/state', 'topic: /press/stat'),
        'has no topic of the name that the mapping gives for the displacement: '
        'the topics are /press/state (acme_msgs/msg/Press)',
    ),
    'no field': (
        ("field: 'channels[1].reading', ", ''),
        f'topic /press/state: give the `field` of acme_msgs/msg/Press in the mapping: {NUMBERS}',
    ),
    'unknown field': (
        ('channels[1].reading', 'channels[1].value'),
        f'topic /press/state: acme_msgs/msg/Press has no such field: {NUMBERS}',
    ),
    'a string': (
        ('channels[1].reading', 'state'),
        f'topic /press/state: field state of acme_msgs/msg/Press is a string, not a number: {NUMBERS}',
    ),
    'a message': (
        ('channels[1].reading', 'channels[1]'),
        f'topic /press/state: field channels of acme_msgs/msg/Press is a message: {NUMBERS}',
    ),
    'an array': (
        ('channels[1].reading', 'analog'),
        'topic /press/state: field analog of acme_msgs/msg/Press is an array: give an entry, such as analog[0]',
    ),
    'no array': (
        ('channels[1].reading', 't_us[0]'),
        f'topic /press/state: field t_us of acme_msgs/msg/Press is not an array: {NUMBERS}',
    ),
    'beyond a fixed array': (
        ('channels[1].reading', 'analog[4]'),
        'topic /press/state: the array analog of acme_msgs/msg/Press has 4 entries: the first is analog[0]',
    ),
    'beyond every sequence': (
        ('channels[1].reading', 'channels[2].reading'),
        'no message on topic /press/state has the field that the mapping gives',
    ),
    'by name without names': (
        ('channels[1].reading', 'channels[ram].reading'),
        'topic /press/state: the entries of channels in acme_msgs/msg/Press have no names: give a number, channels[0]',
    ),
    'unknown stamp': (
        ('stamp: t_us', 'stamp: t_ms'),
        f'topic /press/state: acme_msgs/msg/Press has no such field: {NUMBERS}',
    ),
}


@pytest.mark.parametrize(('change', 'message'), BAD_FOR_THE_BAG.values(), ids=BAD_FOR_THE_BAG.keys())
def test_a_mapping_that_does_not_fit_the_bag(press, change, message):
    with pytest.raises(InputError) as caught:
        read_recording(press / 'mcap', mapping=written(press, PRESS.replace(*change, 1)))
    assert str(caught.value) == f'{press}/mcap: {message}'


def test_an_unknown_type_is_named_and_what_to_do(press):
    with pytest.raises(InputError) as caught:
        read_recording(press / 'sqlite3', mapping=written(press, PRESS.replace('types: messages\n', '')))
    assert str(caught.value) == (
        f'{press}/sqlite3: topic /press/state has messages of type acme_msgs/msg/Press, which is unknown: '
        'in a mapping file give `types:`, the folder with its .msg files'
    )


def test_an_unknown_type_inside_another(press, tmp_path):
    package = write_press_types(tmp_path / 'messages') / 'acme_msgs' / 'msg'
    (package / 'Channel.msg').unlink()
    with pytest.raises(InputError) as caught:
        read_recording(press / 'sqlite3', mapping=written(tmp_path, PRESS))
    assert str(caught.value) == (
        f'{press}/sqlite3: topic /press/state has messages that hold another type (inside acme_msgs/msg/Press), '
        'which is unknown: in a mapping file give `types:`, the folder with its .msg files'
    )


def test_a_definition_that_is_none(press, tmp_path):
    package = write_press_types(tmp_path / 'messages') / 'acme_msgs' / 'msg'
    (package / 'Press.msg').write_text('float64 1st\n')
    with pytest.raises(
        InputError, match=rf'^.*: {package}/Press.msg is not a message definition: line 1 cannot be parsed$'
    ):
        read_recording(press / 'sqlite3', mapping=written(tmp_path, PRESS))


def test_a_definition_other_than_what_was_recorded(press, tmp_path):
    package = write_press_types(tmp_path / 'messages') / 'acme_msgs' / 'msg'
    (package / 'Channel.msg').write_text('string label\nfloat64 reading\nfloat64 mean\n')
    with pytest.raises(
        InputError, match=r'topic /press/state: a message .*: the bag is damaged, or acme_msgs/msg/Press'
    ):
        read_recording(press / 'sqlite3', mapping=written(tmp_path, PRESS))
