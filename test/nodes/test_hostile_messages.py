# SPDX-License-Identifier: Apache-2.0
"""No message ends a node: every extreme of every field, after each of which a sane message is answered as before."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from graph import MILLISECOND, Graph, Process, SimClient, ros_arguments, unique_namespace
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Header, String

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CONTACT_FORCE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_COMMAND,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes import topics
from cfd_pneumatic.nodes.messages import LATEST, nanoseconds, stamp_message
from cfd_pneumatic.nodes.samples import message_class
from cfd_pneumatic.nodes.topics import subscribe
from cfd_pneumatic.units import PSI

NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e155, 1e13, 5e-324, -0.0)
TEXTS = ('', 'x' * 100_000, 'Kolben ü \U0001f527\n\t\x1b[31m"\'{}%s', '/')
TIMES = tuple(
    Time(sec=sec, nanosec=rest) for sec, rest in product((-(2**31), -1, 2**31 - 1), (0, 10**9 - 1, 10**9, 2**32 - 1))
)
NO_TIMES = tuple(time for time in TIMES if time.sec < 0 or time.nanosec >= 10**9)
SANE = 10**18
REST = AMBIENT_PRESSURE + 10 * PSI


def headers() -> Iterator[Header]:
    yield from (Header(stamp=time, frame_id='cfd') for time in TIMES)
    yield from (Header(stamp=stamp_message(SANE), frame_id=text) for text in TEXTS)


def pistons() -> Iterator[JointState]:
    yield from (JointState(header=header, name=['piston'], position=[0.0]) for header in headers())
    header = Header(stamp=stamp_message(SANE))
    for value in NUMBERS:
        yield JointState(header=header, name=['piston'], position=[value], velocity=[value], effort=[value])
    for names, positions in (
        ([], []),
        ([], [0.0]),
        (['piston'], []),
        (['elbow'], [0.0]),
        (['elbow', 'piston'], [0.0]),
        (['piston'], [0.0, 1.0]),
        (['piston', 'piston'], [0.0, math.nan]),
        (list(TEXTS), [0.0] * len(TEXTS)),
        ([f'joint {index}' for index in range(10_000)], [0.0]),
        (['piston'], [0.0] * 200_000),
        (['piston'] * 10_000, []),
    ):
        yield JointState(header=header, name=names, position=positions)


def reliable(namespace: str, *topics: str) -> dict[str, str]:
    """Return parameters with which no message is lost on a busy machine."""
    return {f'qos_overrides.{namespace}/{topic}.subscription.reliability': 'reliable' for topic in topics}


def counted(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


MODULES = ('sim_node', 'monitor_node', 'identifier_node', 'rig_node', 'recorder_node')
MEASURED = (PISTON_STATE, *map(pressure_topic, CYLINDERS), MEASURED_FORCE)


@pytest.fixture(scope='module')
def running(graph: Graph, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, tuple[str, Process]]]:
    """Run a node of each kind by the clock of `/clock`; yield the namespace and process of each."""
    root = tmp_path_factory.getbasetemp()
    spaces = {module: unique_namespace() for module in MODULES}
    given = {
        'sim_node': reliable(spaces['sim_node'], PISTON_STATE),
        'monitor_node': reliable(spaces['monitor_node'], *MEASURED) | {'learning': 2.0, 'block': 0.02, 'timeout': 60.0},
        'identifier_node': {'input_folders': f'[{root}]', 'output_folder': root},
        'rig_node': {'sample_rate': 50.0},
        'recorder_node': {'topics': '[/nothing]', 'output': tmp_path_factory.mktemp('recorder') / 'bag'},
    }
    with ExitStack() as stack:
        started = {}
        for module, more in given.items():
            arguments = ros_arguments(spaces[module], {'use_sim_time': True, **more})
            started[module] = spaces[module], stack.enter_context(graph.run(module, arguments))
        yield started
        for _, process in started.values():
            os.kill(process.pid, signal.SIGINT)  # all at once, and each once
        for _, process in started.values():
            process.wait()


@pytest.fixture
def nodes(running: dict[str, tuple[str, Process]]) -> dict[str, str]:
    """Return the namespaces of nodes that run, whatever they have heard."""
    assert [module for module, (_, process) in running.items() if process.exit_code is not None] == []
    return {module: namespace for module, (namespace, _) in running.items()}


def test_sim_node_answers_a_sane_sample_after_every_message(graph: Graph, nodes: dict[str, str]) -> None:
    sim = SimClient(graph, nodes['sim_node']).meet()
    stamp = SANE

    def is_answered() -> None:
        nonlocal stamp
        stamp += MILLISECOND
        sim.sample(stamp, 0.0)

    ignored = sim.count('ignored stamps')
    for message in pistons():
        sim.piston_out.publish(message)
        is_answered()
    assert sim.count('ignored stamps') == ignored + len(NO_TIMES)
    for value in NUMBERS:
        sim.setpoint(0, value)
        sim.setpoint(1, value)
        sim.force_setpoint(value)
        is_answered()
    assert all(message.header.stamp.sec >= 0 for messages in sim.heard.values() for message in messages)
    bad = JointState(header=Header(stamp=NO_TIMES[-1]), name=['piston'], position=[0.0])
    status = graph.next_diagnostics(
        sim.node, lambda status: 'invalid stamp' in status.message, doing=lambda: sim.piston_out.publish(bad)
    )
    assert status.level != DiagnosticStatus.OK


def test_no_preview_leaves_the_range_of_stamps(graph: Graph, nodes: dict[str, str]) -> None:
    sim = SimClient(graph, nodes['sim_node']).meet()
    sim.sample(LATEST, 0.0)
    graph.next_diagnostics(sim.node, lambda status: 'silent' in status.message)
    sim.sample(LATEST - 900 * MILLISECOND, 0.0)
    graph.next_diagnostics(sim.node, lambda status: 'silent' in status.message)
    pressures = sim.series(pressure_topic('cylinder_a'), previews=True)
    assert LATEST - 900 * MILLISECOND < pressures[-1][0] <= LATEST, 'the last one is a preview'
    sim.sample(SANE, 0.0)


class MonitorClient:
    """Plays the device to a `monitor_node`, from a stamp on."""

    def __init__(self, graph: Graph, namespace: str, stamp: int) -> None:
        self.graph, self.node, self.stamp = graph, f'{namespace}/monitor_node', stamp
        self.piston_out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
        self.pressures_out = [graph.publisher(FluidPressure, f'{namespace}/{topic}') for topic in MEASURED[1:3]]
        self.force_out = graph.publisher(WrenchStamped, f'{namespace}/{MEASURED_FORCE}')
        outs = [self.piston_out, *self.pressures_out, self.force_out]
        graph.until(lambda: all(out.get_subscription_count() for out in outs))
        self.predicted = graph.listen(FluidPressure, f'{namespace}/{PREDICTED}{pressure_topic("cylinder_a")}')
        graph.until(lambda: self.predicted, doing=lambda: self.send(REST))
        assert graph.trigger(f'{self.node}/learn').success

    def send(self, pressure: float) -> None:
        self.stamp += 2 * MILLISECOND
        self.pressure = pressure
        header = Header(stamp=stamp_message(self.stamp))
        self.piston_out.publish(JointState(header=header, name=['piston'], position=[0.0]))
        for out in self.pressures_out:
            out.publish(FluidPressure(header=header, fluid_pressure=pressure))
        self.force_out.publish(WrenchStamped(header=header))

    def is_answered(self) -> None:
        """Wait until a sample is answered: the last one, or one after it, for a busy node sheds what waits too long."""
        sent = {self.stamp}

        def send_another() -> None:
            self.send(self.pressure)
            sent.add(self.stamp)

        self.graph.until(lambda: nanoseconds(self.predicted[-1].header.stamp) in sent, doing=send_another, every=1.0)

    def learns(self, pressure: Callable[[int], float]) -> None:
        """Send samples, no faster than they are answered, until it has learned."""

        def samples() -> None:
            for _ in range(200):
                self.send(pressure(self.stamp))
            self.is_answered()

        for name in (*CYLINDERS, CONTACT_FORCE):
            self.graph.next_diagnostics(
                self.node,
                lambda one, name=name: one.name.endswith(name) and not one.message.startswith('learning'),
                doing=samples,
            )


def test_monitor_node_learns_from_signals_that_never_change(graph: Graph, nodes: dict[str, str]) -> None:
    """It died of a residual whose spread was nothing."""
    MonitorClient(graph, nodes['monitor_node'], 2 * SANE).learns(lambda _: REST)


@pytest.mark.slow
def test_monitor_node_predicts_a_sane_sample_after_every_message_and_learns(
    graph: Graph, nodes: dict[str, str]
) -> None:
    client = MonitorClient(graph, nodes['monitor_node'], SANE)
    setpoint_out = graph.publisher(Float64, f'{nodes["monitor_node"]}/{setpoint_topic("cylinder_a")}')
    graph.until(setpoint_out.get_subscription_count)

    def is_answered() -> None:
        client.send(REST)
        client.is_answered()

    for message in pistons():
        client.piston_out.publish(message)
        is_answered()
    for value in NUMBERS:
        setpoint_out.publish(Float64(data=value))
        is_answered()
    for header, value in [*((header, REST) for header in headers()), *((None, value) for value in NUMBERS)]:
        header = header or Header(stamp=stamp_message(client.stamp + MILLISECOND))
        for out in client.pressures_out:
            out.publish(FluidPressure(header=header, fluid_pressure=value, variance=value))
        force = WrenchStamped(header=header)
        force.wrench.force.x = force.wrench.torque.z = value
        client.force_out.publish(force)
        is_answered()
    status = graph.next_diagnostics(client.node, lambda status: status.name.endswith('feed'))
    assert int(counted(status)['ignored stamps']) == 4 * len(NO_TIMES)
    client.learns(lambda stamp: REST + stamp % 7)


def test_rig_node_obeys_after_every_message(graph: Graph, nodes: dict[str, str]) -> None:
    namespace = nodes['rig_node']
    outs = [
        graph.publisher(Float64, f'{namespace}/{topic}') for topic in (PISTON_COMMAND, *map(setpoint_topic, CYLINDERS))
    ]
    heard = graph.listen(JointState, f'{namespace}/{PISTON_STATE}')
    graph.until(lambda: all(out.get_subscription_count() for out in outs))
    for index, value in enumerate(NUMBERS):
        for out in outs:
            out.publish(Float64(data=value))
        sane = 1e-3 * (-1) ** index
        outs[0].publish(Float64(data=sane))
        graph.until(lambda sane=sane: heard and abs(heard[-1].position[0] - sane) < 1e-4)


def test_recorder_node_records_every_message(graph: Graph, tmp_path: Path) -> None:
    namespace, bag = unique_namespace(), tmp_path / 'bag'
    topic = f'{namespace}/{PISTON_STATE}'
    out = graph.publisher(JointState, topic)
    arguments = ros_arguments(namespace, {'topics': f'[{topic}]', 'output': bag})
    with graph.run('recorder_node', arguments) as process:
        graph.until(lambda: out.get_subscription_count() and f'recording {topic}' in process.stderr)
        messages = list(pistons())
        for message in messages:
            out.publish(message)
        assert out.wait_for_all_acked()
        assert graph.get(f'{namespace}/recorder_node', 'output') == [str(bag)]  # behind the messages
    with Reader(bag) as reader:
        assert reader.message_count == len(messages)
    with pytest.raises(InputError, match='not a message type'):  # a topic of another system
        message_class('HelloWorld')


def test_identifier_node_refuses_what_the_system_cannot_take(
    graph: Graph, nodes: dict[str, str], tmp_path: Path
) -> None:
    node = f'{nodes["identifier_node"]}/identifier_node'
    good = {'bags': [str(tmp_path)], 'split': '60/20/20', 'apply_to': ''}
    assert graph.set_atomically(node, output_dir=str(tmp_path / 'out'), **good).successful
    for name, value, why in (
        ('bags', ['x' * 5000], 'outside input_folders'),
        ('bags', [str(tmp_path / ('x' * 5000))], 'cannot be used as a path'),
        ('apply_to', '{nobody}', "parameter 'apply_to' is '{nobody}'"),
        ('apply_to', 'x' * 300, "parameter 'apply_to' is"),
    ):
        assert graph.set(node, **{name: value}).successful
        answer = graph.trigger(f'{node}/identify')
        assert not answer.success
        assert why in answer.message
        assert graph.set(node, **{name: good[name]}).successful
    assert graph.trigger(f'{node}/identify').success


MEBIBYTE = 2**20


def memory(pid: int, what: str = 'VmHWM') -> float:
    """Return the most memory that a process has had so far, or what it has now of a kind [MiB]."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    (line,) = (line for line in status.splitlines() if line.startswith(what))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize('module', ['sim_node', 'monitor_node', 'recorder_node'])
