# SPDX-License-Identifier: Apache-2.0
"""`sim_node` as a user meets it: a process of its own, reached over DDS."""

from __future__ import annotations

import fcntl
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from graph import DESCRIBED, MILLISECOND, QUEUE, Graph, Process, SimClient, refusals, ros_arguments, unique_namespace
from measured import MAPPING, ROOT, needs_measured_data
from patience import allowed
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger

import cfd_pneumatic
from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CONTACT_FORCE,
    CYLINDERS,
    FORCE_SETPOINT,
    PISTON_STATE,
    pressure_topic,
    setpoint_applied_topic,
    setpoint_topic,
)
from cfd_pneumatic.model import NAMES, SPECS, TABLE_1, Cylinder, DeviceModel, ForceGeometry, LiveDevice, OperatingPoints
from cfd_pneumatic.nodes.health import LOST
from cfd_pneumatic.nodes.messages import stamp_message
from cfd_pneumatic.recording import read_mapping, read_recording
from cfd_pneumatic.units import PSI

PRESSURE_A, PRESSURE_B = map(pressure_topic, CYLINDERS)
APPLIED_A, APPLIED_B = map(setpoint_applied_topic, CYLINDERS)
AREA = 1.14e-3
SET = 10 * PSI
REST = AMBIENT_PRESSURE + SET
START = 2_000_000_000_000

WITHOUT_EVENTS = "import sys; sys.modules['rclpy.experimental'] = None"
"""No `EventsExecutor`, as before Jazzy."""

SLOW = """\
import time
from cfd_pneumatic.nodes.sim_node import SimNode
commit = SimNode._commit
SimNode._commit = lambda *given: (time.sleep(2e-3), commit(*given))
"""
"""A node that answers less than 500 samples in a second."""

SERIALISED_OTHERWISE = """\
from cfd_pneumatic.nodes import samples
samples._LayoutReader.read = lambda *_: None
samples.Form.filled = lambda *_: b'nonsense'
"""


def model(points: OperatingPoints = TABLE_1, *, single: bool = False) -> LiveDevice:
    cylinder = Cylinder(points, AMBIENT_PRESSURE)
    return LiveDevice(
        DeviceModel(cylinder, None if single else cylinder, ForceGeometry(AREA, 1.0, AMBIENT_PRESSURE)), max_gap=1.0
    )


def expected(live: LiveDevice, stamp: int, position: float, setpoints: tuple[float, float]) -> tuple[float, float]:
    """Step the pure-Python device; return its pressures."""
    live.sample(stamp, position, setpoints)
    state = live.committed.state
    return state.a.p, state.b.p


def gains(points: OperatingPoints) -> dict[str, list[float]]:
    """Return the parameters that give both cylinders these operating points."""
    return {
        f'{cylinder}__{name}': getattr(points, name).tolist()
        for cylinder in CYLINDERS
        for name in ('setpoints', *NAMES)
    }


@pytest.fixture(scope='module')
def shared(graph: Graph) -> Iterator[SimClient]:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace, {'area': AREA})):
        yield SimClient(graph, namespace).meet()


@pytest.fixture
def sim(shared: SimClient) -> SimClient:
    """Return a node at rest with its default parameters and set-points."""
    defaults = {'axis': 'x', 'geometric_factor': 1.0, 'max_gap': 1.0, 'joint': 'piston', 'bias_pressure': SET}
    assert shared.graph.set_atomically(shared.node, **gains(TABLE_1), **defaults).successful
    shared.restart()
    establish(shared, SET, SET)
    return shared.restart()


def establish(sim: SimClient, *setpoints: float) -> None:
    """Send set-points and wait until the node has them."""
    for index, setpoint in enumerate(setpoints):
        sim.setpoint(index, setpoint)
    applied = [setpoint_applied_topic(name) for name in sim.cylinders]

    def has_them() -> bool:
        answer = sim.answer(sim.stamp)
        return answer is not None and [answer[topic] for topic in applied] == [
            setpoint + AMBIENT_PRESSURE for setpoint in setpoints
        ]

    sim.graph.until(has_them, doing=lambda: sim.send(sim.stamp + MILLISECOND, 0.0))


def stroke(count: int = 40) -> list[tuple[int, float]]:
    """Return irregular stamps and positions of a smooth step."""
    rng = np.random.default_rng(5)
    stamps = START + np.cumsum(rng.integers(1_500_000, 2_500_000, count))
    positions = 1.5e-3 / (1.0 + np.exp(-(np.arange(count) - 15.0)))
    return list(zip(stamps.tolist(), positions.tolist()))


# answers


def test_every_sample_is_answered_with_its_stamp_and_the_model_s_pressures_to_the_last_bit(sim: SimClient) -> None:
    live = model()
    for stamp, position in stroke():
        answer = sim.sample(stamp, position)
        a, b = expected(live, stamp, position, (REST, REST))
        assert (answer[PRESSURE_A], answer[PRESSURE_B]) == (a, b)
        assert (answer[APPLIED_A], answer[APPLIED_B]) == (REST, REST)
        assert answer[CONTACT_FORCE].x == (a - b) * AREA
        assert (answer[CONTACT_FORCE].y, answer[CONTACT_FORCE].z) == (0.0, 0.0)
    assert min(value for _, value in sim.series(PRESSURE_A)) < REST - 100.0, 'A grows with +x'
    assert all(message.header.frame_id == 'cfd' for messages in sim.heard.values() for message in messages)


def test_a_set_point_sent_just_before_a_sample_acts_on_it(sim: SimClient) -> None:
    live, lost = model(), sim.count(LOST)
    targets = [SET + 500.0 * (-1) ** index * index for index in range(60)]
    sim.sample(START, 0.0)
    live.sample(START, 0.0, (REST, REST))
    applied = {START: REST}
    for index, target in enumerate(targets):
        sim.setpoint(0, target)
        sim.send(START + (index + 1) * 2 * MILLISECOND, 0.0)
        applied[sim.stamp] = target + AMBIENT_PRESSURE
    answered = sim.account_for_all(lost)
    heard = dict(sim.series(APPLIED_A))
    pressures = dict(sim.series(PRESSURE_A))
    for stamp in answered[1:]:
        target = applied.get(stamp, targets[-1] + AMBIENT_PRESSURE)
        assert heard[stamp] == target
        assert pressures[stamp] == expected(live, stamp, 0.0, (target, REST))[0]


