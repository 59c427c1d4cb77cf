# SPDX-License-Identifier: Apache-2.0
"""Code that is kept for the next start: whole files only, and only from folders to which nobody else can write."""

from __future__ import annotations

import grp
import os
import pickle
import pwd
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cfd_pneumatic.runtime import code_files

STRANGER = 12345  # a user and a group that are not the tests'
CODE = bytes(range(256)) * 40


@pytest.fixture(autouse=True)
def _unwarned(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(code_files, '_warned', set())
    yield
    code_files.is_trusted.cache_clear()


def skip_without_strangers(kind: str) -> None:
    if 'another' in kind and os.geteuid() != 0:
        pytest.skip('only root can give something away')


def flip_a_bit(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def put_a_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def put_a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def put_a_link(file: Path) -> None:
    file.rename(file.with_name('moved'))
    file.symlink_to(file.with_name('moved'))


DAMAGES: dict[str, Callable[[Path], object]] = {
    'empty': lambda file: file.write_bytes(b''),
    'zeros': lambda file: file.write_bytes(bytes(len(CODE))),
    'one byte': lambda file: file.write_bytes(b'\0'),
    'half': lambda file: file.write_bytes(file.read_bytes()[: len(CODE) // 2]),
    'longer': lambda file: file.write_bytes(file.read_bytes() + b'\0'),
    'a hole of a terabyte': lambda file: os.truncate(file, 2**40),
    'garbage': lambda file: file.write_bytes(os.urandom(5000)),
    'pickle of nothing': lambda file: file.write_bytes(pickle.dumps(None)),
    'a bit': flip_a_bit,
    'a folder': put_a_folder,
    'a pipe': put_a_pipe,
    'a link': put_a_link,
    'all can write to it': lambda file: file.chmod(0o666),
    "another user's": lambda file: os.chown(file, STRANGER, -1),
    "another group's": lambda file: (os.chown(file, -1, STRANGER), file.chmod(0o664)),
}


@pytest.mark.parametrize('damage', [*DAMAGES])
def test_a_damaged_file_is_not_read_and_can_be_written_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: str
) -> None:
    skip_without_strangers(damage)
    file, other = tmp_path / 'code', tmp_path / 'other'
    for each in (file, other):
        code_files.write(each, CODE)
        assert code_files.read(each) == CODE
        DAMAGES[damage](each)
    assert [code_files.read(each) for each in (file, other)] == [None] * 2
    (record,) = caplog.records
    assert record.message.startswith(f'The cache {tmp_path} is damaged: ')
    assert str(file) in record.message
    code_files.write(file, CODE)
    assert code_files.read(file) == CODE


def test_of_processes_that_work_together_one_warns(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ('one', 'one', 'not there'):
        monkeypatch.setenv(code_files.WARNED_FOLDER, str(tmp_path / folder))
        (tmp_path / 'one').mkdir(exist_ok=True)
        monkeypatch.setattr(code_files, '_warned', set())  # as in another process
        for _ in range(2):
            code_files.warn_once('kind', folder)
        assert code_files.has_warned('kind')
    assert [record.message for record in caplog.records] == ['one', 'not there']


def test_a_file_that_is_not_there_is_not_damaged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert code_files.read(tmp_path / 'code') is None
    assert not caplog.records


def test_a_folder_with_something_in_it_is_left_where_a_file_belongs(tmp_path: Path) -> None:
    inside = tmp_path / 'code' / 'inside'
    inside.parent.mkdir()
    inside.touch()
    with pytest.raises(OSError, match='not empty'):
        code_files.write(inside.parent, CODE)
    assert [one.name for one in tmp_path.iterdir()] == ['code']
    assert inside.exists()


def give_access(folder: Path) -> None:
    """Let another user write to a folder by an access control list, of which the mode tells the group's bit only."""
    entries = [(0x01, 7, -1), (0x02, 7, STRANGER), (0x04, 5, -1), (0x10, 7, -1), (0x20, 5, -1)]
    packed = b''.join(struct.pack('<HHi', *entry) for entry in entries)
    try:
        os.setxattr(folder, 'system.posix_acl_access', struct.pack('<I', 2) + packed)
    except OSError:
        pytest.skip('this file system has no access control lists')


STRANGERS: dict[str, Callable[[Path], object]] = {
    'all can write to it': lambda folder: folder.chmod(0o777),
    'all can write to it, sticky': lambda folder: folder.chmod(0o1777),
    'all can write to the one above, sticky': lambda folder: folder.parent.chmod(0o1777),
    'all can write to one above': lambda folder: folder.parents[1].chmod(0o777),
    "another user's": lambda folder: os.chown(folder, STRANGER, -1),
    "below another user's": lambda folder: os.chown(folder.parents[1], STRANGER, -1),
    "another group's": lambda folder: (os.chown(folder, -1, STRANGER), folder.chmod(0o775)),
    'an access control list': give_access,
    "below another group's": lambda folder: (os.chown(folder.parents[1], -1, STRANGER), folder.parents[1].chmod(0o775)),
}


@pytest.mark.parametrize('stranger', [*STRANGERS])
def test_a_folder_to_which_others_can_write_is_not_trusted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, stranger: str
) -> None:
    skip_without_strangers(stranger)
    folder = tmp_path / 'top' / 'above' / 'cache'
    folder.mkdir(parents=True)
    link = tmp_path / 'link'
    link.symlink_to(folder)
    STRANGERS[stranger](folder)
    assert [code_files.is_trusted(one) for one in (folder, link)] == [False, False]
    (record,) = caplog.records
    assert record.message.startswith(f'The cache {folder} is not used: ')
    assert str(tmp_path / 'top') in record.message.partition(': ')[2]
    assert 'NUMBA_CACHE_DIR' in record.message


def test_a_folder_of_the_user_alone_is_trusted_below_a_sticky_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / 'shared' / 'mine' / 'cache'
    folder.mkdir(parents=True)
    folder.parents[1].chmod(0o1777)
    assert code_files.is_trusted(folder)
    assert not caplog.records


def test_the_user_s_own_group_may_write_to_a_folder(tmp_path: Path) -> None:
    if grp.getgrgid(os.getegid()).gr_name != pwd.getpwuid(os.geteuid()).pw_name:
        pytest.skip('this user has no group of its own')
    tmp_path.chmod(0o775)
    assert code_files.is_trusted(tmp_path)


def test_beside_source_code_only_the_folder_itself_counts(tmp_path: Path) -> None:
    cache = tmp_path / 'package' / '__pycache__'
    cache.mkdir(parents=True)
    cache.parent.chmod(0o777)
    assert code_files.is_trusted(cache)
    code_files.is_trusted.cache_clear()
    cache.chmod(0o777)
    assert not code_files.is_trusted(cache)


def test_a_folder_and_a_file_that_are_made_are_the_user_s_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = tmp_path / 'new' / 'cache'
        code_files.make_folder(folder)
        code_files.write(folder / 'code', CODE)
    finally:
        os.umask(before)
    assert code_files.is_trusted(folder)
    assert code_files.read(folder / 'code') == CODE
