# SPDX-License-Identifier: Apache-2.0
"""Python processes that are started in a folder with somebody else's Python files run none of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cfd_pneumatic
from cfd_pneumatic.runtime.children import start_python

ROOT = Path(cfd_pneumatic.__file__).parents[1]
ELSEWHERE = {'numpy', 'numba', 'scipy', 'yaml', 'rich', 'rosbags', 'mcap', 'jinja2', 'dask', 'distributed'}
CODE = f"""
import json, subprocess, multiprocessing, {', '.join(sorted(ELSEWHERE - {'dask', 'distributed'}))}
from cfd_pneumatic import errors
print(json.dumps([errors.__file__, sys.argv[1:]]))
"""
PROGRAM = 'import sys\nfrom cfd_pneumatic.runtime.start import identify_bag\nsys.exit(identify_bag())\n'


def plant(folder: Path, names: set[str], seen: Path) -> None:
    """Put a Python file of each name into a folder, which write another file if they are run."""
    for name in names:
        (folder / f'{name}.py').write_text(f'open({str(seen)!r}, "a").write("{name} ")\nraise ImportError\n')
    return seen


@pytest.mark.parametrize(
    'path', [None, '', ':', ':/somewhere', '/somewhere:', '.', './', 'below', '../working', '/somewhere::/elsewhere']
)
def test_a_child_imports_nothing_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str | None
) -> None:
    working = tmp_path / 'working'
    seen = tmp_path / 'seen'
    for folder in (working, working / 'below'):
        folder.mkdir()
        plant(folder, {*sys.stdlib_module_names, *ELSEWHERE, 'sitecustomize', 'usercustomize', 'cfd_pneumatic'}, seen)
    if path is None:
        monkeypatch.delenv('PYTHONPATH', raising=False)
    else:
        monkeypatch.setenv('PYTHONPATH', path)
    child = start_python(CODE, 'one', '-c', cwd=working, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said, complained = child.communicate()
    assert child.returncode == 0, complained
    assert said == f'["{ROOT}/cfd_pneumatic/errors.py", ["one", "-c"]]\n'
    assert not seen.exists()


def test_a_child_has_the_absolute_entries_of_pythonpath_and_the_package_that_its_parent_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overlay = tmp_path / 'overlay'
    (overlay / 'cfd_pneumatic').mkdir(parents=True)
    (overlay / 'cfd_pneumatic' / '__init__.py').write_text('raise ImportError("another version")\n')
    (overlay / 'overlaid.py').write_text('VALUE = 7\n')
    monkeypatch.setenv('PYTHONPATH', f':{overlay}:')
    code = 'import overlaid, cfd_pneumatic; print(overlaid.VALUE, cfd_pneumatic.__file__, sys.path.count(""))'
    child = start_python(code, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert child.communicate()[0] == f'7 {cfd_pneumatic.__file__} 0\n'


def test_a_child_has_this_process_s_environment_and_what_is_added(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('KEPT', 'a')
    code = 'import os; print(os.environ["KEPT"], os.environ["ADDED"])'
    child = start_python(code, env={'ADDED': 'b'}, stdout=subprocess.PIPE, text=True)
    assert child.communicate()[0] == 'a b\n'


@pytest.mark.parametrize('entry', ['', '.', '../working'])
def test_a_program_leaves_relative_entries_of_pythonpath(tmp_path: Path, entry: str) -> None:
    program = tmp_path / 'identify_bag'
    program.write_text(PROGRAM)
    working = tmp_path / 'working'
    working.mkdir()
    seen = tmp_path / 'seen'
    plant(working, ELSEWHERE, seen)
    environment = os.environ | {'PYTHONPATH': os.pathsep.join([entry, str(ROOT)])}
    command = [sys.executable, program, 'nowhere', '--output', 'out']
    run = subprocess.run(command, cwd=working, env=environment, capture_output=True, text=True)
    assert (run.returncode, len(run.stderr.strip().splitlines())) == (2, 1), run.stderr
    assert not seen.exists()