def test_each_of_a_thousand_samples_at_1_khz_is_answered_with_the_set_points_before_it_or_counted_as_lost(
    sim: SimClient,
) -> None:
    """A busy machine may lose some: `piston_state` is best effort."""
    lost = sim.count(LOST)
    applied, setpoint = {}, SET
    begin = time.monotonic()
    for index in range(1000):
        time.sleep(max(0.0, begin + index * 1e-3 - time.monotonic()))
        if index % 100 == 50:
            setpoint = SET + index
            sim.setpoint(0, setpoint)
        sim.send(START + index * MILLISECOND, 1e-6 * index)
        applied[sim.stamp] = setpoint + AMBIENT_PRESSURE
    answered = sim.account_for_all(lost)
    assert len(answered) > sim.sent / 10, 'of what waits too long it takes one in ten'
    assert sim.series(APPLIED_A) == [(stamp, applied.get(stamp, setpoint + AMBIENT_PRESSURE)) for stamp in answered]
    assert answered == sorted(set(answered))


def test_a_force_is_a_pair_about_the_bias_and_the_last_writer_wins(sim: SimClient) -> None:
    stamps = (START + index * MILLISECOND for index in range(1, 10_000))

    def applied_becomes(a: float, b: float) -> None:
        answer = sim.graph.until(
            lambda: (answer := sim.answer(sim.stamp)) and answer[APPLIED_A] == pytest.approx(a, abs=0.01) and answer,
            doing=lambda: sim.send(next(stamps), 0.0),
        )
        assert answer[APPLIED_B] == pytest.approx(b, abs=0.01)

    half = 20.0 / AREA / 2.0
    sim.force_setpoint(20.0)
    applied_becomes(REST + half, REST - half)
    sim.setpoint(0, 8 * PSI)
    applied_becomes(AMBIENT_PRESSURE + 8 * PSI, REST - half)
    assert sim.graph.set(sim.node, bias_pressure=12 * PSI).successful
    assert sim.graph.set(sim.node, geometric_factor=-2.0).successful
    sim.force_setpoint(20.0)
    applied_becomes(AMBIENT_PRESSURE + 12 * PSI - half / 2.0, AMBIENT_PRESSURE + 12 * PSI + half / 2.0)
    last = next(stamps) + 900 * MILLISECOND
    for pause in range(4):
        answer = sim.sample(last + 900 * MILLISECOND * pause, 0.0)
    assert answer[CONTACT_FORCE].x == pytest.approx(20.0, rel=1e-6)


def test_the_force_lies_along_the_chosen_axis(sim: SimClient) -> None:
    assert sim.graph.set(sim.node, axis='y').successful
    establish(sim, 12 * PSI, SET)
    sim.restart()
    force = sim.sample(START, 0.0)[CONTACT_FORCE]
    assert (force.x, force.z) == (0.0, 0.0)
    assert force.y == pytest.approx(2 * PSI * AREA)


def test_one_cylinder_works_against_ambient_pressure(graph: Graph) -> None:
    cells = (*CYLINDERS, 1.0, unique_namespace()), (*CYLINDERS[::-1], -1.0, unique_namespace())
    with ExitStack() as stack:
        for _, missing, _, namespace in cells:
            parameters = {f'{missing}.enabled': False, 'ambient_pressure': 9.0e4, 'geometric_factor': 2.0}
            stack.enter_context(graph.run('sim_node', ros_arguments(namespace, parameters)))
        graph.discover(Trigger, *(f'{namespace}/sim_node/reset' for *_, namespace in cells))
        for present, missing, sign, namespace in cells:
            sim = SimClient(graph, namespace, cylinders=[present]).meet()
            assert sim.sample(START, 0.0)[CONTACT_FORCE].x == pytest.approx(sign * SET * AREA * 2.0)
            topics = {topic for topic, _ in graph.node.get_topic_names_and_types() if topic.startswith(namespace)}
            assert not any(missing in topic for topic in topics)
            status = graph.next_diagnostics(sim.node, lambda _: True)
            assert not any(missing in value.key for value in status.values)
            applied = setpoint_applied_topic(present)

            def becomes(but: float, sim: SimClient = sim, applied: str = applied) -> float:
                return graph.until(
                    lambda: (answer := sim.answer(sim.stamp)) and answer[applied] != 9.0e4 + but and answer[applied],
                    doing=lambda: sim.send(sim.stamp + MILLISECOND, 0.0),
                )

            sim.setpoint(0, SET / 2.0)
            assert becomes(but=SET) == pytest.approx(9.0e4 + SET / 2.0)
            sim.force_setpoint(sign * 300.0)
            assert becomes(but=SET / 2.0) == pytest.approx(9.0e4 + 300.0 / AREA / 2.0), 'it takes all of the difference'


