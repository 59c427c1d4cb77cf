# SPDX-License-Identifier: Apache-2.0
"""What the nodes hear and publish is what the launch files redirect and the layouts show."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack

import numpy as np
import pytest
from graph import Graph, ros_arguments

from cfd_pneumatic.convention import MONITOR_INPUTS, SIM_INPUTS
from cfd_pneumatic.model import TABLE_1
from cfd_pneumatic.nodes import topics
from cfd_pneumatic.nodes.topics import Backlog, LossCounter
from cfd_pneumatic.rig import SCHEDULES, schedule_named
from studies.documents.layouts import DEVICE, FOLDER, FOXGLOVE_PATHS, MONITOR, SIM

NODES = {
    DEVICE: ('rig_node', {'schedule': 'paper_step', 'start_subscribers': 99}),
    SIM: ('sim_node', {}),
    MONITOR: ('monitor_node', {}),
}


@pytest.fixture(scope='module')
def cell(graph) -> Graph:
    """Yield a graph in which the nodes of a cell run."""
    with ExitStack() as stack:
        for namespace, (name, parameters) in NODES.items():
            stack.enter_context(graph.run(name, ros_arguments(namespace, parameters)))
        graph.await_answers(*(f'{namespace}/{name}' for namespace, (name, _) in NODES.items()))
        yield graph


@pytest.mark.parametrize(('namespace', 'inputs'), [(SIM, SIM_INPUTS), (MONITOR, MONITOR_INPUTS)])
def test_launch_files_redirect_what_the_node_hears(cell, namespace, inputs):
    name, _ = NODES[namespace]
    cell.until(lambda: cell.node.get_subscriber_names_and_types_by_node(name, namespace))
    heard = {topic for topic, _ in cell.node.get_subscriber_names_and_types_by_node(name, namespace)}
    assert {topic for topic in heard if topic.startswith(namespace)} == {f'{namespace}/{topic}' for topic in inputs}


@pytest.mark.parametrize('name', SCHEDULES)
def test_no_schedule_of_the_rig_leaves_the_operating_points_of_a_cell_s_default_parameters(name):
    setpoints = schedule_named(name).setpoints
    assert all(TABLE_1.covers(setpoint) for setpoint in np.unique(setpoints))


def test_what_the_layout_of_a_cell_shows_is_published(cell):
    published = {}
    for namespace, (name, _) in NODES.items():
        published |= cell.node.get_publisher_names_and_types_by_node(name, namespace)
    panels = json.loads((FOLDER / 'cell.foxglove.json').read_text(encoding='utf-8'))['configById'].values()
    shown = dict(path['value'].split('.', 1) for panel in panels for path in panel.get('paths', ()))
    assert {topic: FOXGLOVE_PATHS[published[topic][0]] for topic in shown} == shown


@pytest.fixture
def standing(monkeypatch):
    """Let what waits be shed after a tenth of a second."""
    monkeypatch.setattr(topics, '_STALE_AFTER', 100_000_000)


@pytest.mark.usefixtures('standing')
def test_what_waits_too_long_is_shed_until_little_waits():
    backlog = Backlog()

    def stands(waited: float) -> bool:
        return backlog.is_stale(time.time_ns() - round(waited * 1e9))

    assert not stands(0.3)  # as behind a process that stood still
    time.sleep(0.15)
    assert stands(0.3)
    assert stands(0.1)
    assert not stands(0.0)
    assert not stands(0.1)


@pytest.mark.usefixtures('standing')
def test_whatever_is_shed_is_told_though_nothing_comes_after_it():
    lost: list[int] = []
    taken: list[int] = []
    count = LossCounter(taken.append, lost.append, lambda: 1, Backlog())

    def send(numbers: range) -> None:
        for number in numbers:
            received = time.time_ns() - 300_000_000
            count(number, {'publication_sequence_number': number, 'received_timestamp': received})

    send(range(1, 20))
    time.sleep(0.15)
    send(range(20, 39))
    assert taken == [*range(1, 20), 20, 30]
    assert sum(lost) + len(taken) == 38
