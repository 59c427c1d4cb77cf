# SPDX-License-Identifier: Apache-2.0
"""
The tutorial's programs that run on, as it has them typed, with a leak that appears while they do.

Only the monitor is told not to take as long.
"""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from graph import PATIENCE, Graph

from studies.tutorial import blocks

LONGEST = 600.0
"""On a busy machine, to which a diagnosis leaves its turn [s]."""


class Terminals(NamedTuple):
    """What `health.py` says, as it grows, and the programs that run, by how they were started."""

    talk: Path
    running: dict[str, subprocess.Popen]

    def end(self, word: str = '') -> None:
        """Interrupt the programs with a word in their lines."""
        ended = {program: process for program, process in self.running.items() if word in program}
        for process in ended.values():
            process.send_signal(signal.SIGINT)
        failed = [program for program, process in ended.items() if process.wait(PATIENCE)]
        # rclpy may be interrupted in the middle of taking a message, which our programs bear
        assert [program for program in failed if 'health.py' not in program] == []
        for program in ended:
            del self.running[program]


@pytest.fixture
def terminals(tutorial) -> Iterator[Terminals]:
    """Start each program in a terminal of its own."""
    talk = tutorial.folder / 'health.log'
    with talk.open('w') as stdout:
        running = {
            block.text: subprocess.Popen(
                ['sh', '-c', f'exec {block.text}'],
                cwd=tutorial.folder,
                env=os.environ | tutorial.environment,
                stdout=stdout,
            )
            for block in blocks()
            if block.language == 'bash'
        }
        terminals = Terminals(talk, running)
        try:
            yield terminals
            terminals.end()
        finally:
            for process in running.values():
                process.kill()
                process.wait()


@pytest.mark.slow
def test_the_twin_runs_and_a_leak_is_named(graph: Graph, terminals: Terminals) -> None:
    forces = [graph.listen(WrenchStamped, f'/cfd/{name}/contact_force') for name in ('sim', 'bent_sim')]
    graph.until(lambda: all(forces))
    terminals.end('bent')
    assert graph.set_atomically('/cfd/monitor/monitor_node', block=0.05, learning=3.0, diagnosis_window=10.0).successful

    def says(words: str) -> None:
        limit = time.monotonic() + LONGEST
        while not any(words in line for line in terminals.talk.read_text().splitlines()):
            assert time.monotonic() < limit, terminals.talk.read_text()
            graph.executor.spin_once(timeout_sec=0.1)

    says('cylinder_a, OK: agrees with its model')
    says('cylinder_b, OK: agrees with its model')
    leak = next(block.text for block in blocks() if 'param set' in block.text)
    *_, node, name, value = shlex.split(leak)
    assert graph.set(node, **{name: yaml.safe_load(value)}).successful  # as ros2 reads it
    says('cylinder_b, WARN: cylinder B loses ')
    says('looks like leakage (conductance ')