def test_topics_have_the_promised_types_and_qos_and_one_publisher_beside_a_device(graph: Graph) -> None:
    device, simulator = f'{unique_namespace()}/device', f'{unique_namespace()}/sim'
    inputs = (PISTON_STATE, *map(setpoint_topic, CYLINDERS), FORCE_SETPOINT)
    remaps = {topic: f'{device}/{topic}' for topic in inputs}
    # a device that publishes the simulator's outputs, too, in its own namespace
    with graph.run('rig_node', ros_arguments(device)), graph.run('sim_node', ros_arguments(simulator, remaps=remaps)):
        sim = SimClient(graph, simulator, inputs=device)
        graph.until(lambda: all(sim.heard.values()))
        find = graph.node.get_publishers_info_by_topic
        # endpoints, and the names of their nodes, are discovered one by one
        for namespace, node in ((simulator, 'sim_node'), (device, 'rig_node')):
            for topic in (PRESSURE_A, PRESSURE_B, APPLIED_A, APPLIED_B):
                graph.until(
                    lambda name=f'{namespace}/{topic}', node=node: node in {one.node_name for one in find(name)}
                )
        outputs = {
            PRESSURE_A: 'FluidPressure', PRESSURE_B: 'FluidPressure',
            APPLIED_A: 'FluidPressure', APPLIED_B: 'FluidPressure',
        }  # fmt: skip
        for topic, kind in outputs.items():
            for namespace in (device, simulator):
                (publisher,) = find(f'{namespace}/{topic}')
                assert publisher.topic_type == f'sensor_msgs/msg/{kind}'
                assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                assert publisher.qos_profile.depth in (0, 5000)  # 0: this middleware does not tell others
        (publisher,) = graph.node.get_publishers_info_by_topic(f'{simulator}/{CONTACT_FORCE}')
        assert publisher.topic_type == 'geometry_msgs/msg/WrenchStamped'
        for topic in inputs:
            (reader,) = graph.until(lambda topic=topic: readers(graph, f'{device}/{topic}', 'sim_node'))
            best_effort = topic == PISTON_STATE
            assert (reader.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT) == best_effort
            assert reader.topic_type == f'{"sensor_msgs/msg/JointState" if best_effort else "std_msgs/msg/Float64"}'


def readers(graph: Graph, topic: str, node: str) -> list[TopicEndpointInfo]:
    return [one for one in graph.node.get_subscriptions_info_by_topic(topic) if one.node_name == node]


@pytest.fixture(scope='module')
def given(graph: Graph, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[str]:
    """Yield the namespace of a node with overrides of its QoS and two parameter files."""
    namespace, dumped = unique_namespace(), tmp_path_factory.mktemp('given') / 'dumped.yaml'
    dumped.write_text('/**:\n  ros__parameters:\n    axis: y\n    hardware_id: CFD2100-7\n')
    overrides = {
        f'qos_overrides.{namespace}/{PRESSURE_A}.publisher.reliability': 'best_effort',
        f'qos_overrides.{namespace}/{PISTON_STATE}.subscription.reliability': 'reliable',
        f'qos_overrides.{namespace}/{PISTON_STATE}.subscription.depth': 7,
    }
    files = ['--params-file', str(dumped), '--params-file', str(request.config.rootpath / 'config' / 'table_2.yaml')]
    with graph.run('sim_node', [*ros_arguments(namespace, overrides), *files]):
        yield namespace


def test_a_qos_override_holds_for_its_topic_only(graph: Graph, given: str) -> None:
    find = graph.node.get_publishers_info_by_topic
    graph.until(lambda: all(find(f'{given}/{topic}') for topic in (PRESSURE_A, PRESSURE_B)))
    reliability = {topic: find(f'{given}/{topic}')[0].qos_profile.reliability for topic in (PRESSURE_A, PRESSURE_B)}
    assert reliability == {PRESSURE_A: ReliabilityPolicy.BEST_EFFORT, PRESSURE_B: ReliabilityPolicy.RELIABLE}
    (reader,) = graph.until(lambda: graph.node.get_subscriptions_info_by_topic(f'{given}/{PISTON_STATE}'))
    assert reader.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    depth = f'qos_overrides.{given}/{PISTON_STATE}.subscription.depth'
    assert graph.get(f'{given}/sim_node', depth) == [7]


# stamps


def test_a_gap_and_a_stamp_that_goes_back_start_anew_and_equal_stamps_are_ignored(sim: SimClient) -> None:
    repeated, resets = sim.count('repeated stamps'), sim.count('resets')
    sim.sample(START, 0.0)
    assert sim.sample(START + 2 * MILLISECOND, 1e-4)[PRESSURE_A] != REST
    sim.send(START + 2 * MILLISECOND, 5e-4)
    assert sim.sample(START + 1003 * MILLISECOND, 1e-3)[PRESSURE_A] == REST, 'beyond max_gap'
    live = model()
    live.sample(START + 1003 * MILLISECOND, 1e-3, (REST, REST))
    stamp = START + 2003 * MILLISECOND
    assert sim.sample(stamp, 2e-3)[PRESSURE_A] == expected(live, stamp, 2e-3, (REST, REST))[0], 'max_gap itself is none'
    assert sim.sample(START, 3e-3)[PRESSURE_A] == REST, 'it went back'
    assert sim.count('repeated stamps') == repeated + 1
    assert sim.count('resets') == resets + 2
    assert [stamp for stamp, _ in sim.series(APPLIED_A)].count(START + 2 * MILLISECOND) == 1


def test_resets_are_warned_of(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace, {'max_gap': 0.25})) as process:
        sim = SimClient(graph, namespace).meet()
        sim.sample(START, 0.0)
        sim.sample(START + 251 * MILLISECOND, 0.0)
        graph.until(lambda: 'moved by 0.251000 s (allowed: forward, at most max_gap 0.25 s)' in process.stderr)
        # a bare `ros2 topic pub` has no stamp
        assert 'zero stamp' not in process.stderr
        applied = sim.heard[APPLIED_A]
        before, now = len(applied), time.time()
        graph.until(lambda: len(applied) > before + 3, doing=lambda: sim.send(0, 0.0))
        assert applied[-1].header.stamp.sec == pytest.approx(now, abs=allowed())
        assert process.stderr.count('zero stamp') == 1
        assert sim.count('zero stamps') >= 4


def test_reset_starts_at_rest(sim: SimClient) -> None:
    sim.sample(START, 0.0)
    assert sim.sample(START + 2 * MILLISECOND, 1e-3)[PRESSURE_A] < REST
    assert sim.graph.trigger(f'{sim.node}/reset').success
    assert sim.sample(START + 4 * MILLISECOND, 2e-3)[PRESSURE_A] == REST


