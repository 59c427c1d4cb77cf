# SPDX-License-Identifier: Apache-2.0
"""
The tutorial's programs that run on, as it has them typed, with a leak that appears while they do.

Only the monitor is told not to take as long.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from graph import Graph
from patience import LONG_PATIENCE, wait_until
from terminals import Terminals, open_terminals

from studies.documents.tutorial import PAGE, blocks


@pytest.fixture
def terminals(tutorial) -> Iterator[Terminals]:
    """Start each program in a terminal of its own."""
    with open_terminals(PAGE, tutorial.folder, tutorial.environment) as terminals:
        yield terminals


@pytest.mark.slow
def test_the_twin_runs_and_a_leak_is_named(graph: Graph, terminals: Terminals) -> None:
    forces = [graph.listen(WrenchStamped, f'/cfd/{name}/contact_force') for name in ('sim', 'bent_sim')]
    graph.until(lambda: all(forces))
    terminals.end('bent')
    assert graph.set_atomically('/cfd/monitor/monitor_node', block=0.05, learning=3.0, diagnosis_window=10.0).successful

    def says(words: str) -> None:
        wait_until(
            lambda: any(words in line for line in terminals.printed.read_text().splitlines()),
            seconds=LONG_PATIENCE,
            meanwhile=lambda: graph.executor.spin_once(timeout_sec=0.1),
            found=terminals.printed.read_text,
        )

    says('cylinder_a, OK: agrees with its model')
    says('cylinder_b, OK: agrees with its model')
    leak = next(block.text for block in blocks() if 'param set' in block.text)
    *_, node, name, value = shlex.split(leak)
    assert graph.set(node, **{name: yaml.safe_load(value)}).successful  # as ros2 reads it
    says('cylinder_b, WARN: cylinder B loses ')
    says('looks like leakage (conductance ')
