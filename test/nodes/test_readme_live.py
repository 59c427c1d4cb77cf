# SPDX-License-Identifier: Apache-2.0
"""The README's commands for a deburring stack, typed in an empty folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from graph import Graph
from terminals import open_terminals

from studies.documents.tutorial import blocks, programs, run
from studies.tools.provenance import ROOT

README = ROOT / 'README.md'


@pytest.mark.slow
def test_the_force_on_the_tool_is_shown_without_ros2(graph: Graph, tmp_path: Path) -> None:
    environment = programs(tmp_path / 'programs')
    for block in blocks(README):
        if block.language == 'sh':
            run(block.text, tmp_path, environment)
    measured = graph.listen(WrenchStamped, '/cfd/device/measured_force')
    with open_terminals(README, tmp_path, environment) as terminals:
        assert [program.split()[0] for program in terminals.running] == ['rig_node', 'sim_node', 'python3']

        def shown() -> list[float]:
            return [float(number) for number in re.findall(r'(\S+) N', terminals.printed.read_text())]

        graph.until(lambda: len(measured) > 3000 and len(shown()) > 3000)
        forces = [message.wrench.force.x for message in measured]
        assert min(forces) - 2.0 < min(shown()) < max(shown()) < max(forces) + 2.0
        assert max(shown()) - min(shown()) > 5.0
