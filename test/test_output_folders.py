# SPDX-License-Identifier: Apache-2.0
"""Folders of results that cannot be exchanged: mount points, parents that may not be written, folders of others."""

from __future__ import annotations

import importlib
import io
import os
import shutil
import struct
import subprocess
import sys
from contextlib import contextmanager, redirect_stderr, redirect_stdout

import pytest

from cfd_pneumatic.commands.record_rig import main as record_rig

AS_A_USER = 'setpriv', '--bounding-set=-dac_override,-dac_read_search,-fowner,-chown'
"""Takes from the administrator what users may not do."""

WRITES = {
    'identify_bag': ['parameters.yaml', 'report.json'],
    'plan_experiment': ['plan.html', 'plan.json', 'schedule.csv', 'schedule.svg'],
    'leak_test': ['leak.json', 'leak.svg'],
    'force_on_path': ['preview.json', 'preview.mcap', 'report.html', 'schedule.csv'],
    'record_rig': ['metadata.yaml', 'out.mcap'],
}
"""Programs that write a folder, and what they write into one that is called `out`."""

ACCESS_LIST = struct.pack('<I', 2) + b''.join(
    struct.pack('<HHi', *entry)
    for entry in ((0x01, 7, -1), (0x02, 5, 1234), (0x04, 5, -1), (0x10, 5, -1), (0x20, 5, -1))
)
"""Lets another user read a folder."""

each_program = pytest.mark.parametrize('program', WRITES)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'strokes'
    assert record_rig(['out_and_back', '--device', 'paper', '--output', str(path)]) == 0
    return path


@pytest.fixture(scope='module')
def arguments(bag, tmp_path_factory):
    """Return the arguments of each program, but for its output."""
    device = tmp_path_factory.mktemp('device')
    assert run('identify_bag', bag, '--output', device)[0] == 0
    surface = bag.with_name('surface.csv')
    surface.write_text('along_mm,error_mm\n0,0\n50,0.5\n100,0\n')
    return {
        'identify_bag': (bag,),
        'plan_experiment': (device / 'parameters.yaml', '--duration', '3', '--wanted', 'k_x', '--sample-rate', '50'),
        'leak_test': (bag,),
        'force_on_path': (surface, '--device', device, '--force', '20N', '--feed', '50mm/s'),
        'record_rig': ('out_and_back',),
    }


def run(program, *arguments):
    """Run a program, and return its exit code and what it prints."""
    main = importlib.import_module(f'cfd_pneumatic.commands.{program}').main
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = main([*map(str, arguments)])
    return code, out.getvalue(), err.getvalue()


