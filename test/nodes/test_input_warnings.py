# SPDX-License-Identifier: Apache-2.0
"""Input that a node takes and that is likely wrong: `/diagnostics` warns as long as it lasts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from graph import MILLISECOND, Graph, SimClient, refusals, ros_arguments, unique_namespace
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float32, Float64, Header

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS, FORCE_SETPOINT, PISTON_STATE, setpoint_topic
from cfd_pneumatic.device import Device, IdentifiedRange
from cfd_pneumatic.nodes.input_range import InputRange
from cfd_pneumatic.nodes.messages import COMMAND_QOS, stamp_message
from cfd_pneumatic.nodes.parameter_files import unread_files
from cfd_pneumatic.nodes.topics import subscribe_latched
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.units import PSI

SET = 10 * PSI
GAINS = {'setpoints': (SET,), 'k_x': (5.4e6,), 'k_sv': (165.0,), 'k_v': (30.0,), 'tau': (0.012,)}
IDENTIFIED = {
    'area': 1.14e-3,
    **{f'{name}.{gain}': value for name in CYLINDERS for gain, value in GAINS.items()},
    'identified_displacement': (0.0, 3e-3),
    'identified_speed': 0.1,
    **{f'{name}.identified_setpoints': (5 * PSI, 15 * PSI) for name in CYLINDERS},
    **{f'{name}.identified_pressures': (AMBIENT_PRESSURE, AMBIENT_PRESSURE + 20 * PSI) for name in CYLINDERS},
}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture(scope='module')
def described(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the parameter file of a device that was identified."""
    file = tmp_path_factory.mktemp('device') / 'parameters.yaml'
    Device(IDENTIFIED).save(file)
    return file


@pytest.fixture(scope='module')
def shared(graph: Graph, described: Path) -> Iterator[SimClient]:
    namespace = unique_namespace()
    with graph.run('sim_node', [*ros_arguments(namespace), '--params-file', str(described)]):
        yield SimClient(graph, namespace).meet()


STAMPS = count(10**18, 2 * MILLISECOND)


def following(sim: SimClient, position: Callable[[float], float] = lambda _: 1e-3) -> Callable[[], None]:
    """Return a function that sends ten samples, of a function of the time."""

    def send() -> None:
        for stamp in (next(STAMPS) for _ in range(10)):
            sim.send(stamp, position((stamp - 10**18) * 1e-9))

    return send


@pytest.fixture
def sim(shared: SimClient) -> SimClient:
    """Return a node that has nothing to say against its input."""
    for index in range(2):
        shared.setpoint(index, SET)
    shared.restart()
    report(shared, lambda one: one.level == one.OK, following(shared))
    return shared


def report(
    sim: SimClient, accept: Callable[[DiagnosticStatus], bool], doing: Callable[[], None] | None = None
) -> DiagnosticStatus:
    return sim.graph.next_diagnostics(sim.node, accept, doing=doing)


def warns_while(sim: SimClient, words: str, doing: Callable[[], None]) -> None:
    """Make sure that a node warns as long as something is done, and no longer."""
    for _ in range(3):
        status = report(sim, lambda one: words in one.message, doing)
        assert status.level in (status.WARN, status.ERROR)
    report(sim, lambda one: one.level == one.OK, following(sim))


@pytest.mark.parametrize(
    ('position', 'words'),
    [
        (lambda time: 1.0 + 0.01 * np.sin(time), 'which looks like millimetres: publish metres'),
        (lambda time: 4e-3, 'outside the identified 0 to 0.003 m'),
        (lambda time: 1.5e-3 + 1.4e-3 * np.sin(150.0 * time), 'faster than the identified 0.1 m/s'),
    ],
)
def test_displacements_beyond_what_was_identified_are_a_warning(
    sim: SimClient, position: Callable[[float], float], words: str
) -> None:
    warns_while(sim, words, following(sim, position))


@pytest.mark.parametrize(
    ('setpoint', 'words'),
    [
        (0.7, 'looks like bar: publish Pa above ambient'),
        (10.0, 'looks like psi'),
        (69.0, 'looks like kPa'),
        (690.0, 'looks like mbar'),
        (30 * PSI, f'outside the identified {5 * PSI:.6g} to {15 * PSI:.6g} Pa'),
    ],
)
def test_set_points_that_are_none_are_a_warning(sim: SimClient, setpoint: float, words: str) -> None:
    sim.setpoint(1, setpoint)
    for _ in range(2):
        status = report(sim, lambda one: words in one.message, following(sim))
        assert status.level == status.WARN
        assert setpoint_topic(CYLINDERS[1]) in status.message


