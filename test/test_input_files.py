# SPDX-License-Identifier: Apache-2.0
"""The door through which files come in, and that every reader uses it: no reader waits, or quotes."""

from __future__ import annotations

import errno
import os
import re
import shutil
import socket
import threading
from pathlib import Path

import pytest

from cfd_pneumatic.commands.csv_to_bag import main as csv_to_bag
from cfd_pneumatic.commands.force_on_path import main as force_on_path
from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.commands.leak_test import main as leak_test
from cfd_pneumatic.commands.plan_experiment import main as plan_experiment
from cfd_pneumatic.commands.record_rig import main as record_rig
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files.inputs import MOST_HOLES, open_input, read_input
from cfd_pneumatic.path import IdentifiedDevice

TABLE_1 = Path(__file__).parents[1] / 'config' / 'table_1.yaml'

MAPPING = """
types: types
displacement: {topic: /cfd/device/piston_state, unit: m}
cylinder_a: {pressure: {topic: /cfd/device/cylinder_a/pressure, unit: Pa, reference: absolute}}
"""
COLUMNS = """
table: {time: {column: 1, unit: s}}
cylinder_a: {pressure: {column: 2, unit: Pa, reference: absolute}}
"""


def make_socket(path):
    home = os.getcwd()
    os.chdir(path.parent)  # the name of a socket is short
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(home)


