# SPDX-License-Identifier: Apache-2.0
"""The policies of SROS 2: they allow what the nodes of a cell do, and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest
from graph import Graph, ros_arguments

from cfd_pneumatic.convention import MONITOR_INPUTS, SIM_INPUTS

FILE = Path(__file__).parents[2] / 'config' / 'cell.policy.xml'
DEVICE = '/cfd/device'
HEARD = {'sim_node': SIM_INPUTS, 'monitor_node': MONITOR_INPUTS}
"""What launch files redirect to the device."""


class Profile(NamedTuple):
    program: str
    namespace: str
    enclave: str
    rights: dict[tuple[str, str], set[str]]
    """Names of topics and services, by what may be done."""

    @property
    def name(self) -> str:
        return f'{self.namespace}/{self.program}'


def profiles() -> Iterator[Profile]:
    for enclave in ElementTree.parse(FILE).iter('enclave'):
        for one in enclave.iter('profile'):
            rights = {(some.tag, right): {str(name.text) for name in some} for some in one for right in some.attrib}
            yield Profile(one.attrib['node'], one.attrib['ns'], enclave.attrib['path'], rights)


PROFILES = {one.program: one for one in profiles()}


@pytest.fixture(scope='module')
def cell(graph: Graph, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Yield a graph in which the nodes of a cell run, with simulated time."""
    recorded = sorted(PROFILES['recorder_node'].rights['topics', 'subscribe'] - {'/clock'})
    given = {'recorder_node': {'topics': recorded, 'output': tmp_path_factory.mktemp('bags') / 'bag'}}
    with ExitStack() as stack:
        for program, profile in PROFILES.items():
            redirected = {topic: f'{DEVICE}/{topic}' for topic in HEARD.get(program, ())}
            parameters = {'use_sim_time': True, **given.get(program, {})}
            stack.enter_context(graph.run(program, ros_arguments(profile.namespace, parameters, redirected)))
        graph.await_answers(*(profile.name for profile in PROFILES.values()))
        yield graph


def names(found: Iterable[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in found}


@pytest.mark.parametrize('profile', PROFILES.values(), ids=PROFILES)
def test_a_node_may_what_it_does_and_nothing_else(cell: Graph, profile: Profile) -> None:
    of = profile.program, profile.namespace
    allowed = {what: set(some) for what, some in profile.rights.items()}
    asked = allowed.pop(('services', 'request'), set())
    setpoints = {topic for topic in allowed['topics', 'subscribe'] if topic.endswith(('/setpoint', '/piston_command'))}
    if profile.program == 'rig_node':  # with a schedule it sends them, without one it hears them
        allowed['topics', 'publish'] -= setpoints
    if profile.program == 'recorder_node':  # which waits for somebody who sends
        allowed['topics', 'subscribe'] -= setpoints
    find = cell.node.get_publisher_names_and_types_by_node
    cell.until(lambda: names(find(*of)) == allowed['topics', 'publish'])
    find = cell.node.get_subscriber_names_and_types_by_node
    cell.until(lambda: names(find(*of)) == allowed['topics', 'subscribe'])
    find = cell.node.get_service_names_and_types_by_node
    cell.until(lambda: names(find(*of)) == allowed['services', 'reply'])
    if profile.program == 'identifier_node':
        assert asked
        assert asked <= PROFILES['sim_node'].rights['services', 'reply']


def test_each_node_of_a_cell_has_an_enclave_of_its_own() -> None:
    nodes = ('rig_node', 'sim_node', 'monitor_node', 'identifier_node', 'recorder_node')
    assert [(one.program, one.enclave) for one in PROFILES.values()] == [(node, f'/cfd/{node}') for node in nodes]
