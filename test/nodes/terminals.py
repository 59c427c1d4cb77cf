# SPDX-License-Identifier: Apache-2.0
"""A page's programs that run on, each in a terminal of its own."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from patience import allowed

from studies.documents.tutorial import blocks


class Terminals(NamedTuple):
    """What the programs print, as it grows, and those that run, by how they were started."""

    printed: Path
    running: dict[str, subprocess.Popen]

    def end(self, word: str = '') -> None:
        """Interrupt the programs with a word in their lines."""
        ended = {program: process for program, process in self.running.items() if word in program}
        for process in ended.values():
            process.send_signal(signal.SIGINT)
        failed = [program for program, process in ended.items() if process.wait(allowed())]
        # rclpy may be interrupted in the middle of taking a message, which our programs bear
        assert [program for program in failed if not program.startswith('python3')] == []
        for program in ended:
            del self.running[program]


@contextmanager
def open_terminals(page: Path, folder: Path, environment: Mapping[str, str]) -> Iterator[Terminals]:
    """Start each block of ``bash`` of a page in a folder; the programs end with the block at the latest."""
    printed = folder / 'printed.log'
    with printed.open('w') as stdout:
        running = {
            block.text: subprocess.Popen(
                ['sh', '-c', f'exec {block.text}'], cwd=folder, env=os.environ | environment, stdout=stdout
            )
            for block in blocks(page)
            if block.language == 'bash'
        }
        terminals = Terminals(printed, running)
        try:
            yield terminals
            terminals.end()
        finally:
            for process in running.values():
                process.kill()
                process.wait()