def run_as_a_user(program, *arguments):
    """Run a program without what only an administrator may do."""
    if os.geteuid() != 0:
        return run(program, *arguments)
    if shutil.which(AS_A_USER[0]) is None or subprocess.run([*AS_A_USER, 'true'], check=False).returncode:
        pytest.skip('an administrator cannot give up rights here')
    command = [*AS_A_USER, sys.executable, '-m', f'cfd_pneumatic.commands.{program}', *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def write_twice(run, program, arguments, folder):
    """Run a program twice into a folder, the second time over its earlier results; nothing else is left there."""
    for again in ((), ('--overwrite',) if program == 'record_rig' else ()):
        code, _, err = run(program, *arguments[program], '--output', folder, *again)
        assert (code, err) == (0, '')
        assert sorted(os.listdir(folder)) == WRITES[program]


def assert_refused_before_the_work(done, program, folder, message):
    code, out, err = done
    assert err.startswith(f'{program}: error: cannot write {folder}: {message}')
    assert len(err.splitlines()) == 1
    assert (code, out) == (2, ''), 'nothing was read'


@contextmanager
def mounted(folder, *options):
    """Mount something at a folder, made if need be."""
    folder.mkdir(exist_ok=True)
    done = subprocess.run(['mount', *options, str(folder)], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f'nothing can be mounted here: {done.stderr.strip()}')
    try:
        yield folder
    finally:
        subprocess.run(['umount', str(folder)], check=True)


@contextmanager
def mount_of_kind(kind, folder):
    if kind == 'a file system of its own':
        with mounted(folder, '-t', 'tmpfs', 'tmpfs'):
            yield folder
    else:
        source = folder.with_name('source')
        source.mkdir()
        with mounted(folder, '--bind', str(source)):
            yield folder


@pytest.mark.parametrize('kind', ['a file system of its own', 'a folder of the same file system'])
@each_program
def test_results_are_written_into_a_mount_point(arguments, tmp_path, kind, program):
    with mount_of_kind(kind, tmp_path / 'out') as folder:
        write_twice(run, program, arguments, folder)
    assert set(os.listdir(tmp_path)) <= {'out', 'source'}
    assert os.listdir(tmp_path / 'out') == []


@pytest.mark.parametrize('program', ['identify_bag', 'record_rig'])  # files, and a bag: the others write as these do
def test_results_are_written_below_a_parent_that_may_not_be_written(arguments, tmp_path, program):
    folder = tmp_path / 'parent' / 'out'
    folder.mkdir(parents=True)
    folder.parent.chmod(0o555)
    try:
        write_twice(run_as_a_user, program, arguments, folder)
        for new in (folder.with_name('new'), folder.with_name('new') / 'deep'):
            done = run_as_a_user(program, *arguments[program], '--output', new)
            assert_refused_before_the_work(done, program, new, 'Permission denied; choose a folder')
    finally:
        folder.parent.chmod(0o755)
    assert os.listdir(folder.parent) == ['out']


def test_a_link_to_a_mount_point_stays_one(bag, tmp_path):
    with mount_of_kind('a file system of its own', tmp_path / 'volume') as volume:
        (tmp_path / 'out').symlink_to(volume)
        for _ in range(2):
            assert run('identify_bag', bag, '--output', tmp_path / 'out')[0] == 0
            assert sorted(os.listdir(volume)) == ['parameters.yaml', 'report.json']
        code, out, err = run('record_rig', 'out_and_back', '--output', tmp_path / 'out')
        assert (code, out) == (2, '')
        assert 'is a symbolic link, and a bag is not written through' in err
    assert (tmp_path / 'out').is_symlink()


def test_each_bag_s_results_are_written_into_a_mount_point_of_its_own(bag, tmp_path):
    pytest.importorskip('distributed')
    place = tmp_path / 'out' / bag.parent.name / bag.name
    place.parent.mkdir(parents=True)
    with mounted(place, '-t', 'tmpfs', 'tmpfs') as folder:
        for _ in range(2):
            os.utime(next(bag.glob('*.mcap')))  # it is another one now
            _, out, _ = run('identify_bag', bag, '--each', '--jobs', '1', '--output', tmp_path / 'out')
            assert out.startswith('1 bag of 1 device, 0 failed\n')
            assert sorted(os.listdir(folder)) == ['parameters.yaml', 'report.json', 'row.json']


@each_program
def test_a_mount_point_that_is_read_only_is_refused_before_the_work(arguments, tmp_path, program):
    with mounted(tmp_path / 'out', '-t', 'tmpfs', '-o', 'ro', 'tmpfs') as folder:
        done = run(program, *arguments[program], '--output', folder)
        assert_refused_before_the_work(done, program, folder, 'Read-only file system; choose a folder')


@each_program
def test_a_disk_that_is_full_is_refused_before_the_work(arguments, tmp_path, program):
    with mounted(tmp_path / 'disk', '-t', 'tmpfs', '-o', 'size=4k', 'tmpfs') as disk:
        (disk / 'full').write_bytes(bytes(4096))
        done = run(program, *arguments[program], '--output', disk / 'out')
        assert_refused_before_the_work(done, program, disk / 'out', 'No space left on device; make room')
        assert os.listdir(disk) == ['full']


def test_a_disk_that_fills_up_leaves_the_earlier_results_in_a_mount_point(bag, tmp_path):
    with mounted(tmp_path / 'out', '-t', 'tmpfs', '-o', 'size=200k', 'tmpfs') as folder:
        assert run('identify_bag', bag, '--output', folder)[0] == 0
        earlier = {path.name: path.read_bytes() for path in folder.iterdir()}
        code, _, err = run('identify_bag', bag, '--close-loop', '--output', folder)
        assert 'No space left on device; make room' in err
        assert code == 2
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == earlier


def test_a_disk_that_fills_up_is_reported_by_the_folder_that_was_named(bag, tmp_path):
    with mounted(tmp_path / 'disk', '-t', 'tmpfs', '-o', 'size=300k', 'tmpfs') as disk:
        code, _, err = run('identify_bag', bag, '--close-loop', '--output', disk / 'out')
        assert (code, err.count('\n')) == (2, 1)
        assert err.startswith(f'identify_bag: error: cannot write {disk / "out"}: No space left on device; make room')
        assert os.listdir(disk) == []


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_bag_for_which_a_disk_has_no_room_leaves_nothing(tmp_path, storage):
    codes = set()
    for size in (8, 16, 32, 64, 128, 512, 2048):
        with mounted(tmp_path / 'disk', '-t', 'tmpfs', '-o', f'size={size}k', 'tmpfs') as disk:
            code, _, err = run('record_rig', 'out_and_back', '--storage', storage, '--output', disk / 'out')
            codes.add(code)
            if code == 0:
                assert err == ''
                assert os.listdir(disk) == ['out']
                continue
            assert (code, err.count('\n')) == (2, 1)
            assert err.startswith(f'record_rig: error: cannot write {disk / "out"}: ')
            assert err.endswith('make room, or choose another folder\n')
            assert os.listdir(disk) == []
    assert codes == {0, 2}


@pytest.mark.parametrize('program', ['record_rig', 'identify_bag'])
def test_an_output_stream_that_is_full_is_reported_in_one_line(bag, tmp_path, program):
    given = ['surface_following', '--duration', '5'] if program == 'record_rig' else [str(bag)]
    command = [sys.executable, '-m', f'cfd_pneumatic.commands.{program}', *given, '--output', str(tmp_path / 'out')]
    with open('/dev/full', 'wb') as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    line = f'{program}: error: cannot write to the standard output: No space left on device\n'
    assert (done.returncode, done.stderr) == (2, line)


@pytest.mark.parametrize('name', ['system.posix_acl_access', 'system.posix_acl_default'])
def test_a_folder_keeps_its_access_control_list(bag, tmp_path, name):
    folder = tmp_path / 'out'
    folder.mkdir()
    try:
        os.setxattr(folder, name, ACCESS_LIST)
    except OSError:
        pytest.skip('this file system has no access control lists')
    assert folder.stat().st_mode & 0o777 == 0o755, 'as a new folder'
    for _ in range(2):
        assert run('identify_bag', bag, '--output', folder)[0] == 0
        assert os.getxattr(folder, name) == ACCESS_LIST


def test_a_folder_of_somebody_else_keeps_its_owner_and_rights(bag, tmp_path):
    folder = tmp_path / 'out'
    folder.mkdir()
    if os.geteuid() == 0:
        os.chown(folder, 1234, os.getegid())
    folder.chmod(0o2775)
    before = folder.stat()
    for _ in range(2):
        assert run_as_a_user('identify_bag', bag, '--output', folder)[0] == 0
        assert sorted(os.listdir(folder)) == ['parameters.yaml', 'report.json']
    for what in ('st_ino', 'st_uid', 'st_gid', 'st_mode'):
        assert getattr(folder.stat(), what) == getattr(before, what)


def test_another_user_s_file_in_a_sticky_folder_is_refused_before_the_work(bag, tmp_path):
    if os.geteuid() != 0:
        pytest.skip('only an administrator can give a file away')
    folder = tmp_path / 'out'
    folder.mkdir()
    (folder / 'report.json').touch()
    for path in (folder, folder / 'report.json'):
        os.chown(path, 1234, 1234)
    folder.chmod(0o1777)
    code, out, err = run_as_a_user('identify_bag', bag, '--output', folder, '--overwrite')
    assert err.startswith(f'identify_bag: error: {folder}/report.json is a mount point, immutable or another user')
    assert (code, out) == (2, '')


def test_a_result_that_is_a_mount_of_a_file_beside_it_is_refused_before_the_work(bag, tmp_path):
    """Such a mount is of the same file system, and an exchange of the folder would take it along."""
    folder, source = tmp_path / 'o u t', tmp_path / 'source.json'
    assert run('identify_bag', bag, '--output', folder)[0] == 0
    source.write_bytes((folder / 'report.json').read_bytes())
    done = subprocess.run(['mount', '--bind', source, folder / 'report.json'], check=False, capture_output=True)
    if done.returncode:
        pytest.skip('nothing can be mounted here')
    try:
        code, out, err = run('identify_bag', bag, '--output', folder, '--overwrite')
    finally:
        subprocess.run(['umount', folder / 'report.json'], check=True)
    assert err.startswith(f'identify_bag: error: {folder}/report.json is a mount point, immutable or another user')
    assert (code, out) == (2, '')
    assert sorted(os.listdir(tmp_path)) == ['o u t', 'source.json']
