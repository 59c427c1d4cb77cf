"""The policies of SROS 2: they allow what the nodes of a cell do, and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from xml.etree import ElementTree

import pytest
from graph import Graph, ros_arguments

from cfd_pneumatic.convention import MONITOR_INPUTS, SIM_INPUTS
from studies.security_policies import DEVICE, FILE, PROFILES, Profile, policy

HEARD = {'sim_node': SIM_INPUTS, 'monitor_node': MONITOR_INPUTS}
"""What launch files redirect to the device."""


@pytest.fixture(scope='module')
def cell(graph: Graph, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Yield a graph in which the nodes of a cell run, with simulated time."""
    recorder = next(profile for profile in PROFILES if profile.program == 'recorder_node')
    given = {'recorder_node': {'topics': list(recorder.hears), 'output': tmp_path_factory.mktemp('bags') / 'bag'}}
    with ExitStack() as stack:
        for profile in PROFILES:
            redirected = {topic: f'{DEVICE}/{topic}' for topic in HEARD.get(profile.program, ())}
            parameters = {'use_sim_time': True, **given.get(profile.program, {})}
            stack.enter_context(graph.run(profile.program, ros_arguments(profile.namespace, parameters, redirected)))
        graph.await_answers(*(profile.name for profile in PROFILES))
        yield graph


def names(found: Iterable[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in found}


def rights(profile: Profile) -> dict[tuple[str, str], set[str]]:
    return {(kind, right): set(allowed) for kind, right, allowed in profile.rules()}


@pytest.mark.parametrize('profile', PROFILES, ids=lambda profile: profile.program)
def test_a_node_may_what_it_does_and_nothing_else(cell: Graph, profile: Profile) -> None:
    of = profile.program, profile.namespace
    allowed = rights(profile)
    asked = allowed.pop(('services', 'request'), set())
    setpoints = {topic for topic in profile.hears if topic.endswith(('/setpoint', '/piston_command'))}
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
        assert asked <= rights(next(one for one in PROFILES if one.program == 'sim_node'))['services', 'reply']


def test_the_policy_file_is_up_to_date() -> None:
    """`make security-policies` makes it."""
    assert FILE.read_text(encoding='utf-8') == policy()
    enclaves = {enclave.get('path') for enclave in ElementTree.parse(Path(FILE)).iter('enclave')}
    assert enclaves == {f'/cfd/{profile.program}' for profile in PROFILES}