def test_previews_fill_a_silence_and_leave_no_trace(sim: SimClient) -> None:
    live = model()
    for stamp in (START, START + 2 * MILLISECOND):
        position = 1e-3 * (stamp - START) / MILLISECOND
        answer = sim.sample(stamp, position)
        expected(live, stamp, position, (REST, REST))
    sim.graph.until(lambda: all(len(messages) >= 3 for messages in sim.previews.values()))
    for stamp, pressure in sim.series(PRESSURE_A, previews=True):
        elapsed = (stamp - START - 2 * MILLISECOND) * 1e-9
        assert elapsed >= 0.1
        assert pressure == pytest.approx(live.preview(elapsed, (REST, REST)).a.p, abs=1e-3)
        assert abs(pressure - REST) < abs(answer[PRESSURE_A] - REST)
    assert all(len(messages) == 2 for messages in sim.heard.values()), 'a preview is no answer'
    stamp = START + 500 * MILLISECOND
    assert sim.sample(stamp, 3e-3)[PRESSURE_A] == expected(live, stamp, 3e-3, (REST, REST))[0]


# input that is of no use


USELESS = (
    JointState(name=['piston'], position=[math.nan]),
    JointState(name=['piston'], position=[math.inf]),
    JointState(name=['piston'], position=[1e300]),
    JointState(name=['piston'], position=[1.1]),
    JointState(name=['piston'], position=[]),
    JointState(name=['elbow', 'piston'], position=[0.0]),
)
NOT_OURS = (JointState(name=['elbow'], position=[0.0]), JointState())


def test_a_sample_of_no_use_is_ignored(sim: SimClient) -> None:
    ignored = sim.count('ignored samples')
    sent = (START, 0.0), (START + 2 * MILLISECOND, 1e-3)
    for stamp, position in sent:
        sim.sample(stamp, position)
    for index, message in enumerate(USELESS):
        message.header.stamp = stamp_message(START + (10 + index) * MILLISECOND)
        sim.piston_out.publish(message)
    sim.graph.until(lambda: sim.count('ignored samples') == ignored + len(USELESS))
    status = sim.graph.next_diagnostics(sim.node, lambda status: status.level == status.ERROR)
    assert "joint 'piston' in piston_state has no position" in status.message
    live = model()
    for stamp, position in sent:
        expected(live, stamp, position, (REST, REST))
    stamp = START + 500 * MILLISECOND
    assert sim.sample(stamp, 2e-3)[PRESSURE_A] == expected(live, stamp, 2e-3, (REST, REST))[0]
    assert [stamp for stamp, _ in sim.series(PRESSURE_A)] == [START, START + 2 * MILLISECOND, stamp]


def test_a_message_of_other_joints_is_none_of_ours(sim: SimClient) -> None:
    ignored = sim.count('ignored samples')
    sent = [START + 2 * index * MILLISECOND for index in range(50)]
    live = model()
    for index, stamp in enumerate(sent):
        for message in NOT_OURS:
            message.header.stamp = stamp_message(stamp + MILLISECOND)
            sim.piston_out.publish(message)
        answer = sim.sample(stamp, 1e-4 * index)
        assert answer[PRESSURE_A] == expected(live, stamp, 1e-4 * index, (REST, REST))[0]
    status = sim.graph.next_diagnostics(sim.node, lambda _: True, doing=lambda: sim.send(sim.stamp + MILLISECOND, 0.0))
    assert (status.level, status.message) == (status.OK, 'following piston_state')
    status = sim.graph.next_diagnostics(
        sim.node, lambda status: status.level == status.ERROR, doing=lambda: sim.piston_out.publish(NOT_OURS[0])
    )
    assert 'piston_state has been silent' in status.message
    assert "no joint 'piston', but ['elbow']" in status.message
    assert sim.count('ignored samples') == ignored
    assert sim.count('messages without the joint') >= 2 * len(sent)


def test_what_has_gone_wrong_since_the_last_report_is_a_warning(graph: Graph, sim: SimClient) -> None:
    other = graph.publisher(JointState, f'{sim.node.rpartition("/")[0]}/{PISTON_STATE}')
    graph.until(other.get_subscription_count)
    stamps = iter(range(START, START + 100_000 * MILLISECOND, MILLISECOND))

    def publish(late: int = 0) -> None:
        for stamp in islice(stamps, 10):
            sim.send(stamp, 0.0)
            if late:
                other.publish(
                    JointState(header=Header(stamp=stamp_message(stamp - late)), name=['piston'], position=[0.0])
                )

    def report(word: str, **options: int) -> str:
        return sim.graph.next_diagnostics(
            sim.node,
            lambda status: status.level == status.WARN and word in status.message,
            doing=lambda: publish(**options),
        ).message

    assert 'since the last report' in report('resets', late=5 * MILLISECOND)
    sim.setpoint(0, math.nan)
    report('1 ignored set-points')
    graph.node.destroy_publisher(other)
    sim.setpoint(0, SET)  # the refused one is a warning until then
    sim.graph.next_diagnostics(sim.node, lambda status: status.level == status.OK, doing=publish)


def test_messages_that_were_lost_are_counted(graph: Graph) -> None:
    """A queue that overflows raises no event."""
    namespace = unique_namespace()
    topic = f'{namespace}/{PISTON_STATE}'
    shallow = {f'qos_overrides.{topic}.subscription.depth': 5}
    with graph.run('sim_node', ros_arguments(namespace, shallow)) as process:
        sim = SimClient(graph, namespace).meet()
        sent = 0

        def send(count: int) -> None:
            nonlocal sent
            for _ in range(count):
                sent += 1
                sim.send(START + sent * MILLISECOND, 0.0)

        before = sim.count('samples')
        sim.graph.next_diagnostics(sim.node, lambda status: LOST in status.message, doing=lambda: send(500))
        graph.until(lambda: send(1) or sim.count(LOST) + sim.count('samples') - before == sent)
        assert 'messages on piston_state are lost' in process.stderr