KINDS = {
    'a named pipe': os.mkfifo,
    'a device': lambda path: path.symlink_to('/dev/zero'),
    'a socket': make_socket,
    'a folder': lambda path: path.mkdir(),
}


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return a folder with a bag of each storage."""
    folder = tmp_path_factory.mktemp('bags')
    for storage in ('mcap', 'sqlite3'):
        assert record_rig(['paper_step', '--output', str(folder / storage), '--storage', storage]) == 0
    return folder


# the door


@pytest.mark.timeout(20)
@pytest.mark.parametrize('kind', KINDS)
def test_what_is_no_file_is_refused_by_its_name(tmp_path, kind):
    KINDS[kind](tmp_path / 'it')
    (tmp_path / 'link').symlink_to('it')
    for name in ('it', 'link'):
        with pytest.raises(InputError, match=f'^is {kind}, not a file$'):
            open_input(tmp_path / name)


@pytest.mark.parametrize(
    ('name', 'reason'),
    [('none', os.strerror(errno.ENOENT)), ('n' * 300, os.strerror(errno.ENAMETOOLONG)), ('a\0b', 'such a name')],
)
def test_what_can_not_be_opened_is_refused(tmp_path, name, reason):
    with pytest.raises(InputError, match=f'^cannot be read: .*{reason}'):
        open_input(tmp_path / name)


def test_links_without_an_end_are_refused(tmp_path):
    (tmp_path / 'one').symlink_to('other')
    (tmp_path / 'other').symlink_to('one')
    with pytest.raises(InputError, match=r'^cannot be read: '):
        open_input(tmp_path / 'one')


@pytest.mark.timeout(20)
def test_files_of_the_kernel_that_have_no_end_are_empty():
    for name in ('/proc/kmsg', '/proc/self/mem', '/proc/self/pagemap'):
        if os.access(name, os.R_OK):
            assert read_input(Path(name), 100) == b''


def test_no_more_is_read_than_there_was_when_the_file_was_opened(tmp_path):
    (tmp_path / 'log').write_bytes(b'one\ntwo\n')
    with open_input(tmp_path / 'log') as file:
        with (tmp_path / 'log').open('ab') as writer:
            writer.write(bytes(10**6))
        assert file.readline() == b'one\n'
        assert file.read() == b'two\n'
        assert file.seek(0, os.SEEK_END) == 8
        file.seek(4)
        assert file.read(100) == b'two\n'


def test_a_file_has_at_most_as_many_bytes_as_are_asked_for(tmp_path):
    (tmp_path / 'it').write_bytes(bytes(1024))
    assert read_input(tmp_path / 'it', 1024) == bytes(1024)
    (tmp_path / 'it').write_bytes(bytes(1025))
    with pytest.raises(InputError, match=r'^has more than 1 KiB$'):
        read_input(tmp_path / 'it', 1024)


@pytest.mark.timeout(20)
def test_a_file_of_holes_is_refused_and_a_large_one_is_not(tmp_path):
    (tmp_path / 'holes').touch()
    os.truncate(tmp_path / 'holes', 2**40)
    with pytest.raises(InputError, match=r'^has holes of more than 1 GiB: '):
        open_input(tmp_path / 'holes')
    with (tmp_path / 'some').open('wb') as file:
        file.write(b'begin')
        file.seek(MOST_HOLES // 2)
        file.write(b'middle')
        file.seek(MOST_HOLES)
        file.write(b'end')
    with open_input(tmp_path / 'some') as file:
        assert file.read(5) == b'begin'


@pytest.mark.timeout(60)
def test_a_name_that_another_file_takes_meanwhile_does_not_hang(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'file').write_bytes(b'content')
    (tmp_path / 'name').symlink_to('file')
    ended = threading.Event()

    def exchange():
        turn = 0
        while not ended.is_set():
            turn += 1
            (tmp_path / 'next').symlink_to('pipe' if turn % 2 else 'file')
            os.replace(tmp_path / 'next', tmp_path / 'name')

    exchanger = threading.Thread(target=exchange)
    exchanger.start()
    try:
        found = set()
        for _ in range(2000):
            try:
                found.add(read_input(tmp_path / 'name', 100))
            except InputError as error:
                found.add(str(error))
    finally:
        ended.set()
        exchanger.join()
    assert found <= {b'content', 'is a named pipe, not a file'}


# every reader


def identified(bag, *more):
    return identify_bag, [str(bag), '--output', 'out', *more]


def in_a_mapping(folder, bags):
    return folder / 'm.yaml', identified(bags / 'mcap', '--mapping', 'm.yaml')


def in_a_mapping_of_a_table(folder, bags):
    (folder / 't.csv').write_text('0 1\n')
    return folder / 'm.yaml', (csv_to_bag, ['t.csv', '--mapping', 'm.yaml', '--output', 'out'])


def as_a_table(folder, bags):
    (folder / 'm.yaml').write_text(COLUMNS)
    return folder / 't.csv', (csv_to_bag, ['t.csv', '--mapping', 'm.yaml', '--output', 'out'])


def as_a_file_of_a_bag(suffix):
    return lambda folder, bags: (folder / f'b{suffix}', (leak_test, [f'b{suffix}']))


def in_the_folder_of_a_bag(name, storage='mcap'):
    def role(folder, bags):
        shutil.copytree(bags / storage, folder / 'bag')
        (folder / 'bag' / name).unlink()
        return folder / 'bag' / name, identified('bag')

    return role


def without_metadata(folder, bags):
    (folder / 'bag').mkdir()
    return folder / 'bag' / 'x.mcap', identified('bag')


def named_by_metadata(compression):
    def role(folder, bags):
        shutil.copytree(bags / 'mcap', folder / 'bag')
        metadata = folder / 'bag' / 'metadata.yaml'
        text = metadata.read_text().replace('mcap.mcap', '../../other')
        assert 'other' in text
        metadata.write_text(text.replace("compression_mode: ''", f'compression_mode: {compression}'))
        if compression:
            metadata.write_text(metadata.read_text().replace("compression_format: ''", 'compression_format: zstd'))
            assert f'compression_mode: {compression}' in metadata.read_text()
        return folder / 'bag' / 'other', identified('bag')

    return role


def as_a_definition(folder, bags):
    (folder / 'm.yaml').write_text(MAPPING)
    (folder / 'types' / 'a' / 'msg').mkdir(parents=True)
    (folder / 'types' / 'a' / 'msg' / 'Whole.msg').write_text('float64 x\n')
    return folder / 'types' / 'a' / 'msg' / 'B.msg', identified(bags / 'mcap', '--mapping', 'm.yaml')


def as_parameters(folder, bags):
    return folder / 'p.yaml', (plan_experiment, ['p.yaml', '--output', 'out'])


def as_a_report(folder, bags):
    return folder / 'r.json', (plan_experiment, [str(TABLE_1), '--report', 'r.json', '--output', 'out'])


def as_a_schedule(folder, bags):
    return folder / 's.csv', (record_rig, ['s.csv', '--output', 'out'])


def as_a_path(folder, bags):
    return folder / 'surface.csv', force_of('surface.csv', TABLE_1)


def as_a_device(folder, bags):
    (folder / 'surface.csv').write_text('along_mm,error_mm\n0,0\n100,1\n')
    return folder / 'device.yaml', force_of('surface.csv', 'device.yaml')


def force_of(path, device):
    given = [path, '--device', str(device), '--force', '20N', '--feed', '50mm/s', '--output', 'out']
    return force_on_path, given


ROLES = {
    'a mapping': in_a_mapping,
    'the mapping of a table': in_a_mapping_of_a_table,
    'a table': as_a_table,
    **{f'a {suffix} file': as_a_file_of_a_bag(suffix) for suffix in ('.mcap', '.db3', '.bag', '')},
    'metadata.yaml': in_the_folder_of_a_bag('metadata.yaml'),
    'the mcap of a folder': in_the_folder_of_a_bag('mcap.mcap'),
    'the database of a folder': in_the_folder_of_a_bag('sqlite3.db3', 'sqlite3'),
    'an mcap without metadata': without_metadata,
    'what metadata name': named_by_metadata(''),
    'what metadata name as compressed': named_by_metadata('file'),
    'a definition': as_a_definition,
    'parameters': as_parameters,
    'a report': as_a_report,
    'a schedule': as_a_schedule,
    'a path': as_a_path,
    'a device': as_a_device,
}


MAY_BE_FOLDERS = ('a .mcap file', 'a .db3 file', 'a .bag file', 'a  file', 'a definition', 'a path', 'a device')


@pytest.mark.timeout(60)
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('role', ROLES)
def test_no_reader_waits_for_what_is_no_file(tmp_path, monkeypatch, capsys, bags, role, kind):
    monkeypatch.chdir(tmp_path)
    path, (program, arguments) = ROLES[role](tmp_path, bags)
    if kind == 'a folder' and role in MAY_BE_FOLDERS:
        pytest.skip('a folder may have any name')
    KINDS[kind](path)
    assert program(arguments) == 2
    told = capsys.readouterr().err
    assert told.count('\n') == 1
    assert f'{path.name}' in told
    assert f'is {kind}, not a file' in told
    assert not (tmp_path / 'out').exists()


@pytest.mark.timeout(60)
@pytest.mark.parametrize('name', ['sqlite3.db3-wal', 'sqlite3.db3-shm', 'sqlite3.db3-journal'])
def test_what_lies_beside_a_database_is_not_opened(tmp_path, capsys, bags, name):
    shutil.copytree(bags / 'sqlite3', tmp_path / 'bag')
    os.mkfifo(tmp_path / 'bag' / name)
    for path in (tmp_path / 'bag', tmp_path / 'bag' / 'sqlite3.db3'):
        assert leak_test([str(path)]) == 0
    assert capsys.readouterr().err == ''


@pytest.mark.timeout(60)
def test_a_report_that_is_a_pipe_beside_parameters_is_left_alone(tmp_path):
    shutil.copy(TABLE_1, tmp_path / 'parameters.yaml')
    os.mkfifo(tmp_path / 'report.json')
    assert Device.load(tmp_path / 'parameters.yaml').given
    assert IdentifiedDevice.load(tmp_path).covariances == {}


SECRET = 'Zq7Xk9wVb2LmR4tY'
TEXTS = {
    'a key': f'-----BEGIN OPENSSH PRIVATE KEY-----\n{SECRET}\n-----END OPENSSH PRIVATE KEY-----\n',
    'settings': f'{SECRET}: {SECRET}\n',
    'a list': f'- {SECRET}\n- {{{SECRET}: 1}}\n',
    'broken YAML': f'{SECRET}: [{SECRET}\n"{SECRET}: {SECRET}\n',
    'a YAML tag': f'!!python/object/apply:os.{SECRET} [{SECRET}]\n',
    'an anchor': f'a: *{SECRET}\n',
    'JSON': f'{{"{SECRET}": "{SECRET}", "version": "{SECRET}"}}\n',
    'a table': f'{SECRET},{SECRET}\n{SECRET},1\n',
    'a definition': f'float64 {SECRET}\n{SECRET}/{SECRET} x\nfloat64 x = {SECRET}\n',
    'metadata': f'rosbag2_bagfile_information: {{version: {SECRET}, relative_file_paths: [{SECRET}]}}\n',
    'a mapping': f'displacement: {{topic: {SECRET}, unit: {SECRET}, {SECRET}: 1}}\n',
    'a table that is mapped': f'table: {{time: {{column: {SECRET}, unit: {SECRET}}}, separator: {SECRET}}}\n',
    'parameters': f'/**: {{ros__parameters: {{area: {SECRET}, {SECRET}: 1.0, cylinder_a: {{k_x: {SECRET}}}}}}}\n',
    'a report': f'{{"cylinders": {{"cylinder_a": {{"{SECRET}": "{SECRET}"}}}}, "recordings": ["{SECRET}"]}}\n',
    'a schedule': f'time [s],displacement [mm]\n0.0,{SECRET}\n',
    'bytes': f'SQLite format 3\0{SECRET}' + f'{SECRET}\0' * 400,
    'an mcap': f'\x89MCAP0\r\n\x01{SECRET}{SECRET}',
    'a bag of ROS 1': f'#ROSBAG V2.0\n{SECRET}{SECRET}',
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize('text', TEXTS)
@pytest.mark.parametrize('role', ROLES)
def test_no_reader_quotes_a_file(tmp_path, monkeypatch, capsys, bags, role, text):
    """Of a table that the user names a cell may be quoted; nothing of any other file."""
    monkeypatch.chdir(tmp_path)
    path, (program, arguments) = ROLES[role](tmp_path, bags)
    path.write_text(TEXTS[text], encoding='latin-1')
    program(arguments)
    told = ''.join(capsys.readouterr())
    if role in ('a table', 'a schedule', 'a path'):
        assert all(len(cell) <= 40 for cell in re.findall('“(.*?)”', told))
        told = re.sub('“.*?”', '', told)
    pieces = {SECRET[at : at + 6] for at in range(len(SECRET) - 5)}
    assert [piece for piece in pieces if piece in told] == []
