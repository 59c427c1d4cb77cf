# SPDX-License-Identifier: Apache-2.0
"""Where machine code is kept, as a process finds its folders; what can't be written here root can't write either."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

MODULE = """
from cfd_pneumatic.runtime.compiling import announced, compiler

@compiler()
def twice(number):
    return 2 * number

@compiler()
def squared(number):
    return number * number

with announced(print, lambda: print('waiting')):
    assert (twice(3), squared(3)) == (6, 9)
"""


@pytest.fixture
def module(tmp_path: Path) -> Path:
    file = tmp_path / 'package' / 'module.py'
    file.parent.mkdir()
    file.write_text(MODULE)
    return file


def told(module: Path, environment: Mapping[str, str] | None = None, **options: Any) -> list[str]:
    """Return what a process that runs the module is told of."""
    return told_and_warned(module, environment, **options)[0]


def told_and_warned(
    module: Path, environment: Mapping[str, str] | None = None, **options: Any
) -> tuple[list[str], list[str]]:
    """Return what a process that runs the module is told of, and what it warns of."""
    left_out = ('NUMBA', 'PYTHONSAFEPATH')  # the latter is set once a test has started workers
    own = {name: value for name, value in os.environ.items() if not name.startswith(left_out)}
    own['PYTHONPATH'] = os.pathsep.join(filter(None, sys.path))
    environment = own | dict(environment or {})
    run = subprocess.run([sys.executable, module], env=environment, capture_output=True, text=True, **options)
    assert run.returncode == 0, run.stderr
    return run.stdout.splitlines(), run.stderr.splitlines()


def protect(module: Path) -> None:
    """Let nothing be written beside the module: a file stands where the folder would be."""
    (module.parent / '__pycache__').touch()


def test_only_the_first_run_compiles_and_later_ones_load_nothing_that_only_compiling_needs(module: Path) -> None:
    user = module.with_name('user.py')
    user.write_text('import sys, module\nprint("numba.np.arraymath" in sys.modules)\n')
    assert told(user) == [str(module.parent / '__pycache__'), 'True']
    assert told(user) == ['False']


def test_a_folder_of_the_user_s_choice_is_taken(module: Path, tmp_path: Path) -> None:
    (folder,) = told(module, {'NUMBA_CACHE_DIR': str(tmp_path / 'cache')})
    assert Path(folder).parent == tmp_path / 'cache'


def test_an_installation_that_cannot_be_written_has_its_code_kept_in_the_user_s_cache(
    module: Path, tmp_path: Path
) -> None:
    protect(module)
    cache = {'XDG_CACHE_HOME': str(tmp_path / 'cache')}
    (folder,) = told(module, cache)
    assert tmp_path / 'cache' in Path(folder).parents
    assert told(module, cache) == []


def test_where_nothing_can_be_written_every_run_compiles(module: Path) -> None:
    protect(module)
    nowhere = {'XDG_CACHE_HOME': str(module / 'below a file'), 'NUMBA_CACHE_DIR': str(module / 'too')}
    assert [told(module, nowhere) for _ in range(2)] == [['None']] * 2


def test_damaged_code_is_compiled_anew_with_one_warning(module: Path) -> None:
    (folder,) = told(module)
    first, second = Path(folder).glob('*.nbc')
    first.write_bytes(b'')
    second.write_bytes(second.read_bytes()[:5000])
    compiled, warnings = told_and_warned(module)
    assert compiled == [folder]
    assert [f'The cache {folder} is damaged' in line for line in warnings] == [True]
    assert told_and_warned(module) == ([], [])


def test_code_of_another_function_and_what_a_killed_program_left_are_not_used(module: Path) -> None:
    (folder,) = told(module)
    first, second = Path(folder).glob('*.nbc')
    second.write_bytes(first.read_bytes())
    first.with_name(f'{first.name}.0123.tmp').write_bytes(b'half')
    assert told_and_warned(module) == ([folder], [])
    assert told_and_warned(module) == ([], [])


def test_on_a_full_disk_code_stays_in_memory_with_one_warning(module: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    cache = module.parent / '__pycache__'
    for _ in range(2):
        compiled, warnings = told_and_warned(module, preexec_fn=limit)
        assert compiled == [str(cache)]
        assert [line.startswith(f'Machine code cannot be kept: {cache}: File too large') for line in warnings] == [True]
    assert [file.name for file in cache.iterdir()] == ['compiling.lock']
    assert told(module) == [str(cache)]
    assert told(module) == []


LOST = """
import os, shutil
from numba.extending import overload
from cfd_pneumatic.runtime.compiling import compiler

def slow(number):
    return number

