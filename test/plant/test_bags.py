# SPDX-License-Identifier: Apache-2.0
"""Which bags are meant, whose they are, and where their results go."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.plant import find_bags

RESULTS = Path('results')


def touch(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def found(folder: Path, *given: str, tables: bool = False) -> dict[str, str]:
    """Return the devices of the bags that are found, by their paths below a folder."""
    bags = find_bags([folder / one for one in given or ['']], folder / RESULTS, tables=tables)
    return {bag.path.relative_to(folder).as_posix(): bag.device for bag in bags}


def test_bags_of_all_kinds_at_any_depth(tmp_path):
    touch(tmp_path, 'cell_1/a.mcap', 'cell_1/b.db3', 'cell_2/c.bag', 'line/cell_3/d/metadata.yaml', 'cell_2/notes.txt')
    assert found(tmp_path) == {
        'cell_1/a.mcap': 'cell_1',
        'cell_1/b.db3': 'cell_1',
        'cell_2/c.bag': 'cell_2',
        'line/cell_3/d': 'line/cell_3',
    }


def test_the_files_of_a_split_bag_are_one(tmp_path):
    touch(tmp_path, 'cell/shift/metadata.yaml', 'cell/shift/shift_0.mcap', 'cell/shift/shift_1.mcap')
    touch(tmp_path, 'cell/lost/lost_0.db3', 'cell/lost/lost_1.db3', 'cell/lost/lost_1.db3-wal')
    assert found(tmp_path) == {'cell/lost': 'cell', 'cell/shift': 'cell'}


@pytest.mark.parametrize('names', [['shift_0', 'shift_1'], ['cell_1', 'cell_2'], ['cell_0', 'cell_2'], ['cell']])
def test_numbered_shifts_of_a_device_are_many(tmp_path, names):
    touch(tmp_path, *(f'cell/{name}.mcap' for name in names))
    assert list(found(tmp_path)) == [f'cell/{name}.mcap' for name in names]


def test_a_folder_given_names_the_device_of_what_lies_in_it(tmp_path):
    touch(tmp_path, 'cell_1/a.mcap', 'cell_2/b.mcap')
    assert found(tmp_path, 'cell_1', 'cell_2/b.mcap') == {'cell_1/a.mcap': 'cell_1', 'cell_2/b.mcap': 'cell_2'}


def test_the_same_device_in_several_folders(tmp_path):
    touch(tmp_path, 'monday/cell_1/shift.mcap', 'tuesday/cell_1/shift.mcap')
    assert set(found(tmp_path, 'monday', 'tuesday').values()) == {'cell_1'}
    folders = {bag.folder for bag in find_bags([tmp_path / 'monday', tmp_path / 'tuesday'], RESULTS)}
    assert len(folders) == 2
    assert all(folder.match('cell_1/shift-*') for folder in folders)


def test_each_once(tmp_path):
    touch(tmp_path, 'cell/a.mcap')
    (tmp_path / 'cell' / 'up').symlink_to(tmp_path, target_is_directory=True)
    (tmp_path / 'cell' / 'other.mcap').symlink_to(tmp_path / 'cell' / 'a.mcap')
    assert found(tmp_path, '', 'cell', 'cell/a.mcap') == {'cell/a.mcap': 'cell'}


def test_a_folder_to_which_very_many_ways_lead_is_searched_once(tmp_path):
    """Each of forty folders has two links to the next: a million million ways."""
    touch(tmp_path, 'deep/40/a.mcap')
    for level in range(40):
        (tmp_path / 'deep' / f'{level}').mkdir()
        for name in ('one', 'other'):
            (tmp_path / 'deep' / f'{level}' / name).symlink_to(tmp_path / 'deep' / f'{level + 1}')
    (bag,) = find_bags([tmp_path / 'deep' / '0'], RESULTS)
    assert bag.path.name == 'a.mcap'


def test_results_are_no_bags(tmp_path):
    touch(tmp_path, 'cell/a.mcap', 'results/cell/a/compare.mcap', '.hidden/b.mcap')
    touch(tmp_path, 'cell/earlier/report.json', 'cell/earlier/compare.mcap', 'cell/compare.mcap')
    assert list(found(tmp_path)) == ['cell/a.mcap', 'cell/compare.mcap']


def test_none_is_left_out_because_it_can_not_be_read(tmp_path):
    touch(tmp_path, 'cell/packed.mcap.zstd')
    assert list(found(tmp_path)) == ['cell/packed.mcap.zstd']
    assert list(found(tmp_path, 'nowhere.mcap')) == ['nowhere.mcap']


def test_tables_where_tables_are_meant(tmp_path):
    touch(tmp_path, 'cell/a.csv', 'cell/b.mcap')
    assert list(found(tmp_path, tables=True)) == ['cell/a.csv']


def test_a_folder_without_bags(tmp_path):
    touch(tmp_path, 'cell/notes.txt')
    with pytest.raises(InputError, match='no bags in there'):
        find_bags([tmp_path], RESULTS)


NAMES = st.text(st.characters(blacklist_characters='/\0', blacklist_categories=['Cs']), min_size=1, max_size=8).filter(
    lambda name: not name.startswith('.')
)


@given(st.lists(st.tuples(NAMES, NAMES), min_size=1, max_size=8, unique=True))
def test_results_have_folders_of_their_own_with_plain_names(names):
    with tempfile.TemporaryDirectory() as home:
        for device, bag in names:
            touch(Path(home), f'{device}/{bag}.mcap')
        bags = find_bags([Path(home)], RESULTS)
        folders = [str(bag.folder).casefold() for bag in bags]
    assert len(bags) == len(names)
    assert len(set(folders)) == len(folders)
    assert all(len(bag.folder.parts) == 2 for bag in bags)
    assert all(re.fullmatch(r'(?!\.)[\w.-]+', part) for bag in bags for part in bag.folder.parts)