def test_no_impossible_pressure_is_answered(sim: SimClient) -> None:
    """As to a displacement in millimetres: with the model's gains a millimetre a sample is megapascals."""
    ignored = sim.count('ignored samples')
    millimetres = following(sim, lambda time: 0.5 + 0.5 * np.sin(20.0 * time))
    status = report(
        sim, lambda one: 'would give a pressure below vacuum, or above the supply' in one.message, millimetres
    )
    assert status.level in (status.WARN, status.ERROR)
    report(sim, lambda one: one.level == one.OK, following(sim))
    assert sim.count('ignored samples') > ignored
    pressures = [value for name in CYLINDERS for _, value in sim.series(f'{name}/pressure')]
    assert min(pressures) >= 0.0
    assert max(pressures) <= sim.graph.get(sim.node, 'supply_pressure')[0] + AMBIENT_PRESSURE


def test_two_who_publish_the_piston_are_named(graph: Graph, sim: SimClient) -> None:
    other = Node('second_driver', context=graph.context)
    publisher = other.create_publisher(JointState, sim.piston_out.topic_name, QoSProfile(depth=1))
    for _ in range(2):
        status = report(sim, lambda one: '2 publish piston_state' in one.message, following(sim))
        assert status.level == status.WARN
        assert '/second_driver' in status.message
        assert graph.node.get_name() in status.message
    publisher.destroy()
    other.destroy_node()
    report(sim, lambda one: one.level == one.OK, following(sim))


def test_a_best_effort_set_point_is_a_warning_while_somebody_publishes_it(graph: Graph, sim: SimClient) -> None:
    topic = sim.setpoints_out[0].topic_name
    other = graph.node.create_publisher(Float64, topic, BEST_EFFORT)
    for _ in range(3):
        status = report(sim, lambda one: 'is best effort, and not received' in one.message, following(sim))
        assert status.level == status.WARN
        assert setpoint_topic(CYLINDERS[0]) in status.message
    graph.node.destroy_publisher(other)
    report(sim, lambda one: one.level == one.OK, following(sim))


def test_other_joints_on_the_topic_are_no_warning(graph: Graph, sim: SimClient) -> None:
    arm = Node('arm_driver', context=graph.context)
    publisher = arm.create_publisher(JointState, sim.piston_out.topic_name, QoSProfile(depth=1))
    graph.until(lambda: publisher.get_subscription_count())
    send = following(sim)

    def both() -> None:
        publisher.publish(JointState(name=['j1', 'j2'], position=[0.1, 0.2]))
        send()
        publisher.publish(JointState(name=['j1', 'j2'], position=[0.1, 0.2]))

    report(sim, lambda one: one.level == one.OK, both)
    for _ in range(5):
        assert report(sim, lambda _: True, both).message == 'following piston_state'
    second = graph.node.create_publisher(JointState, sim.piston_out.topic_name, QoSProfile(depth=1))
    publisher.destroy()
    arm.destroy_node()
    report(sim, lambda one: '2 publish piston_state' in one.message, following(sim))
    graph.node.destroy_publisher(second)
    report(sim, lambda one: one.level == one.OK, following(sim))


def test_a_best_effort_force_set_point_is_a_warning_while_somebody_publishes_it(graph: Graph, sim: SimClient) -> None:
    other = graph.node.create_publisher(Float64, sim.force_out.topic_name, BEST_EFFORT)
    for _ in range(3):
        status = report(sim, lambda one: 'is best effort, and not received' in one.message, following(sim))
        assert FORCE_SETPOINT in status.message
    graph.node.destroy_publisher(other)
    report(sim, lambda one: one.level == one.OK, following(sim))


