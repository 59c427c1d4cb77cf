# SPDX-License-Identifier: Apache-2.0
"""
Run the tutorials' commands and take the picture of the first report: make tutorial-picture.

Blocks of ``sh`` in `PAGES` run in order in a common folder. Each block of ``bash`` is a program that runs on in a
separate terminal. Blocks of ``console`` need ROS 2's command line.
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

PAGES = FIRST_REPORT, OWN_DATA, HOLD_THE_FORCE, MONITOR = tuple(
    ROOT / 'docs' / 'tutorials' / f'{name}.md' for name in ('first_report', 'own_data', 'hold_the_force', 'monitor')
)
"""The tutorials, in the order in which a user reads them."""

PICTURE = ROOT / 'docs' / 'tutorials' / 'report.png'
REPORT = 'The report'
"""Heading of the section of `FIRST_REPORT` that writes the report."""

_SIZE = 1100, 1000  # size of the picture [CSS px]
_FENCE = re.compile(r'^(?:## (?P<heading>[^\n]+)|```(?P<language>\w+)\n(?P<text>.*?)^```)$', re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block: heading of its section, language, text."""

    heading: str
    language: str
    text: str


def blocks(*pages: Path) -> Iterator[Block]:
    """Yield the fenced blocks of pages in order; without pages those of all tutorials."""
    for page in pages or PAGES:
        heading = ''
        for match in _FENCE.finditer(page.read_text(encoding='utf-8')):
            if match['heading']:
                heading = match['heading']
            else:
                yield Block(heading, match['language'], match['text'])


def programs(folder: Path, environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Create a folder with the programs of this tree, and return an environment with the folder in PATH."""
    folder.mkdir()
    starts = {
        name: f'-c "import sys; from cfd_pneumatic.runtime.start import {name}; sys.exit({name}())" '
        for name in package_facts.programs()
    }
    for name, option in {**starts, 'python3': ''}.items():
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {option}"$@"\n', encoding='utf-8')
        program.chmod(0o755)
    paths = [str(ROOT), *filter(None, [environment.get('PYTHONPATH')])]
    return {**environment, 'PATH': f'{folder}{os.pathsep}{environment["PATH"]}', 'PYTHONPATH': os.pathsep.join(paths)}


def run(text: str, folder: Path, environment: dict[str, str]) -> str:
    """Run lines in a shell and return their output; raise RuntimeError if the shell fails."""
    ended = subprocess.run(
        ['sh', '-euc', text], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if ended.returncode != 0:
        raise RuntimeError(f'{text}\nended with {ended.returncode}:\n{ended.stdout}')
    return ended.stdout


def main() -> int:
    """Take the picture of the first report; return the exit code."""
    with tempfile.TemporaryDirectory() as name, Chromium() as browser:
        folder = Path(name)
        environment = programs(folder / 'bin')
        for block in blocks(FIRST_REPORT):
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
