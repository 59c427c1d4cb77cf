# SPDX-License-Identifier: Apache-2.0
"""docs/how_to/add_an_effect.md, done to the letter on a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from patience import LONG_PATIENCE, allowed

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / 'docs' / 'how_to' / 'add_an_effect.md').read_text(encoding='utf-8')
FILE, ON_THE_RIG = re.findall(r'```python\n(.*?)```', TEXT, re.DOTALL)
(KNOWN,) = re.findall(r"^ +(\('mains_hum', .*\n)", TEXT, re.MULTILINE)


@pytest.fixture(scope='module')
def copy(tmp_path_factory):
    """Return a copy of the package with the effect in its kernel; what is compiled already comes along."""
    folder = tmp_path_factory.mktemp('copy')
    for name in ('cfd_pneumatic', 'studies', 'test'):
        shutil.copytree(ROOT / name, folder / name)
    shutil.copy(ROOT / 'pyproject.toml', folder)  # the markers of tests and their time limit
    (folder / re.search(r'`(cfd_pneumatic/\S+\.py)`:\n', TEXT)[1]).write_text(FILE)
    known = folder / 'test' / 'identification' / 'test_extension.py'
    known.write_text(known.read_text().replace('KNOWN = [\n', f'KNOWN = [\n{KNOWN}'))
    run(folder, '-m', 'cfd_pneumatic.generator')
    return folder


def run(folder, *arguments):
    paths = os.pathsep.join([str(folder), *sys.path])
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {'PYTHONPATH': paths},
        capture_output=True,
        text=True,
        timeout=allowed(LONG_PATIENCE),
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


@pytest.mark.long
def test_the_tests_of_all_effects_run_on_it(copy):
    """It simulates, is absent at its null, and its sensitivities are those of differences."""
    tests = [f'test/{name}.py' for name in ('model/test_effects', 'model/test_side_by_side', 'model/test_live_effects')]
    said = run(copy, '-m', 'pytest', '-q', *tests, 'test/identification/test_extension.py', '-k', 'mains_hum or kernel')
    assert int(re.search(r'(\d+) passed', said)[1]) > 20


@pytest.mark.long
def test_the_loop_finds_it_on_the_rig(copy):
    assert 'Missing effect: mains_hum' in run(copy, '-c', ON_THE_RIG)