@pytest.mark.parametrize('topic', [PISTON_STATE, setpoint_topic(CYLINDERS[0])])
def test_a_wrong_message_type_is_named_while_somebody_publishes_it(graph: Graph, sim: SimClient, topic: str) -> None:
    context = Context()  # the middleware refuses a second type of a topic in one process and context
    rclpy.init(context=context)
    other = Node('wrong_type', context=context)
    publisher = other.create_publisher(Float32, f'{sim.node.rpartition("/")[0]}/{topic}', QoSProfile(depth=1))
    expected = 'sensor_msgs/msg/JointState' if topic == PISTON_STATE else 'std_msgs/msg/Float64'
    message = f'{topic} of /wrong_type is std_msgs/msg/Float32, and not received: publish {expected}'
    for _ in range(3):
        status = report(sim, lambda one: message in one.message, following(sim))
        assert status.level == status.WARN
        assert '2 publish' not in status.message
    publisher.destroy()
    other.destroy_node()
    rclpy.shutdown(context=context)
    report(sim, lambda one: one.level == one.OK, following(sim))


def test_publishers_are_compared_with_the_qos_that_acts(graph: Graph, described: Path) -> None:
    """As `qos_overrides` set it, in either direction."""
    namespace = unique_namespace()
    node = f'{namespace}/monitor_node'
    topics = {
        topic: f'{namespace}/{topic}' for topic in (setpoint_topic('cylinder_a'), PISTON_STATE, 'cylinder_a/pressure')
    }
    overrides = {f'qos_overrides.{topic}.subscription.reliability': 'reliable' for topic in topics.values()}
    overrides[f'qos_overrides.{topics[setpoint_topic("cylinder_a")]}.subscription.reliability'] = 'best_effort'
    outs = [
        graph.node.create_publisher(message_type, topic, BEST_EFFORT)
        for message_type, topic in zip((Float64, JointState, FluidPressure), topics.values())
    ]
    subscriber = graph.node.create_subscription(JointState, f'{namespace}/joint_states', lambda _: None, BEST_EFFORT)
    with graph.run('monitor_node', [*ros_arguments(namespace, overrides), '--params-file', str(described)]):
        unheard = [
            f'{topic} of /{graph.node.get_name()} is best effort' for topic in (PISTON_STATE, 'cylinder_a/pressure')
        ]
        for _ in range(3):
            status = graph.next_diagnostics(node, lambda one: all(warning in one.message for warning in unheard))
            assert 'cylinder_a/setpoint of' not in status.message
            assert subscriber.topic_name not in status.message
    graph.node.destroy_subscription(subscriber)
    for out in outs:
        graph.node.destroy_publisher(out)


@pytest.mark.parametrize('module', ['sim_node', 'monitor_node'])
def test_a_node_that_nobody_told_anything_says_what_acts(graph: Graph, tmp_path: Path, module: str) -> None:
    namespace = unique_namespace()
    file = tmp_path / 'parameters.yaml'
    text = Device(IDENTIFIED).text
    file.write_text(text.replace('/**:', '/cell/other_node:'))
    joints = graph.node.create_publisher(JointState, f'{namespace}/robot/joint_states', QoSProfile(depth=1))
    outs = [graph.publisher(Float64, f'{namespace}/{setpoint_topic(name)}') for name in CYLINDERS]
    with graph.run(module, [*ros_arguments(namespace), '--params-file', str(file)]):
        node = f'{namespace}/{module}'

        def told(words: str, doing: Callable[[], None] | None = None) -> DiagnosticStatus:
            return graph.next_diagnostics(node, lambda one: words in one.message, doing=doing)

        status = told('no piston_state yet')
        assert f'{file} has parameters for /cell/other_node, and not for {node}' in status.message
        assert joints.topic_name in status.message.partition('joints are published on ')[2]
        for name in CYLINDERS:
            assert f'no {setpoint_topic(name)} yet: initial_setpoint {SET:.0f} Pa acts' in status.message

        def set_both() -> None:
            for out in outs:
                out.publish(Float64(data=SET))

        graph.next_diagnostics(node, lambda one: 'no cylinder_' not in one.message, doing=set_both)
    graph.node.destroy_publisher(joints)
    with graph.run(module, ros_arguments(namespace)):
        told("no parameter file: the paper's Table 1 and the default area act")