def test_publishers_that_come_and_go_are_no_loss(graph: Graph, sim: SimClient) -> None:
    stamps = iter(range(START, START + 100_000 * MILLISECOND, MILLISECOND))
    lost = sim.count('lost messages')
    for _ in range(3):
        for _ in range(30):
            sim.sample(next(stamps), 0.0)
        publishers = sim.piston_out.topic_name, graph.node.count_publishers(sim.piston_out.topic_name)
        other = graph.publisher(JointState, publishers[0])
        graph.until(other.get_subscription_count)
        stamp = next(stamps)
        graph.until(
            lambda other=other, stamp=stamp: sim.answer(stamp),
            doing=lambda other=other, stamp=stamp: other.publish(
                JointState(header=Header(stamp=stamp_message(stamp)), name=['piston'], position=[0.0])
            ),
        )
        graph.node.destroy_publisher(other)
        graph.until(lambda publishers=publishers: graph.node.count_publishers(publishers[0]) == publishers[1])
    sim.sample(next(stamps), 0.0)
    assert sim.count('lost messages') == lost


def test_an_overload_is_shed_and_told_and_ends_with_its_cause(graph: Graph) -> None:
    """Ten subscribers that take nothing listen, too."""
    namespace = unique_namespace()
    context = Context()
    rclpy.init(context=context)
    deaf = Node('deaf', context=context)
    for index in range(10 * len(CYLINDERS)):
        topic = (PRESSURE_A, PRESSURE_B)[index % len(CYLINDERS)]
        deaf.create_subscription(FluidPressure, f'{namespace}/{topic}', print, QUEUE)
    with graph.run('sim_node', [*ros_arguments(namespace), *DESCRIBED], before=SLOW):
        sim = SimClient(graph, namespace).meet()
        for index in range(len(CYLINDERS)):
            sim.setpoint(index, SET)
        before = sim.count('samples')
        sent = 0

        def send(count: int) -> None:
            nonlocal sent
            for _ in range(count):
                sent += 1
                sim.send(START + sent * MILLISECOND, 0.0)

        def count(status: DiagnosticStatus, key: str) -> int:
            return int(next(value.value for value in status.values if value.key == key))

        def behind(status: DiagnosticStatus) -> int:
            return sent + before - count(status, LOST) - count(status, 'samples')

        # by now thousands wait in its queue
        told = graph.next_diagnostics(sim.node, lambda one: count(one, LOST) > 3000, doing=lambda: send(500))
        assert told.level == told.WARN
        assert LOST in told.message
        status = graph.next_diagnostics(
            sim.node, lambda one: one.level == one.OK and behind(one) < 20, doing=lambda: send(1)
        )
        assert status.message == 'following piston_state'
        answered = count(status, 'samples') - count(told, 'samples')
        assert answered < 2500, 'what waits is thrown away, and not answered late'
        graph.until(lambda: behind(graph.next_diagnostics(sim.node, lambda _: True)) == 0)
    deaf.destroy_node()
    rclpy.shutdown(context=context)


def test_a_publisher_that_offers_less_than_is_asked_for_is_told(graph: Graph, sim: SimClient) -> None:
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    topic = f'{sim.node.rpartition("/")[0]}/{setpoint_topic("cylinder_a")}'
    publisher = graph.node.create_publisher(Float64, topic, best_effort)
    graph.until(lambda: sim.count('QoS mismatches'))
    graph.node.destroy_publisher(publisher)


def test_a_set_point_of_no_use_is_ignored(sim: SimClient) -> None:
    ignored = sim.count('ignored set-points')
    nonsense = (math.nan, math.inf, -AMBIENT_PRESSURE - 1.0, 75 * PSI + 1.0)
    for value in nonsense:
        sim.setpoint(0, value)
    for force in (math.nan, -math.inf, 1e6):
        sim.force_setpoint(force)
    sim.graph.until(lambda: sim.count('ignored set-points') == ignored + 7)
    answer = sim.sample(START, 0.0)
    assert (answer[APPLIED_A], answer[APPLIED_B]) == (REST, REST)
    establish(sim, -AMBIENT_PRESSURE, 75 * PSI)  # vacuum and supply themselves are in


def test_warnings_are_throttled_and_say_what_is_wrong(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace, {'joint': 'slider'})) as process:
        sim = SimClient(graph, namespace)
        graph.until(
            lambda: sim.sent >= 10 and 'has no joint' in process.stderr,
            doing=lambda: sim.send(START, 0.0, joint='piston'),
        )
        status = graph.next_diagnostics(sim.node, lambda status: status.level == status.ERROR)
        assert "no piston_state yet; no joint 'slider', but ['piston']" in status.message
        assert process.stderr.count('has no joint') <= 2
        graph.until(lambda: 'is at 5 m' in process.stderr, doing=lambda: sim.send(START, 5.0, joint='slider'))
        assert 'outside stroke_lower -1 to stroke_upper 1 m' in process.stderr
        graph.until(lambda: 'above the supply pressure' in process.stderr, doing=lambda: sim.setpoint(0, 1e6))
        graph.until(
            lambda: 'outside the operating points' in process.stderr,
            doing=lambda: (sim.setpoint(0, 30 * PSI), sim.send(sim.stamp + MILLISECOND, 0.0, joint='slider')),
        )


MANY_KINDS = """
import itertools, string, rclpy
from rclpy.node import Node
from cfd_pneumatic.nodes.health import Warnings

rclpy.init()
warnings = Warnings(Node('talker'))
for first, second in itertools.product(string.ascii_lowercase, repeat=2):
    warnings.warn(f'ignored: {first}{second}')
"""


def test_of_warnings_no_more_kinds_are_told_than_one_can_read() -> None:
    said = subprocess.run([sys.executable, '-c', MANY_KINDS], stderr=subprocess.PIPE, text=True, check=True).stderr
    assert said.count('ignored: ') == 20


