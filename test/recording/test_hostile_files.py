# SPDX-License-Identifier: Apache-2.0
"""Files made to harm: each ends in one line within seconds, whatever it declares; what is odd but valid is read."""

from __future__ import annotations

import os
import re
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from patience import allowed
from recording_cases import EPOCH, SECOND, messages, plain_messages, recording, setpoint, write_bag
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.convention import FLUID_PRESSURE, JOINT_STATE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files.yaml_files import LARGEST, read_yaml
from cfd_pneumatic.planning.planned_device import read_report
from cfd_pneumatic.recording import read_mapping, read_recording, write_recording
from cfd_pneumatic.recording.bags.mcap_pieces import CHUNK, HEAD

GOOD = """
table:
  time: {column: time, unit: ms}
  delimiter: comma
  header_rows: 1
displacement: {column: x, unit: m}
cylinder_a:
  pressure: {column: p, unit: bar, reference: gauge}
"""


def refused(read, *given):
    """Return the line that a file is refused with."""
    with pytest.raises(InputError) as caught:
        read(*given)
    assert '\n' not in str(caught.value)
    return str(caught.value)


# YAML: mappings and parameter files


def unfolding(levels, form='&a{0} [{1}]'):
    """Return lists of ten aliases of lists of ten aliases ..."""
    lines = ['- &a0 [x, x, x, x, x, x, x, x, x, x]']
    for level in range(1, levels):
        lines.append('- ' + form.format(level, ', '.join([f'*a{level - 1}'] * 10)))
    return '\n'.join(lines)


def merging(keys, mappings):
    """Return mappings that each merge the one before and add keys."""
    lines = ['- &m0 {k: 1}']
    for which in range(1, mappings):
        added = ', '.join(f'k{which}_{key}: 1' for key in range(keys))
        lines.append(f'- &m{which} {{<<: *m{which - 1}, {added}}}')
    return '\n'.join(lines)


YAML = {
    'an alias bomb': (unfolding(9), 'unfolds to more than'),
    'merges of merges': (merging(50, 400), 'unfolds to more than'),
    'a list that holds itself': ('&a [*a]', 'unfolds to more than'),
    'deep lists': ('[' * 10_000, 'is nested too deeply'),
    'deep mappings': ('{a: ' * 5_000, 'is nested too deeply'),
    'a date that is none': ('y: 1\nx: 2001-99-99', 'line 2: holds a value that cannot be read'),
    'a number without digits': ('x: 0b_', 'holds a value that cannot be read'),
    'a number of thousands of digits': (f'x: {"1" * 5000}', 'holds a value that cannot be read'),
    'the same in hexadecimal digits': (f'x: 0x{"f" * 5000}', 'line 1: a number is too large'),
    'a number longer than a processor has': (f'y:\n  x: {2**63}', 'line 2: a number is too large'),
    'a time that is none': ('x: 2001-01-01 99:99:99', 'holds a value that cannot be read'),
    'too large': (f'x: {"y" * LARGEST}', 'has more than 256 KiB'),
    'a key twice': ('x: 1\ny: 2\nx: 3', 'line 3: the key is already in line 1'),
    'more values than can be meant': ('[' + '1,' * 60_000 + ']', 'has more than 50,000 values'),
    'a switch that is none': ('x: !!bool secret', 'line 1: holds a value that cannot be read'),
    'code': ('!!python/object/apply:os.getcwd []', 'is not YAML'),
    'bytes that are no text': (b'x: \xff\xfe', 'is not YAML'),
}


@pytest.mark.parametrize('kind', YAML)
def test_yaml_that_would_harm_is_refused(tmp_path, kind):
    content, reason = YAML[kind]
    path = tmp_path / 'made.yaml'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    line = refused(read_yaml, path)
    assert line.startswith(str(path))
    assert reason in line


def test_yaml_may_use_aliases_and_begin_with_a_byte_order_mark(tmp_path):
    path = tmp_path / 'made.yaml'
    path.write_bytes(b'\xef\xbb\xbfa: &a {unit: psi}\nb: {<<: *a, column: 2}\n')
    assert read_yaml(path) == {'a': {'unit': 'psi'}, 'b': {'unit': 'psi', 'column': 2}}


ODD_NUMBERS = {
    'header_rows: 1': 'header_rows: 10000000000000000000',
    'unit: m}': 'unit: m, time_offset: 1.0e+300}',
    'unit: bar': 'unit: bar, scale: 1e300',
    'column: x': 'column: -0',
    'delimiter: comma': 'types: ' + 5_000 * 'a',
    'displacement': '? [1, 2]\n: x\ndisplacement',
    '{column: p, unit: bar, reference: gauge}': '[1, 2]',
}