def test_measured_pressures_in_another_unit_are_a_warning(graph: Graph, described: Path) -> None:
    """And other joints on the topic are none, as those of an arm."""
    namespace = unique_namespace()
    pistons, arm = (graph.publisher(JointState, f'{namespace}/{PISTON_STATE}') for _ in range(2))
    setpoints = [graph.publisher(Float64, f'{namespace}/{setpoint_topic(name)}') for name in CYLINDERS]
    pressures = [graph.publisher(FluidPressure, f'{namespace}/{name}/pressure') for name in CYLINDERS]
    stamps = count(10**18, MILLISECOND)

    def feed(unit: float = 1.0, is_silent: bool = False) -> None:
        for stamp in map(stamp_message, islice(stamps, 10)):
            arm.publish(JointState(name=['j1'], position=[0.1]))
            if not is_silent:
                pistons.publish(JointState(header=Header(stamp=stamp), name=['piston'], position=[1e-3]))
            for setpoint, pressure in zip(setpoints, pressures):
                setpoint.publish(Float64(data=SET))
                absolute = AMBIENT_PRESSURE + SET
                pressure.publish(FluidPressure(header=Header(stamp=stamp), fluid_pressure=absolute / unit))
            arm.publish(JointState(name=['j1'], position=[0.1]))

    with graph.run('monitor_node', [*ros_arguments(namespace), '--params-file', str(described)]):

        def report(message: str, doing: Callable[[], None]) -> DiagnosticStatus:
            return graph.next_diagnostics(
                f'{namespace}/monitor_node', lambda one: 'feed' in one.name and message in one.message, doing=doing
            )

        assert '2 publish' not in report('no piston_state yet', lambda: None).message
        report('following piston_state', feed)
        for _ in range(3):
            status = report('', feed)
            assert (status.level, status.message) == (status.OK, 'following piston_state')
        for _ in range(2):
            status = report('it looks like kPa, publish absolute Pa', partial(feed, 1e3))
            assert status.level == status.WARN
        report('following piston_state', feed)
        report("no joint 'piston', but ['j1']", partial(feed, is_silent=True))


def test_a_file_for_another_node_only_is_a_warning(graph: Graph, described: Path, tmp_path: Path) -> None:
    """Also next to a file that describes the device, and if it does not describe any."""
    namespace = unique_namespace()
    overlay = tmp_path / 'overlay.yaml'
    overlay.write_text('/cell_7/sim_node:\n  ros__parameters: {joint: slide}\n')
    warning = (
        f'{overlay} has parameters for /cell_7/sim_node, and not for {namespace}/sim_node: begin the file with /**:'
    )
    for others in (['--params-file', str(described)], []):
        with graph.run('sim_node', [*ros_arguments(namespace), *others, '--params-file', str(overlay)]):
            status = graph.next_diagnostics(f'{namespace}/sim_node', lambda one: 'no piston_state' in one.message)
            assert warning in status.message
            assert 'no parameter file' not in status.message
            assert ('no gains of cylinder_a, cylinder_b and no area' in status.message) == (not others)


@pytest.mark.parametrize(
    'section',
    [
        '/**',
        '**',
        '/cell/sim_node',
        'cell/sim_node',
        '/**/sim_node',
        '/*/sim_node',
        '/cell/*',
        '/cell/**',
        '/cell/**/sim_node',
        'sim_node',
        '/sim_node',
        '/*',
        '/cell',
        '/cell/*/sim_node',
    ],
)
def test_sections_are_compared_as_ros_does(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, section: str) -> None:
    file = tmp_path / 'file.yaml'
    file.write_text(f'"{section}":\n  ros__parameters: {{joint: slide}}\n')
    context = Context()
    arguments = ['--ros-args', '--params-file', str(file)]
    monkeypatch.setattr('sys.argv', ['sim_node', *arguments])
    rclpy.init(args=arguments, context=context)
    node = Node('sim_node', namespace='/cell', context=context)
    try:
        assert (list(unread_files(node)) == []) == ('joint' in node._parameter_overrides)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_gains_of_table_1_are_a_warning_until_there_are_others(graph: Graph) -> None:
    namespace = unique_namespace()
    node = f'{namespace}/sim_node'
    with graph.run('sim_node', ros_arguments(namespace, {'area': 0.002})):
        warning = "no gains of cylinder_a, cylinder_b: the paper's Table 1 acts"
        graph.next_diagnostics(node, lambda one: warning in one.message)
        for name, left in (('cylinder_a', 'no gains of cylinder_b: '), ('cylinder_b', '')):
            result = graph.set_atomically(node, **{f'{name}__{gain}': list(value) for gain, value in GAINS.items()})
            assert result.successful, result.reason
            graph.next_diagnostics(node, lambda one, left=left: left in one.message)
        assert 'no gains' not in graph.next_diagnostics(node, lambda _: True).message