def test_large_messages_leave_memory_and_samples_alone(graph: Graph, tmp_path: Path, module: str) -> None:
    """A full queue of these messages would take 2.4 GB."""
    namespace = unique_namespace()
    topic = f'{namespace}/{PISTON_STATE}'
    large = bytes(serialize_message(JointState(name=[f'{index:09}' for index in range(20_000)])))
    record = {'topics': f'[{topic}]', 'output': tmp_path / 'bag'} if module == 'recorder_node' else {}
    out = graph.node.create_publisher(JointState, topic, QoSProfile(depth=1))
    with graph.run(module, ros_arguments(namespace, record)) as process:
        graph.until(out.get_subscription_count)
        before, peak = memory(process.pid, 'RssAnon'), memory(process.pid)
        limit = time.monotonic() + 5.0
        while time.monotonic() < limit:
            out.publish(large)
        graph.get(f'{namespace}/{module}', 'use_sim_time')  # behind the messages
        graph.until(lambda: memory(process.pid, 'RssAnon') < before + 100.0)
        assert memory(process.pid) < peak + 400.0
        if module == 'sim_node':
            sim = SimClient(graph, namespace).meet()
            sim.sample(SANE, 0.0)


def test_large_requests_leave_the_memory_alone(graph: Graph) -> None:
    """Without a bound a thousand of them would wait."""
    namespace = unique_namespace()
    node = f'{namespace}/sim_node'
    request = SetParameters.Request(
        parameters=[Parameter(name='frame_id', value=ParameterValue(type=4, string_value='x' * MEBIBYTE))]
    )
    client = graph.node.create_client(SetParameters, f'{node}/set_parameters')
    with graph.run('sim_node', ros_arguments(namespace)) as process:
        graph.until(client.service_is_ready)
        before = memory(process.pid, 'RssAnon')
        for _ in range(500):
            client.call_async(request)
        refusal = graph.set(node, frame_id='x' * 1000)
        assert (refusal.successful, 'must have 1 to 256 characters' in refusal.reason) == (False, True)
        assert 'the limit is 32,768' in graph.set(node, hardware_id='x' * 100_000).reason
        graph.until(lambda: memory(process.pid, 'RssAnon') < before + 100.0)