def test_silence_is_an_error_until_samples_come_again(sim: SimClient) -> None:
    sim.sample(START, 0.0)
    status = sim.graph.next_diagnostics(sim.node, lambda status: status.level == status.ERROR)
    assert 'piston_state has been silent for' in status.message
    status = sim.graph.next_diagnostics(
        sim.node, lambda status: status.level == status.OK, doing=lambda: sim.send(sim.stamp + 100 * MILLISECOND, 0.0)
    )
    values = {value.key: value.value for value in status.values}
    assert status.message == 'following piston_state'
    assert float(values['cylinder_a pressure, absolute [Pa]']) == pytest.approx(REST, abs=0.1)
    assert float(values['cylinder_b set-point, gauge [Pa]']) == pytest.approx(SET, abs=0.1)


def test_the_watchdog_outlives_a_clock_that_stops(graph: Graph) -> None:
    namespace = unique_namespace()
    clock = graph.publisher(Clock, '/clock')
    with graph.run('sim_node', ros_arguments(namespace, {'use_sim_time': True})):
        sim = SimClient(graph, namespace).meet()  # a time is answered once, which must not be missed
        tick = Clock()
        tick.clock.sec = 77
        graph.until(
            lambda: sim.heard[APPLIED_A] and sim.heard[APPLIED_A][-1].header.stamp.sec == 77,
            doing=lambda: (clock.publish(tick), sim.send(0, 0.0)),
        )  # a zero stamp takes the simulated time
        status = graph.next_diagnostics(sim.node, lambda status: status.level == status.ERROR)
        assert 'silent' in status.message
        previews = len(sim.previews[PRESSURE_A])
        sim.sample(START, 0.0)
        graph.until(lambda: len(sim.previews[PRESSURE_A]) > previews + 3)


# parameters


def test_every_parameter_is_described_with_its_unit_and_range(sim: SimClient) -> None:
    names = sim.graph.call(ListParameters, f'{sim.node}/list_parameters').result.names
    ours = [name for name in names if not name.startswith(('qos_overrides', 'use_sim_time', 'start_type'))]
    request = DescribeParameters.Request(names=ours)
    answer = sim.graph.call(DescribeParameters, f'{sim.node}/describe_parameters', request)
    described = {descriptor.name: descriptor for descriptor in answer.descriptors}
    for cylinder in CYLINDERS:
        assert described[f'{cylinder}.setpoints'].description.endswith('[Pa]')
        for spec in SPECS:
            descriptor = described[f'{cylinder}.{spec.name}']
            assert descriptor.description.endswith(f'[{spec.unit}]')
            assert f'{spec.lower:g} to {spec.upper:g} {spec.unit}' in descriptor.additional_constraints
    for descriptor in described.values():
        assert len(descriptor.description) > 15, descriptor.name
        if descriptor.type == Parameter.Type.DOUBLE.value:
            (bounds,) = descriptor.floating_point_range
            assert bounds.from_value < bounds.to_value
            assert descriptor.description.endswith(']')


def test_a_good_value_acts_from_the_next_sample(sim: SimClient) -> None:
    live = model()
    for stamp, position in stroke(20):
        sim.sample(stamp, position)
        expected(live, stamp, position, (REST, REST))
    points = OperatingPoints.constant(k_x=4e6, k_sv=80.0, k_v=15.0, tau=0.02, setpoint=SET)
    assert sim.graph.set_atomically(sim.node, **gains(points)).successful, (
        'another number of operating points, all at once'
    )
    live.device = model(points).device
    for stamp, position in stroke(40)[20:]:
        answer = sim.sample(stamp, position)
        assert (answer[PRESSURE_A], answer[PRESSURE_B]) == expected(live, stamp, position, (REST, REST))
    assert sim.graph.set(sim.node, cylinder_a__tau=[0.01]).successful
    assert sim.graph.get(sim.node, 'cylinder_a.tau') == [[0.01]]
    assert sim.graph.set(sim.node, stroke_upper=2e-3).successful
    sim.graph.next_diagnostics(
        sim.node,
        lambda status: 'is at 0.0021 m, outside stroke_lower -1 to stroke_upper 0.002 m' in status.message,
        doing=lambda: sim.send(sim.stamp + MILLISECOND, 2.1e-3),
    )
    assert sim.graph.set(sim.node, stroke_upper=1.0).successful


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('cylinder_a__k_x', [4e6, 4e6], 'cylinder_a.k_x has 2 entries but setpoints has 4'),
    ('cylinder_a__setpoints', [1e4], 'has 4 entries but setpoints has 1'),
    ('cylinder_b__setpoints', [4e4, 3e4, 5e4, 6e4], 'cylinder_b.setpoints must be finite and strictly increasing'),
    ('cylinder_b__k_sv', [100.0, math.nan, 100.0, 100.0], 'cylinder_b.k_sv[1] = nan is outside 0.001 to 5000 1/s'),
    ('cylinder_b__tau', [0.01, 0.01, 0.01, -1.0], 'cylinder_b.tau[3] = -1 is outside 1e-05 to 100 s'),
    ('cylinder_a__k_x', [4, 4, 4, 4], 'cylinder_a.k_x is INTEGER_ARRAY, and must be DOUBLE_ARRAY (write 1.0 for 1)'),
    ('cylinder_a__k_x', 4e6, 'cylinder_a.k_x is DOUBLE, and must be DOUBLE_ARRAY'),
    ('cylinder_a__k_x', ['fast'], 'cylinder_a.k_x is STRING_ARRAY, and must be'),
    ('max_gap', 1, 'max_gap is INTEGER, and must be DOUBLE (write 1.0 for 1)'),
    ('axis', True, 'axis is BOOL, and must be STRING (quote it'),
    ('max_gap', math.nan, 'max_gap out of range'),
    ('area', -1.0, 'area out of range'),
    ('geometric_factor', 0.0, 'geometric_factor is 0'),
    ('axis', 'w', "axis 'w' is not one of x, y, z"),
    ('frame_id', '', 'frame_id has 0 characters'),
    ('stroke_lower', 1.0, 'stroke_lower 1 m is not below stroke_upper 1 m'),
    ('cylinder_b__enabled', False, 'read-only parameter: cylinder_b.enabled'),
    ('preview_period', 1.0, 'read-only parameter: preview_period'),
])  # fmt: skip
def test_a_bad_value_is_rejected_with_its_reason_and_the_old_one_kept(
    sim: SimClient, name: str, value: object, reason: str
) -> None:
    full = name.replace('__', '.')
    before = sim.graph.get(sim.node, full)
    for put in (sim.graph.set, sim.graph.set_atomically):
        result = put(sim.node, **{name: value})
        assert not result.successful
        assert reason in result.reason
    assert sim.graph.get(sim.node, full) == before
    sim.sample(START, 0.0)
    live = model()
    live.sample(START, 0.0, (REST, REST))
    stamp = START + 2 * MILLISECOND
    assert sim.sample(stamp, 1e-4)[PRESSURE_A] == expected(live, stamp, 1e-4, (REST, REST))[0]