def test_stamps_that_stand_still_are_a_warning(sim: SimClient) -> None:
    def send(new: int) -> None:
        """Send ten samples, of which so many have a new stamp."""
        for index in range(10):
            sim.send(next(STAMPS) if index < new else sim.stamp, 1e-3)

    warns_while(sim, 'the stamps of piston_state do not advance', partial(send, 0))
    report(sim, lambda one: one.level == one.OK, partial(send, 5))
    for _ in range(3):
        assert report(sim, lambda _: True, partial(send, 5)).level == DiagnosticStatus.OK


@pytest.mark.parametrize('setpoint', [float('nan'), 1e7])
def test_a_refused_set_point_is_a_warning_until_another_one_comes(sim: SimClient, setpoint: float) -> None:
    sim.setpoint(0, setpoint)
    sim.setpoint(1, SET)
    report(sim, lambda one: 'ignored: cylinder_a/setpoint' in one.message, following(sim))
    for _ in range(3):
        status = report(sim, lambda _: True, following(sim))
        assert status.level == status.WARN
        assert 'the set-point before acts' in status.message
    sim.setpoint(0, SET)
    report(sim, lambda one: one.level == one.OK, following(sim))


def test_a_supply_below_a_set_point_that_acts_is_refused(sim: SimClient) -> None:
    result = sim.graph.set(sim.node, supply_pressure=0.5 * SET)
    assert not result.successful
    assert f'cylinder_a/setpoint is {SET:.0f} Pa, above the supply pressure {0.5 * SET:.0f} Pa' in result.reason
    assert report(sim, lambda _: True, following(sim)).level == DiagnosticStatus.OK


def test_a_force_is_a_set_point_of_both(graph: Graph, described: Path) -> None:
    namespace = unique_namespace()
    out = graph.node.create_publisher(Float64, f'{namespace}/{FORCE_SETPOINT}', LATCHED)
    out.publish(Float64(data=5.0))
    with graph.run('sim_node', [*ros_arguments(namespace), '--params-file', str(described)]):
        sim = SimClient(graph, namespace).meet()
        report(sim, lambda one: one.level == one.OK, following(sim))


def test_a_set_point_that_was_sent_before_the_node_came_is_heard(graph: Graph, described: Path) -> None:
    namespace = unique_namespace()
    for index, name in enumerate(CYLINDERS):
        out = graph.node.create_publisher(Float64, f'{namespace}/{setpoint_topic(name)}', LATCHED)
        out.publish(Float64(data=SET + 1e3 * index))
    with graph.run('sim_node', [*ros_arguments(namespace), '--params-file', str(described)]):
        sim = SimClient(graph, namespace).meet()
        status = report(sim, lambda one: one.level == one.OK, following(sim))
    values = {value.key: value.value for value in status.values}
    assert values['cylinder_a set-point, gauge [Pa]'] == f'{SET:.1f}'
    assert values['cylinder_b set-point, gauge [Pa]'] == f'{SET + 1e3:.1f}'


@pytest.mark.parametrize('latched', [True, False])
def test_a_value_that_two_subscriptions_hear_counts_once(graph: Graph, latched: bool) -> None:
    topic = f'{unique_namespace()}/value'
    out = graph.node.create_publisher(Float64, topic, LATCHED if latched else QoSProfile(depth=100))
    taken: list[float] = []
    with graph.run_here(Node('listener', context=graph.context)) as node:
        subscribe_latched(node, Float64, topic, lambda message: taken.append(message.data), COMMAND_QOS)
        graph.until(lambda: out.get_subscription_count() == 1 + latched)
        sent = [float(index) for index in range(20)]

        def publish() -> None:
            if len(taken) < len(sent):
                out.publish(Float64(data=sent[len(taken)]))

        graph.until(lambda: len(taken) >= len(sent), doing=publish, every=0.01)
        graph.until(lambda: True)
    assert sorted(set(taken)) == sent
    assert taken == sorted(taken)