@overload(slow)
def _(number):  # while it is compiled
    folder = os.path.join(os.path.dirname(__file__), '__pycache__')
    shutil.rmtree(folder)
    open(folder, 'w').close()
    return lambda number: 2 * number

@compiler()
def outer(number):
    return slow(number)

assert outer(3) == 6
"""


def test_a_folder_that_is_lost_while_code_is_compiled_costs_one_warning(module: Path) -> None:
    module.write_text(LOST)
    _, warnings = told_and_warned(module)
    assert [line.startswith('Machine code cannot be kept') for line in warnings] == [True]


def test_where_nothing_can_be_written_there_is_one_warning(module: Path) -> None:
    protect(module)
    _, warnings = told_and_warned(module, {'XDG_CACHE_HOME': str(module / 'below a file')})
    assert [line.startswith('Machine code cannot be kept: no folder can be written') for line in warnings] == [True]


def test_a_cache_to_which_others_can_write_is_not_used_with_one_warning(module: Path, tmp_path: Path) -> None:
    cache = tmp_path / 'cache'
    (folder,) = told(module, {'NUMBA_CACHE_DIR': str(cache)})
    assert Path(folder).parent == cache
    cache.chmod(0o777)
    compiled, warnings = told_and_warned(module, {'NUMBA_CACHE_DIR': str(cache)})
    assert compiled == [str(module.parent / '__pycache__')]
    assert [line.startswith(f'The cache {folder} is not used') for line in warnings] == [True]


def test_a_cache_beside_the_code_is_left_for_the_user_s_if_others_can_write_to_it(module: Path, tmp_path: Path) -> None:
    (folder,) = told(module)
    Path(folder).chmod(0o777)
    cache = {'XDG_CACHE_HOME': str(tmp_path / 'cache')}
    compiled, warnings = told_and_warned(module, cache)
    assert tmp_path / 'cache' in Path(compiled[0]).parents
    assert [line.startswith(f'The cache {folder} is not used') for line in warnings] == [True]
    compiled, warnings = told_and_warned(module, cache)
    assert (compiled, len(warnings)) == ([], 1)


@pytest.mark.parametrize('place', ['link', 'pipe'])
def test_the_lock_of_the_compiler_neither_empties_a_file_nor_waits_for_a_writer(
    module: Path, tmp_path: Path, place: str
) -> None:
    (folder,) = told(module)
    precious, lock = tmp_path / 'precious', Path(folder) / 'compiling.lock'
    precious.write_text('precious')
    for file in Path(folder).iterdir():
        file.unlink()
    lock.symlink_to(precious) if place == 'link' else os.mkfifo(lock)
    assert told(module, timeout=100.0) == [folder]
    assert precious.read_text() == 'precious'


def test_nobody_else_can_lock_the_compiler(module: Path) -> None:
    """Who can read a file can lock it, and every start would wait."""
    (folder,) = told(module)
    lock = Path(folder) / 'compiling.lock'
    assert lock.stat().st_mode & 0o777 == 0o600
    lock.chmod(0o644)  # as earlier versions made it
    for file in Path(folder).glob('*.nbc'):
        file.unlink()
    told(module)
    assert lock.stat().st_mode & 0o777 == 0o600


def test_settings_of_numba_s_in_the_working_folder_name_no_cache(module: Path, tmp_path: Path) -> None:
    (tmp_path / '.numba_config.yaml').write_text(f'cache_dir: {tmp_path / "hostile"}\ndisable_jit: 1\n')
    assert told_and_warned(module, cwd=tmp_path) == ([str(module.parent / '__pycache__')], [])


LONG = """
import os, sys, time
from numba.extending import overload
from cfd_pneumatic.runtime.compiling import announced, compiler

def slow(number):
    return number

@overload(slow)
def _(number):
    while not os.path.exists(sys.argv[1]):  # while it is compiled
        time.sleep(0.01)
    return lambda number: 2 * number

@compiler()
def outer(number):
    return inner(number)

@compiler()
def inner(number):
    return slow(number)

with announced(lambda folder: print('compiling', flush=True), lambda: print('waiting', flush=True)):
    assert outer(3) == 6
"""
"""Is compiled until there is a file."""


def test_of_processes_that_begin_together_one_compiles_and_the_others_wait_and_say_so(module: Path) -> None:
    module.write_text(LONG)
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path)))
    go = module.with_name('go')
    start = [sys.executable, module, go]
    began = [subprocess.Popen(start, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    first = [process.stdout.readline() for process in began]
    go.touch()
    said = [{line, *process.communicate()[0].splitlines(keepends=True)} for line, process in zip(first, began)]
    assert [process.returncode for process in began] == [0] * 3
    assert sorted(said, key=sorted) == [{'compiling\n'}, {'waiting\n'}, {'waiting\n'}]