def test_one_bad_value_of_several_rejects_them_all(sim: SimClient) -> None:
    result = sim.graph.set_atomically(sim.node, max_gap=2.0, cylinder_a__tau=[0.01])
    assert not result.successful
    assert 'cylinder_a.tau has 1 entries' in result.reason
    assert sim.graph.get(sim.node, 'max_gap') == [1.0]


def test_values_that_nobody_gave_are_told(graph: Graph, tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text("""/**:
  ros__parameters:
    cylinder_a: {setpoints: [7.0e+4], k_x: [4.0e+6], k_sv: [90.0], tau: [0.01]}
    cylinder_b: {not_identifiable: [k_sv], setpoints: [7.0e+4], k_x: [4.0e+6], k_sv: [90.0], k_v: [20.0]}
""")
    gains = ', '.join(f'{cylinder}.{name}' for cylinder in CYLINDERS for name in NAMES)
    bare, some = unique_namespace(), unique_namespace()

    def told(node: str) -> tuple[str, str]:
        """Return the defaults and what is not identifiable."""
        status = graph.next_diagnostics(node, lambda one: one.name.endswith((': input', ': feed')))
        values = {value.key: value.value for value in status.values}
        return values['defaults'], values['not identifiable']

    with ExitStack() as stack:

        def run(module: str, namespace: str, *more: str) -> tuple[str, Process]:
            arguments = [*ros_arguments(namespace), *more]
            return f'{namespace}/{module}', stack.enter_context(graph.run(module, arguments))

        modules = 'sim_node', 'monitor_node'
        without = [run(module, bare) for module in modules]
        with_some = [run(module, some, '--params-file', str(file)) for module in modules]
        for node, process in without:
            assert told(node) == (f'area, {gains}', 'none')
            assert process.stderr.count('no gains and no area are given') == 1
        graph.discover(SetParameters, *(f'{node}/set_parameters' for node, _ in with_some))
        for node, process in with_some:
            assert told(node) == ('area, cylinder_a.k_v, cylinder_b.tau', 'cylinder_b.k_sv')
            assert process.stderr.count('not identifiable: cylinder_b.k_sv') == 1
            assert process.stderr.count('not given: area, cylinder_a.k_v, cylinder_b.tau; ') == 1
            assert graph.set(node, area=1.2e-3).successful
            assert graph.set(node, cylinder_b__tau=[0.02]).successful
            assert told(node) == ('cylinder_a.k_v', 'cylinder_b.k_sv')
            assert graph.set(node, cylinder_a__k_v=[20.0]).successful
            assert graph.set(node, cylinder_b__not_identifiable=['']).successful
            assert told(node) == ('none', 'none')


GAINS = '    cylinder_a:\n      {}\n'


BAD_FILES = (
    (GAINS.format('k_x: [1.0e6, 2]'), 'Sequence should be of same type'),
    (GAINS.format('k_x: [1, 2, 3, 4]'), "'cylinder_a.k_x' to '[1, 2, 3, 4]' of type 'INTEGER_ARRAY'"),
    (GAINS.format('k_x: [1.0e6, 2.0e6]'), 'cylinder_a.k_x has 2 entries but setpoints has 4: give one for each'),
    (GAINS.format('k_x: []'), "'cylinder_a.k_x' is not initialized"),
    (GAINS.format('setpoints: [3.0, 2.0]'), 'cylinder_a.setpoints must be finite and strictly increasing'),
    (GAINS.format('tau: [.nan, 0.1, 0.1, 0.1]'), 'cylinder_a.tau[0] = nan is outside'),
    (GAINS.format('initial_setpoint: 1.0e6'), 'cylinder_a.initial_setpoint is 1000000 Pa, above the supply pressure'),
    ('    cylinder_a:\n      enabled: false\n    cylinder_b:\n      enabled: false\n',
     'cylinder_a.enabled and cylinder_b.enabled are both false: leave one of them true'),
    ('    axis: w\n', "axis 'w' is not one of x, y, z"),
    ("    frame_id: ''\n", 'frame_id has 0 characters'),
    ('    stroke_lower: 2.0\n', 'stroke_lower 2 m is not below stroke_upper 1 m'),
    ('    max_gap: 1\n', "'max_gap' to '1' of type 'INTEGER', expecting type 'DOUBLE': max_gap (write 1.0 for 1)"),
    ('    qos_overrides:\n      /piston_state:\n        subscription:\n          reliability: perhaps\n',
     'piston_state: Unexpected QoS override'),
    ('  - [', "Couldn't parse params file"),
)  # fmt: skip


def test_a_bad_parameter_file_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    files = [tmp_path / f'{number}.yaml' for number in range(len(BAD_FILES))]
    for file, (text, _) in zip(files, BAD_FILES):
        file.write_text(f'/**:\n  ros__parameters:\n{text}')
    files.append(tmp_path / 'none.yaml')
    messages = [*(message for _, message in BAD_FILES), 'Error opening YAML file']
    lines = refusals('sim_node', [['--ros-args', '--params-file', str(file)] for file in files])
    for line, message in zip(lines, messages):
        assert message in line


def test_what_ros2_param_dump_writes_is_read_again(graph: Graph, given: str) -> None:
    """It writes a bare y, which YAML takes for true."""
    assert graph.get(f'{given}/sim_node', 'axis') == ['y']
    status = graph.next_diagnostics(f'{given}/sim_node', lambda _: True)
    assert status.hardware_id == 'CFD2100-7'


def test_a_table_runs_as_a_parameter_file(graph: Graph, given: str) -> None:
    (gains,) = graph.get(f'{given}/sim_node', 'cylinder_b.k_sv')
    assert gains == [25.0, 62.9682]


@needs_measured_data
def test_what_a_measured_run_at_7_bar_gave_runs_as_it_is(graph: Graph, tmp_path: Path) -> None:
    run = ROOT / 'friction' / 'O-ring257_7bar.csv'
    assert identify_bag([str(run), '--mapping', str(MAPPING), '--output', str(tmp_path), '--progress', 'none']) == 0
    namespace = unique_namespace()
    with graph.run('sim_node', [*ros_arguments(namespace), '--params-file', str(tmp_path / 'parameters.yaml')]):
        answer = SimClient(graph, namespace, cylinders=CYLINDERS[:1]).meet().sample(START, 0.0)
        assert answer[PRESSURE_A] == pytest.approx(AMBIENT_PRESSURE + 7e5, rel=0.02)
        measured = read_recording(run, mapping=read_mapping(MAPPING)).force
        assert measured is not None
        assert answer[CONTACT_FORCE].x == pytest.approx(np.mean(measured.values), rel=0.05)


# the program


def test_nothing_is_imported_that_only_other_programs_need() -> None:
    needless = ('matplotlib', 'jinja2', 'rich', 'cfd_pneumatic.identification')
    code = f'import sys, cfd_pneumatic.nodes.sim_node; print([name for name in {needless} if name in sys.modules])'
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == '[]'


@pytest.fixture(scope='module')
def alone(graph: Graph, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Process]]:
    """Yield the namespace and process of a node that is installed where nothing can be written, and so compiles."""
    installed = tmp_path_factory.mktemp('installed')
    package = shutil.copytree(
        Path(cfd_pneumatic.__file__).parent, installed / 'cfd_pneumatic', ignore=shutil.ignore_patterns('__pycache__')
    )
    for folder in {file.parent for file in package.rglob('*.py')}:
        (folder / '__pycache__').touch()  # a file, which root can't write below either
    nowhere = str(package / '__init__.py')
    environment = {
        'PYTHONPATH': os.pathsep.join([str(installed), *sys.path]),
        'NUMBA_CACHE_DIR': nowhere,
        'XDG_CACHE_HOME': nowhere,
        'HOME': nowhere,
    }
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace), environment=environment, folder=installed) as process:
        yield namespace, process