def test_arguments_that_ros_does_not_take_are_corrected_in_one_line(tmp_path: Path) -> None:
    """The command line in the message can be pasted into a shell."""
    blank = tmp_path / 'my file'
    blank.touch()
    corrected = {
        ('p.yaml',): '--params-file p.yaml',
        ('--params-file', 'p.yaml'): '--params-file p.yaml',
        ('p.yaml', '--ros-args', '-r', '__ns:=/a'): '-r __ns:=/a --params-file p.yaml',
        ('--ros-args', 'p.yaml'): '--params-file p.yaml',
        ('--ros-args', '-r', '__ns:=/a', 'P.YAML'): '-r __ns:=/a --params-file P.YAML',
        ('--ros-args', '--params-file=p.yaml'): '--params-file p.yaml',
        ('--params-file:=p.yaml',): '--params-file p.yaml',
        ('--ros-args', '--param-file', 'p.yaml'): '--params-file p.yaml',
        ('params_file:=p.yaml',): '--params-file p.yaml',
        ('--ros-args', '--params-file', 'a.yaml', 'b.yaml'): '--params-file a.yaml --params-file b.yaml',
        ('a.yaml', 'b.yaml'): '--params-file a.yaml --params-file b.yaml',
        ('my file.yaml', '-x'): "--params-file 'my file.yaml'",
        (str(blank),): f"--params-file '{blank}'",
        ('--', 'p.yaml'): '--params-file p.yaml',
        ('__ns:=/a', 'area:=0.002', 'piston_state:=/joints'): '-r __ns:=/a -p area:=0.002 -r piston_state:=/joints',
    }
    for line, expected in zip(refusals('sim_node', corrected), corrected.values()):
        assert line.endswith(f': sim_node --ros-args {expected}'), line
    (line,) = refusals('sim_node', [['-x']])
    assert line.endswith('-x is no argument of sim_node: see sim_node --help')


@pytest.mark.parametrize('module', ['sim_node', 'identifier_node'])
def test_a_parameter_file_that_is_a_pipe_is_refused(tmp_path: Path, module: str) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (line,) = refusals(module, [['--ros-args', '--params-file', str(tmp_path / 'pipe')]])
    assert line == f'{module}: error: {tmp_path}/pipe is a named pipe, not a file'


# without a node


def made(times: np.ndarray, displacement: np.ndarray, pressure: np.ndarray) -> Recording:
    setpoint = Signal(times[:2], AMBIENT_PRESSURE + np.array([3e4, 5e4]))
    signals = {'cylinder_a': CylinderSignals(Signal(times, pressure), setpoint)}
    return Recording('made', 0, Signal(times, displacement), signals, None, ())


def test_the_range_is_that_of_all_recordings() -> None:
    times = np.arange(0.0, 2.0, 2e-3)
    noise = 1e-6 * np.random.default_rng(1).normal(size=times.size)
    one = made(times, 2e-3 * np.sin(5.0 * times) + noise, np.linspace(1.2e5, 1.5e5, times.size))
    other = made(times, np.full(times.size, 3e-3), np.full(times.size, 1.1e5))
    found = IdentifiedRange.of_recordings([one, other], AMBIENT_PRESSURE)
    assert found.displacement == pytest.approx((-2e-3, 3e-3), abs=5e-6)
    assert found.speed == pytest.approx(0.01, rel=0.05)
    assert found.setpoints == {'cylinder_a': pytest.approx((3e4, 5e4))}
    assert found.pressures == {'cylinder_a': (1.1e5, 1.5e5)}


def test_what_moves_as_it_was_identified_raises_no_warning() -> None:
    """Of other noise, and at other samples."""
    times = np.arange(0.0, 20.0, 1e-3)
    rng = np.random.default_rng(2)
    displacement = 2e-3 * np.sin(5.0 * times)
    recording = made(times, displacement + 1e-6 * rng.normal(size=times.size), np.full(times.size, 1.2e5))
    known = InputRange(IdentifiedRange.of_recordings([recording], AMBIENT_PRESSURE))
    for index in range(0, times.size, 3):
        known.sample(int(times[index] * 1e9), displacement[index] + 1e-6 * rng.normal())
        known.predicted(['cylinder_a'], [1.2e5 + 50.0 * rng.normal()])
    assert known.report({'cylinder_a': 4e4}) == []


def test_without_an_identification_only_what_no_device_has_is_told() -> None:
    unknown = InputRange(IdentifiedRange())
    unknown.sample(0, 0.05)
    unknown.predicted(['cylinder_a'], [5e5])
    assert unknown.report({'cylinder_a': 3e5, 'cylinder_b': 0.0}) == []
    unknown.sample(10**9, 0.5)
    assert 'looks like millimetres' in unknown.report({'cylinder_a': 3e5})[0]
    assert unknown.report({'cylinder_a': 3e5}) == []