@pytest.mark.parametrize('entry', ODD_NUMBERS)
def test_a_mapping_with_a_value_that_cannot_be_is_refused(tmp_path, entry):
    path = tmp_path / 'made.yaml'
    path.write_text(GOOD.replace(entry, ODD_NUMBERS[entry], 1), encoding='utf-8')
    assert refused(read_mapping, path).startswith(str(path))


@pytest.mark.parametrize('index', ['²', '٣', '99999999999999999999', '-1', '0x1'])
def test_an_entry_that_is_no_number_is_a_name(tmp_path, index):
    mapping = tmp_path / 'made.yaml'
    text = (
        f'displacement: {{topic: /cfd/device/piston_state, unit: m, field: "position[{index}]"}}\n'
        'cylinder_a: {pressure: {topic: /cfd/device/cylinder_a/pressure, unit: Pa, reference: absolute}}\n'
    )
    mapping.write_text(text, encoding='utf-8')
    bag = write_mcap(tmp_path / 'made.mcap', plain_messages())
    told = refused(lambda: read_recording(bag, mapping=read_mapping(mapping)))
    assert told.endswith('has the field that the mapping gives; the names are “piston”')


# mcap: definitions, chunks, files without what most have


def write_mcap(path, contents, definitions=None, **options):
    """Write messages as an mcap file of the format's own library."""
    types = messages.standard_types()
    writer = Writer(str(path), **options)
    writer.start('ros2')
    channels = {}
    for message in sorted(contents, key=lambda one: one.time):
        if message.topic not in channels:
            text = (definitions or {}).get(message.msgtype) or types.generate_msgdef(message.msgtype, ros_version=2)[0]
            schema = writer.register_schema(message.msgtype, 'ros2msg', text.encode())
            channels[message.topic] = writer.register_channel(message.topic, 'cdr', schema)
        payload = bytes(types.serialize_cdr(message.content, message.msgtype))
        writer.add_message(channels[message.topic], message.time, payload, message.time)
    writer.finish()
    return path


def inside(levels, width=2):
    """Return a definition that unfolds to very many fields."""
    parts = ['a/L0 one']
    for level in range(levels):
        fields = '\n'.join(f'a/L{level + 1} f{index}' for index in range(width))
        parts.append(f'MSG: a/L{level}\n{fields}')
    parts.append(f'MSG: a/L{levels}\nfloat64 x')
    return f'\n{"=" * 80}\n'.join(parts)


DEFINITIONS = {
    'a list of two thousand million': f'geometry_msgs/Vector3[2000000000] v\n{"=" * 80}\n'
    'MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z',
    'numbers, two thousand million': 'float64[2000000000] v',
    'a list of fewer than no entries': 'float64[-3] v',
    'a length of hundreds of digits': f'float64[{"9" * 500}] v',
    'texts, two thousand million': 'string[2000000000] v',
    'what unfolds': inside(40),
    'what is deep': inside(5_000, width=1),
    'itself': f'a/Self one\n{"=" * 80}\nMSG: a/Self\na/Self again\nfloat64 x',
    'what is unknown': 'a/Unknown one',
    'a default that is no number': 'float64 fluid_pressure 1e999',
    'a default of thousands of digits': f'int64 x 0x{"f" * 5000}',
    'no definition': 'float64 float64 float64 [',
    'megabytes': '\n'.join(f'float64 x{index}' for index in range(150_000)),
}


@pytest.mark.parametrize('kind', DEFINITIONS)
def test_a_definition_that_would_harm_is_refused(tmp_path, kind):
    path = write_mcap(tmp_path / 'made.mcap', plain_messages(), {'sensor_msgs/msg/FluidPressure': DEFINITIONS[kind]})
    assert refused(read_recording, path).startswith(f'{path}: ')


def lying(path, packed, compression, declared):
    """Write an mcap file of one chunk that unpacks to something else than it declares."""
    write_mcap(path, plain_messages(), compression=CompressionType.NONE)
    content = path.read_bytes()
    place = content.index(b'\x06', 8)
    opcode, length = HEAD.unpack_from(content, place)
    while opcode != 6:
        place += HEAD.size + length
        opcode, length = HEAD.unpack_from(content, place)
    start, stop, _, _, _ = CHUNK.unpack_from(content, place + HEAD.size)
    name = compression.encode()
    chunk = CHUNK.pack(start, stop, declared, 0, len(name)) + name + struct.pack('<Q', len(packed)) + packed
    path.write_bytes(content[:place] + HEAD.pack(6, len(chunk)) + chunk)
    return path