@pytest.mark.usefixtures('alone')  # which compiles meanwhile
def test_who_compiles_and_who_waits_for_a_compiler_says_so(graph: Graph, tmp_path: Path) -> None:
    """On diagnostics until it is heard: the middleware meets a new node up to three seconds late."""
    cache, namespace = {'NUMBA_CACHE_DIR': str(tmp_path)}, unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace), environment=cache) as compiling:
        graph.until(lambda: f'compiling the model, once: the cache is {tmp_path}' in compiling.stderr)  # and is ended
    with ExitStack() as stack:
        for path in tmp_path.rglob('compiling.lock'):
            fcntl.flock(stack.enter_context(path.open('w')), fcntl.LOCK_EX)
        waiting = stack.enter_context(graph.run('sim_node', ros_arguments(namespace), environment=cache))
        graph.next_diagnostics(f'{namespace}/sim_node', lambda one: one.message.startswith('not ready yet: another'))
        assert 'another process compiles the model: waiting for it' in waiting.stderr
        assert 'ready for piston_state' not in waiting.stderr


@pytest.mark.slow
def test_an_installation_where_nothing_can_be_written_runs(graph: Graph, alone: tuple[str, Process]) -> None:
    namespace, process = alone
    sim = SimClient(graph, namespace).meet()
    assert sim.sample(START, 0.0)[PRESSURE_A] == REST
    assert 'compiling the model, for this run only: no cache can be written' in process.stderr


def test_it_ends_cleanly_in_the_midst_of_its_work_and_starts_again_at_rest(graph: Graph) -> None:
    """With the one executor, and then with the other one."""
    namespace = unique_namespace()
    samples = stroke(20)
    for before, number, part in (('', signal.SIGTERM, samples[:10]), (WITHOUT_EVENTS, signal.SIGINT, samples[10:])):
        with graph.run('sim_node', ros_arguments(namespace), before=before) as process:
            sim = SimClient(graph, namespace).meet()
            live = model()
            for stamp, position in part:
                answer = sim.sample(stamp, position)
                assert (answer[PRESSURE_A], answer[PRESSURE_B]) == expected(live, stamp, position, (REST, REST))
            establish(sim, 12 * PSI, 8 * PSI)
            for index in range(200):
                sim.send(sim.stamp + MILLISECOND, 1e-6 * index)
            process.stop(number)
        graph.until(lambda sim=sim: not sim.piston_out.get_subscription_count())


def test_a_middleware_that_serialises_otherwise_is_answered_by_messages(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace), before=SERIALISED_OTHERWISE) as process:
        sim = SimClient(graph, namespace).meet()
        live = model()
        for stamp, position in stroke(20):
            answer = sim.sample(stamp, position)
            assert (answer[PRESSURE_A], answer[PRESSURE_B]) == expected(live, stamp, position, (REST, REST))
        assert process.stderr.count('is serialised in an unexpected layout') == len(
            ['JointState', 'FluidPressure', 'WrenchStamped']
        )