def test_the_travel_counts_if_no_displacement_was_identified() -> None:
    """As of an encoder that counts from somewhere else."""
    unknown = InputRange(IdentifiedRange())
    for index in range(100):
        unknown.sample(10**7 * index, 0.15 + 1e-3 * np.sin(index))
    assert unknown.report({}) == []
    unknown.sample(2 * 10**9, 0.15 + 1.0)
    (warning,) = unknown.report({})
    assert 'looks like millimetres' in warning
    unknown.sample(3 * 10**9, 0.15 + 1.0)
    assert unknown.report({}) == []


SPANS = {'cylinder_a': (155e3, 198e3), 'cylinder_b': (126e3, 149e3)}


def test_a_value_holds_until_the_next() -> None:
    """As of a driver that publishes on change."""
    known = InputRange(IdentifiedRange(displacement=(0.0, 3e-3), pressures=SPANS))
    known.sample(0, 1e-3)
    known.sample(10**9, 4e-3)
    known.predicted(['cylinder_a'], [3e5])
    for _ in range(3):
        warnings = known.report({})
        assert len(warnings) == 2
    assert 'is 0.004 m' in warnings[0]
    known.sample(2 * 10**9, 2e-3)
    known.predicted(['cylinder_a'], [160e3])
    assert known.report({}) == []


@pytest.mark.parametrize(
    ('frequency', 'amplitude', 'warns'), [(2.0, 1e-3, False), (50.0, 1e-3, True), (50.0, 5e-6, False)]
)
def test_a_vibration_is_a_speed(frequency: float, amplitude: float, warns: bool) -> None:
    """Also if a whole number of its periods lies within the interval over which a speed is the mean."""
    known = InputRange(IdentifiedRange(speed=0.0788))
    noise = np.random.default_rng(3).normal(scale=2e-6, size=1000)
    for index in range(noise.size):
        stamp = 2 * MILLISECOND * index
        known.sample(stamp, amplitude * np.sin(2.0 * np.pi * frequency * stamp * 1e-9) + noise[index])
    assert any('faster than the identified' in warning for warning in known.report({})) == warns


def test_samples_that_repeat_a_stamp_are_no_speed() -> None:
    known = InputRange(IdentifiedRange(speed=0.01))
    for index in range(400):
        known.sample(10**9 * (index // 100), 2e-3 * np.sin(0.1 * index))
    assert known.report({}) == []


def test_noise_at_rest_is_no_speed() -> None:
    known = InputRange(IdentifiedRange(speed=1e-3))
    for index, noise in enumerate(np.random.default_rng(3).normal(scale=2e-6, size=5000)):
        known.sample(MILLISECOND * index, 1e-3 + noise)
    assert known.report({}) == []


@pytest.mark.parametrize(
    ('measured', 'warnings'),
    [
        ((171e3, 137e3), []),
        (
            (171.0, 137.0),
            ['cylinder_a is 171 Pa, outside the identified 155000 to 198000 Pa: it looks like kPa', 'kPa'],
        ),
        ((171e3 - AMBIENT_PRESSURE, 137e3), ['155000 to 198000 Pa: it looks like gauge pressure, publish absolute Pa']),
        ((137e3, 171e3), ['the measured pressures of cylinder_a and cylinder_b look swapped']),
        ((171e3, 0.0), ['cylinder_b is 0 Pa, outside the identified 126000 to 149000 Pa: check the sensor']),
    ],
)
def test_measured_pressures_are_compared(measured: tuple[float, float], warnings: list[str]) -> None:
    known = InputRange(IdentifiedRange(pressures=SPANS))
    for name, pressure in zip(CYLINDERS, measured):
        known.measured(name, pressure)
    found = known.report({})
    assert len(found) == len(warnings)
    assert all(warning in text for warning, text in zip(warnings, found))


def test_without_an_identified_range_set_points_are_compared_with_the_operating_points() -> None:
    known = InputRange(IdentifiedRange())
    known.compare_with(IdentifiedRange(), AMBIENT_PRESSURE, {'cylinder_a': (5 * PSI, 20 * PSI)})
    assert known.report({'cylinder_a': 10 * PSI}) == []
    for _ in range(2):
        (warning,) = known.report({'cylinder_a': 25 * PSI})
        assert 'outside the operating points 34473.8 to 137895 Pa: the nearest gains act' in warning
    assert 'looks like psi' in known.report({'cylinder_a': 10.0})[0]
    assert 'looks like bar, psi or kPa' in known.report({'cylinder_a': 2.0})[0]