def test_a_request_names_each_parameter_once(graph: Graph, nodes: dict[str, str]) -> None:
    """A monitor that learned anew 10,000 times would answer nothing for minutes."""
    node = f'{nodes["monitor_node"]}/monitor_node'
    value = ParameterValue(type=3, double_value=1e-3)
    for names in (['area'] * 10_000, [f'nobody_{index}' for index in range(10_000)]):
        request = SetParameters.Request(parameters=[Parameter(name=name, value=value) for name in names])
        results = graph.call(SetParameters, f'{node}/set_parameters', request).results
        assert len(results) == len(names)
        assert not any(result.successful for result in results)
        assert 'each parameter once' in results[0].reason
        assert graph.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values == []


REQUESTS = {
    ListParameters: ('list_parameters', 'prefixes'),
    DescribeParameters: ('describe_parameters', 'names'),
    GetParameters: ('get_parameters', 'names'),
    GetParameterTypes: ('get_parameter_types', 'names'),
    SetParameters: ('set_parameters', 'parameters'),
    SetParametersAtomically: ('set_parameters_atomically', 'parameters'),
}


@pytest.mark.parametrize('module', MODULES)
def test_no_request_about_parameters_ends_a_node(graph: Graph, nodes: dict[str, str], module: str) -> None:
    """Those with a name twice were answered with the answer to another service, which ended the node."""
    node = f'{nodes[module]}/{module}'
    for names in (['a', 'a'], [f'a{index}' for index in range(501)], [''], ['x' * 10_000], ['a.', '.a', '/'], []):
        for service, (name, field) in REQUESTS.items():
            asked = [Parameter(name=one) for one in names] if field == 'parameters' else names
            answer = graph.call(service, f'{node}/{name}', service.Request(**{field: asked}))
            if len(names) in (2, 501):
                told = answer.result.names if service is ListParameters else getattr(answer, 'values', [])
                assert list(told) == []
    assert graph.get(node, 'use_sim_time') == [True]


