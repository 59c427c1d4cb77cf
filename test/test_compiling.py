# SPDX-License-Identifier: Apache-2.0
"""Where machine code is kept, as a process finds its folders; what can't be written here root can't write either."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

MODULE = """
from cfd_pneumatic.compiling import announced, compiler

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


def told(module: Path, environment: Mapping[str, str] | None = None) -> list[str]:
    """Return what a process that runs the module is told of."""
    own = {name: value for name, value in os.environ.items() if not name.startswith('NUMBA')}
    own['PYTHONPATH'] = os.pathsep.join(filter(None, sys.path))
    run = subprocess.run([sys.executable, module], env=own | dict(environment or {}), capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stdout.splitlines()


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


LONG = """
import os, sys, time
from numba.extending import overload
from cfd_pneumatic.compiling import announced, compiler

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
