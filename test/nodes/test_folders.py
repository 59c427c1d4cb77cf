# SPDX-License-Identifier: Apache-2.0
"""What a node reads and writes for others lies below the folders that it was started with."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.folders import Folders


@pytest.fixture(params=['allowed', '.allowed'])
def allowed(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a folder that may be read, perhaps a hidden one, with a bag and links to a secret beside the folder."""
    root = tmp_path / request.param
    (root / 'bag' / 'inner').mkdir(parents=True)
    (root / 'bag' / 'data.mcap').touch()
    (tmp_path / 'secret').touch()
    return root


@pytest.mark.parametrize('path', ['.', 'bag', 'bag/inner/..', 'bag/data.mcap', 'bag/../bag/./data.mcap'])
def test_what_is_below_is_read_by_any_path(allowed: Path, path: str) -> None:
    Folders([str(allowed)], '').check_readable(f'{allowed}/{path}')


@pytest.mark.parametrize('path', ['.', 'bag', 'bag/inner/..', 'bag/inner/../../bag'])
@pytest.mark.parametrize('link', ['link.mcap', 'inner/link.mcap'])
def test_no_link_leads_out_by_any_path(allowed: Path, path: str, link: str) -> None:
    (allowed / 'bag' / link).symlink_to(allowed.parent / 'secret')
    with pytest.raises(InputError, match='a link that leads out'):
        Folders([str(allowed)], '').check_readable(f'{allowed}/{path}')


def test_files_that_belong_to_a_file_are_checked_with_it(allowed: Path) -> None:
    (allowed / 'bag' / 'data.mcap-wal').symlink_to(allowed.parent / 'secret')
    with pytest.raises(InputError, match='a link that leads out'):
        Folders([str(allowed)], '').check_readable(f'{allowed}/bag/data.mcap')


@pytest.mark.parametrize('name', ['.hidden', '.hidden/data.mcap', 'link'])
def test_what_is_hidden_is_not_read(allowed: Path, name: str) -> None:
    (allowed / '.hidden').mkdir()
    (allowed / '.hidden' / 'data.mcap').touch()
    (allowed / 'link').symlink_to('.hidden/data.mcap')
    with pytest.raises(InputError, match='is hidden or outside'):
        Folders([str(allowed)], '').check_readable(f'{allowed}/{name}')


def test_many_hidden_files_hide_no_link(allowed: Path) -> None:
    for number in range(1001):
        (allowed / 'bag' / f'.{number}').touch()
    (allowed / 'bag' / 'link.mcap').symlink_to(allowed.parent / 'secret')
    with pytest.raises(InputError, match='more than 1,000 files'):
        Folders([str(allowed)], '').check_readable(f'{allowed}/bag')


@pytest.mark.parametrize('path', ['/', '/proc/self/environ', '/dev/zero', '~', 'x' * 5000, 'null\0character'])
def test_a_path_elsewhere_is_refused_in_words_of_its_own(allowed: Path, path: str) -> None:
    folders = Folders([str(allowed)], str(allowed))
    for check in (folders.check_readable, folders.check_writable):
        with pytest.raises(InputError, match=r'is hidden or outside|cannot be used as a path'):
            check(path)


def test_a_pipe_is_not_read(allowed: Path) -> None:
    os.mkfifo(allowed / 'bag' / 'pipe')
    with pytest.raises(InputError, match='holds a pipe'):
        Folders([str(allowed)], '').check_readable(f'{allowed}/bag')


@pytest.mark.parametrize('path', ['out', 'bag/../out', 'out/not/yet/there'])
def test_a_folder_below_the_output_folder_is_written(allowed: Path, path: str) -> None:
    Folders([], str(allowed)).check_writable(f'{allowed}/{path}')


@pytest.mark.parametrize('path', ['', '.', '..', 'bag/..', '.hidden', 'link/out'])
def test_nothing_is_written_elsewhere(allowed: Path, path: str) -> None:
    (allowed / 'link').symlink_to(allowed.parent)
    with pytest.raises(InputError, match=r'outside output_folder|is output_folder itself'):
        Folders([], str(allowed)).check_writable(f'{allowed}/{path}')


def test_the_home_folder_is_no_default(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.chdir(tmp_path)
    folders = Folders([], '')
    assert folders.missing == ['input_folders', 'output_folder']
    with pytest.raises(InputError, match="'input_folders' is not given"):
        folders.check_readable(str(tmp_path))
    for folder in (tmp_path, tmp_path.parent, Path('/')):
        with pytest.raises(InputError, match='is the home folder or above it'):
            Folders([str(folder)], '')
    (tmp_path / 'bags').mkdir()
    monkeypatch.chdir(tmp_path / 'bags')
    assert Folders([], '').missing == []