def test_a_queue_shortened_for_large_messages_gets_its_depth_back(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(topics, '_CALM_TIME', 0.5)
    monkeypatch.setattr(topics, '_SHORT_WAIT', 0)  # as if each message had waited
    namespace = unique_namespace()
    taken: list[bytes] = []
    said: list[str] = []
    topic = f'{namespace}/text'
    out = graph.publisher(String, topic)
    with graph.run_here(Node('listener', context=graph.context)) as node:
        subscribe(node, String, topic, taken.append, QoSProfile(depth=100), True, on_large=said.append, budget=100_000)

        def depths() -> list[int]:
            return [one.qos_profile.depth for one in node.subscriptions]

        graph.until(out.get_subscription_count)
        graph.until(lambda: depths() == [9], doing=lambda: out.publish(String(data='x' * 10_000)))
        graph.until(lambda: depths() == [100], doing=lambda: out.publish(String(data='small')))
        count = len(taken)
        graph.until(lambda: len(taken) > count, doing=lambda: out.publish(String(data='small')))
    assert len(said) == 1
    assert 'At most 9 messages wait' in said[0]


def test_a_clock_that_is_no_time_changes_nothing(graph: Graph, nodes: dict[str, str]) -> None:
    clock = graph.publisher(Clock, '/clock')
    graph.until(lambda: clock.get_subscription_count() == len(nodes))
    for moment, (module, namespace) in product(NO_TIMES, nodes.items()):
        clock.publish(Clock(clock=moment))
        assert graph.set(f'{namespace}/{module}', use_sim_time=True).successful  # which rclpy tells with a stamp


def test_what_is_stamped_with_the_last_time_of_a_clock_is_survived(graph: Graph, nodes: dict[str, str]) -> None:
    clock = graph.publisher(Clock, '/clock')
    last = Clock(clock=stamp_message(LATEST))
    device = unique_namespace()
    schedule = {'use_sim_time': True, 'schedule': 'paper_step', 'start_subscribers': 1}
    with graph.run('rig_node', ros_arguments(device, schedule)) as rig:
        graph.until(lambda: clock.get_subscription_count() == len(nodes) + 1)  # it must not play at another time
        client = SimClient(graph, nodes['sim_node']).meet()  # one answer has the last time, and must not be missed
        graph.until(
            lambda: any(
                message.header.stamp.sec == 2**31 - 1 for message in client.heard[pressure_topic('cylinder_a')]
            ),
            doing=lambda: (clock.publish(last), client.send(0, 0.0)),
        )
        client.sample(SANE, 0.0)
        graph.listen(JointState, f'{device}/{PISTON_STATE}')
        graph.until(lambda: 'exceeds what a ROS stamp can hold' in rig.stderr, doing=lambda: clock.publish(last))
        graph.until(lambda: 'played 350 samples' in rig.stderr)


PARAMETER_VALUES = (
    *(ParameterValue(type=3, double_value=value) for value in (*NUMBERS, sys.float_info.max)),
    *(ParameterValue(type=8, double_array_value=[value] * count) for value in NUMBERS for count in (1, 4)),
    *(ParameterValue(type=8, double_array_value=values) for values in ([], [1.0] * 100_000)),
    *(ParameterValue(type=2, integer_value=value) for value in (-(2**63), 2**63 - 1, 0)),
    *(ParameterValue(type=7, integer_array_value=values) for values in ([], [2**63 - 1])),
    *(ParameterValue(type=4, string_value=text) for text in TEXTS),
    *(ParameterValue(type=9, string_array_value=texts) for texts in ([], TEXTS, [''] * 10_000)),
    *(ParameterValue(type=1, bool_value=value) for value in (False, True)),
    *(ParameterValue(type=kind) for kind in (0, 5, 6, 10, 200, 255)),
)


@pytest.mark.parametrize('module', MODULES)
def test_no_value_of_a_parameter_ends_a_node(graph: Graph, nodes: dict[str, str], module: str) -> None:
    namespace = nodes[module]
    node = f'{namespace}/{module}'

    def put(parameters: Iterable[Parameter]) -> list[Any]:
        request = SetParameters.Request(parameters=list(parameters))
        return graph.call(SetParameters, f'{node}/set_parameters', request).results

    names = graph.call(ListParameters, f'{node}/list_parameters').result.names
    # those of effects are alike, and those of the cylinders
    names = [name for name in names if name.count('.') < 2 and not name.startswith('cylinder_b.')]
    for name in (*names, '', 'not_there'):
        results = put(Parameter(name=name, value=value) for value in PARAMETER_VALUES)
        assert len(results) == len(PARAMETER_VALUES)
    if module == 'sim_node':
        put([Parameter(name='joint', value=ParameterValue(type=4, string_value='piston'))])
        put([Parameter(name='frame_id', value=ParameterValue(type=4, string_value='cfd'))])
        SimClient(graph, namespace).meet().sample(SANE, 0.0)
