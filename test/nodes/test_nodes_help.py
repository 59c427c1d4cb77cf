# SPDX-License-Identifier: Apache-2.0
"""The nodes' help, which starts nothing, and its examples, each of which comes up and ends."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess

import pytest
import rclpy
from graph import Graph
from patience import allowed

from cfd_pneumatic import __version__
from cfd_pneumatic.examples import EXAMPLES

NODES = [name for name in EXAMPLES if name.endswith('_node')]


def module_of(name: str):
    return importlib.import_module(f'cfd_pneumatic.nodes.{name}')


@pytest.mark.parametrize('name', NODES)
def test_help_says_every_parameter_and_the_example_without_ros(
    name: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rclpy, 'init', None)
    assert module_of(name).main(['--help']) == 0
    said = capsys.readouterr().out
    assert said.rstrip().endswith(EXAMPLES[name].rstrip())
    assert 'parameters and their defaults:\n  ' in said


@pytest.mark.parametrize('name', NODES)
def test_it_says_its_version_without_ros(
    name: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rclpy, 'init', None)
    assert module_of(name).main(['--version']) == 0
    assert capsys.readouterr().out == f'{name} {__version__}\n'


@pytest.mark.parametrize(
    ('name', 'line'),
    [
        ('sim_node', 'timeout (0.5): silence of piston_state after which /diagnostics reports an error [s]'),
        ('monitor_node', 'learning (300): how long the usual residuals are learned [s]'),
        ('rig_node', 'sample_rate (500): samples per second [Hz]'),
        ('recorder_node', 'storage (mcap): storage of the bag; mcap or sqlite3'),
        ('identifier_node', 'split (60/20/20): percent of train, validation and test'),
    ],
)
def test_a_parameter_has_its_unit_and_default(name: str, line: str, capsys: pytest.CaptureFixture) -> None:
    assert module_of(name).main(['-h']) == 0
    assert line in capsys.readouterr().out


@pytest.mark.slow
def test_the_examples_come_up_together_and_end(graph: Graph, examples) -> None:
    """Together, as the device's topics are what the others of them want."""
    running = {
        name: subprocess.Popen(
            ['sh', '-c', f'exec {EXAMPLES[name]}'], cwd=examples.folder, env=os.environ | examples.environment
        )
        for name in NODES
    }
    try:
        graph.until(lambda: set(NODES) <= set(graph.node.get_node_names()))
        # the rig moves farther than it did while the device was identified
        graph.next_diagnostics('/cfd/sim/sim_node', lambda status: 'outside the identified' in status.message)
        graph.next_diagnostics('/cfd/monitor/monitor_node', lambda status: 'learning' in status.message)
        for process in running.values():
            process.send_signal(signal.SIGINT)
        assert {name: process.wait(allowed()) for name, process in running.items()} == dict.fromkeys(NODES, 0)
    finally:
        for process in running.values():
            process.kill()
            process.wait()
    assert (examples.folder / 'cell_bag' / 'metadata.yaml').is_file()