def bomb(compression, size=2**30):
    """Return a gigabyte of zeros, packed."""
    part = bytes(2**20)
    if compression == 'zstd':
        packer = zstandard.ZstdCompressor().compressobj()
        return b''.join([*(packer.compress(part) for _ in range(size // len(part))), packer.flush()])
    with lz4.frame.LZ4FrameCompressor() as packer:
        return b''.join([packer.begin(), *(packer.compress(part) for _ in range(size // len(part))), packer.flush()])


MEASURE = """
import resource, sys
from cfd_pneumatic.commands.identify_bag import main
resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[1:]:
    code = main([path, '--output', 'out'])
    print('measured', code, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, path)
"""


def test_a_chunk_unpacks_to_no_more_than_it_declares_and_can_hold(tmp_path):
    paths = []
    for compression in ('zstd', 'lz4'):
        packed = bomb(compression)
        for declared in (100, 2**30, 2**40, 2**63):
            paths.append(lying(tmp_path / f'{compression}_{declared}.mcap', packed, compression, declared))
    command = [sys.executable, '-c', MEASURE, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=allowed(240), check=True, cwd=tmp_path)
    lines = [line.split() for line in done.stdout.splitlines() if line.startswith('measured ')]
    assert [path for _, _, _, path in lines] == list(map(str, paths))
    assert done.stderr.count('\n') == len(paths)
    for path, (_, code, kibibytes, _) in zip(paths, lines):
        assert code == '2', path
        assert int(kibibytes) < 400 * 1024 + 300 * path.stat().st_size // 1024, path


def test_a_chunk_that_packs_well_is_read(tmp_path):
    """A thousand equal messages pack a hundredfold and more."""
    bag = write_mcap(tmp_path / 'made.mcap', plain_messages(20_000), compression=CompressionType.ZSTD)
    assert len(read_recording(bag).displacement) == 20_000


@pytest.mark.parametrize('statistics', [True, False])
@pytest.mark.parametrize('left_out', [{}, {'repeat_schemas': False}, {'repeat_channels': False}], ids=str)
@pytest.mark.parametrize('index', [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE])
@pytest.mark.parametrize('chunks', [True, False])
def test_what_a_file_may_leave_out_is_done_without(tmp_path, statistics, left_out, index, chunks):
    options = {'use_statistics': statistics, 'index_types': index, 'use_chunking': chunks, **left_out}
    bag = write_mcap(tmp_path / 'made.mcap', plain_messages(500), **options)
    read = read_recording(bag)
    assert read.health == ()
    assert read.displacement.values == pytest.approx(1e-4 * np.arange(500))
    assert read.displacement.times == pytest.approx(np.arange(500) / 100.0)


def test_a_summary_without_statistics_does_not_hide_a_topic(tmp_path):
    later = plain_messages(20, EPOCH + SECOND)
    bag = write_mcap(tmp_path / 'made.mcap', [*plain_messages(20), *later], use_statistics=False, chunk_size=100)
    assert len(read_recording(bag).displacement) == 40


@pytest.mark.parametrize('count', ['0', '-1', '1000000000000', '1' * 400, 'x', 'null', '0.0'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_metadata_says_of_messages_is_not_believed(tmp_path, storage, count):
    bag = write_bag(tmp_path / 'bag', plain_messages(20), storage=storage, compression=CompressionMode.MESSAGE)
    metadata = bag / 'metadata.yaml'
    before = metadata.read_text()
    metadata.write_text(re.sub(r'(topic_metadata:(?:.*\n)+?.*message_count:) 20', rf'\1 {count}', before))
    assert metadata.read_text() != before
    assert len(read_recording(bag).displacement) == 20


@pytest.mark.parametrize('column', ['name', 'type'])
def test_a_topic_whose_name_or_type_is_no_text_is_refused_or_left_out(tmp_path, column):
    contents = [*plain_messages(20), setpoint(1e4, EPOCH)]
    file = write_bag(tmp_path / 'bag', contents, storage='sqlite3') / 'bag.db3'
    change = f"UPDATE topics SET {column} = x'2f61' WHERE topics.name LIKE ?"
    with closing(sqlite3.connect(file)) as database, database:
        database.execute(change, ['%/setpoint'])
    assert len(read_recording(file).displacement) == 20
    with closing(sqlite3.connect(file)) as database, database:
        database.execute(change, ['%/pressure'])
    assert 'pressure' in refused(read_recording, file)


# sqlite3

COMPUTED = {
    'rows without end': [
        'ALTER TABLE messages RENAME TO stored',
        'CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n) '
        'SELECT i AS id, 1 AS topic_id, i AS timestamp, (SELECT data FROM stored LIMIT 1) AS data FROM n',
    ],
    'payloads of any size': [
        'ALTER TABLE messages RENAME COLUMN data TO stored',
        'ALTER TABLE messages ADD COLUMN data GENERATED ALWAYS AS (zeroblob(900000000))',
    ],
}


@pytest.mark.parametrize('kind', COMPUTED)
@pytest.mark.parametrize('part', [1.0, 0.95])
def test_a_database_that_computes_its_messages_is_refused(tmp_path, kind, part):
    write_recording(tmp_path / 'bag', recording(5_000), storage='sqlite3')
    file = tmp_path / 'bag' / 'bag.db3'
    with closing(sqlite3.connect(file)) as database:
        for statement in COMPUTED[kind]:
            database.execute(statement)
    os.truncate(file, int(part * file.stat().st_size))
    assert (
        refused(read_recording, file)
        == f'{file}: is not a bag: messages is an SQL view or has generated columns; export it as a table'
    )


def test_a_bag_of_ros_1_without_a_first_line_is_refused(tmp_path):
    (tmp_path / 'zeros.bag').touch()
    os.truncate(tmp_path / 'zeros.bag', 2**28)
    assert 'is not a bag of ROS 1' in refused(read_recording, tmp_path / 'zeros.bag')


# Names and tables


def test_a_file_whose_name_is_no_text_is_identified_or_refused_in_a_line(tmp_path):
    path = os.fsencode(tmp_path) + b'/\xff\xfe.mcap'
    os.replace(write_mcap(tmp_path / 'made.mcap', plain_messages(20)), path)
    done = subprocess.run(
        [sys.executable, '-m', 'cfd_pneumatic.commands.identify_bag', path, '--output', tmp_path / 'out'],
        capture_output=True,
        timeout=allowed(),
        check=False,
    )
    assert done.returncode in (0, 2)
    assert b'Traceback' not in done.stderr


# bags that are compressed as a whole, or message by message


BOMB = bytes(100 * 2**20)
"""Packed it is a few kilobytes."""


def write_packed(writer, types, content):
    """Write two messages, of the topics that a recording needs."""
    with writer:
        for topic, msgtype in (('piston_state', JOINT_STATE), ('cylinder_a/pressure', FLUID_PRESSURE)):
            connection = writer.add_connection(f'/cfd/device/{topic}', msgtype, typestore=types)
            writer.write(connection, EPOCH, content)


@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('content', [b'', BOMB], ids=['small', 'bomb'])
def test_no_more_is_unpacked_than_can_be_meant(tmp_path, mode, content):
    writer = Ros2Writer(tmp_path / 'bag', version=9)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    write_packed(writer, messages.standard_types(), b'\0\1\0\0' + content)
    told = refused(read_recording, tmp_path / 'bag')
    assert ('unpacks to more data than a recording can hold' in told) == bool(content)


@pytest.mark.parametrize('compression', [Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4])
def test_no_more_of_a_chunk_of_ros_1_is_unpacked_than_can_be_meant(tmp_path, compression):
    writer = Ros1Writer(tmp_path / 'bomb.bag')
    writer.set_compression(compression)
    write_packed(writer, get_typestore(Stores.ROS1_NOETIC), BOMB)
    assert 'unpacks to more data than a recording can hold' in refused(read_recording, tmp_path / 'bomb.bag')


# reports


ENDLESS = (
    '{"cylinders": {"cylinder_a": {"noise_floor_pa": 1e999}}, '
    '"recordings": [{"displacement_samples": 9, "duration_s": 1, "travel_m": [0, 1]}]}'
)


@pytest.mark.parametrize('content', ['[' * 200_000, '{"a": ' * 200_000, '1', '{}', ENDLESS])
def test_a_report_that_is_none_is_refused(tmp_path, content):
    (tmp_path / 'report.json').write_text(content)
    assert 'is not a report of identify_bag' in refused(read_report, tmp_path / 'report.json')


# names


def test_no_name_is_more_than_a_line_or_moves_the_cursor(tmp_path, capsys):
    """A topic, a field and a folder may have any name."""
    folder = tmp_path / 'one\ntwo\x1b[31m[red]'
    assert record_rig(['paper_step', '--output', str(folder)]) == 0
    capsys.readouterr()
    assert identify_bag([str(folder), '--close-loop', '--output', str(tmp_path / 'out')]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(r'one two\x1b[31m[red]:' + '\n')
    assert '\x1b' not in shown
    assert identify_bag([str(tmp_path / 'none\n\x1b[31m'), '--output', str(tmp_path / 'out')]) == 2
    assert capsys.readouterr().err.endswith(r'none \x1b[31m: does not exist: give the path of a recording' + '\n')
