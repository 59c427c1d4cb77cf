# SPDX-License-Identifier: Apache-2.0
"""
The programs of the tutorial on the monitor, as a user types them, with a leak that appears at run time.

Only the monitor learns for a shorter time.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from graph import Graph
from patience import LONG_PATIENCE, wait_until
from terminals import Terminals, open_terminals

from studies.documents.tutorial import MONITOR, blocks

DEVICE_WITH_CURVE = r"""
```bash
rig_node --ros-args -r __ns:=/cfd/bent -p device:=real -p "faults:=odd_a.kink=0.1 odd_a.kink_pressure=7e4" \
    -p schedule:=surface_following -p repeat:=true
```

```bash
sim_node --ros-args -r __ns:=/cfd/bent_sim --params-file parameters.yaml \
    -r piston_state:=/cfd/bent/piston_state \
    -r cylinder_a/setpoint:=/cfd/bent/cylinder_a/setpoint \
    -r cylinder_b/setpoint:=/cfd/bent/cylinder_b/setpoint
```
"""
"""Programs for the result of the tutorial on own data, run in the folder of the result."""


@pytest.fixture
def terminals(tutorial) -> Iterator[Terminals]:
    """Start each program in a terminal of its own."""
    with open_terminals(MONITOR, tutorial.folder, tutorial.environment) as terminals:
        yield terminals


@pytest.mark.slow
def test_the_twin_runs_and_a_leak_is_named(graph: Graph, terminals: Terminals) -> None:
    forces = graph.listen(WrenchStamped, '/cfd/sim/contact_force')
    graph.until(lambda: bool(forces))
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


@pytest.mark.slow
def test_the_simulator_runs_with_an_estimated_curve(graph: Graph, tutorial, tmp_path: Path) -> None:
    page = tmp_path / 'page.md'
    page.write_text(DEVICE_WITH_CURVE)
    forces = graph.listen(WrenchStamped, '/cfd/bent_sim/contact_force')
    with open_terminals(page, tutorial.folder / 'bent_again', tutorial.environment):
        graph.until(lambda: bool(forces))
