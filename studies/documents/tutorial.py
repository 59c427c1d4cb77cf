# SPDX-License-Identifier: Apache-2.0
"""
The tutorial's commands, and the picture in it: make tutorial-picture.

In `docs/tutorial.md` blocks of ``sh`` run one after the other in one folder, each block of ``bash`` is a program that
runs on in a terminal of its own, and blocks of ``console`` need ROS 2's command line.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from studies.documents import package_facts
from studies.tools.chromium import Chromium
from studies.tools.provenance import ROOT

PAGE = ROOT / 'docs' / 'tutorial.md'
PICTURE = ROOT / 'docs' / 'tutorial_report.png'
REPORT = 'What the model lacks'
"""The heading after whose blocks the report is there."""

_SIZE = 1100, 1000  # of the picture [CSS px]
_FENCE = re.compile(r'^(?:## (?P<heading>[^\n]+)|```(?P<language>\w+)\n(?P<text>.*?)^```)$', re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block: the heading that it stands below, its language, its text."""

    heading: str
    language: str
    text: str


def blocks(page: Path = PAGE) -> Iterator[Block]:
    """Yield a page's fenced blocks, in their order."""
    heading = ''
    for found in _FENCE.finditer(page.read_text(encoding='utf-8')):
        if found['heading']:
            heading = found['heading']
        else:
            yield Block(heading, found['language'], found['text'])


def programs(folder: Path, around: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return an environment in which a shell finds the programs of this tree, by way of a folder that is made."""
    folder.mkdir()
    starts = {
        name: f'-c "import sys; from cfd_pneumatic.runtime.start import {name}; sys.exit({name}())" '
        for name in package_facts.programs()
    }
    for name, option in {**starts, 'python3': ''}.items():
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {option}"$@"\n', encoding='utf-8')
        program.chmod(0o755)
    paths = [str(ROOT), *filter(None, [around.get('PYTHONPATH')])]
    return {**around, 'PATH': f'{folder}{os.pathsep}{around["PATH"]}', 'PYTHONPATH': os.pathsep.join(paths)}


def run(text: str, folder: Path, environment: dict[str, str]) -> str:
    """Return what a shell says to some lines in a folder; an error there ends this."""
    done = subprocess.run(
        ['sh', '-euc', text], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if done.returncode != 0:
        raise RuntimeError(f'{text}\nended with {done.returncode}:\n{done.stdout}')
    return done.stdout


def main() -> int:
    """Take the picture of the tutorial's report; return the exit code."""
    with tempfile.TemporaryDirectory() as name, Chromium() as browser:
        folder = Path(name)
        environment = programs(folder / 'bin')
        for block in blocks():
            if block.language == 'sh':
                run(block.text, folder, environment)
            if block.heading == REPORT:
                break
        browser.show(folder / 'found' / 'report.html', *_SIZE)
        PICTURE.write_bytes(browser.screenshot())
    print(f'{PICTURE}: {PICTURE.stat().st_size // 1000} kB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
