# SPDX-License-Identifier: Apache-2.0
"""`recorder_node`: what it hears is in the bag, and a simulator that hears the bag again says the same."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from graph import MILLISECOND, Graph, Process, SimClient, refusals, ros_arguments, unique_namespace
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from stranger import Stranger

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS, PISTON_STATE, setpoint_topic
from cfd_pneumatic.nodes.messages import nanoseconds
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.recording.bags.bag import Bag
from cfd_pneumatic.units import PSI

TYPES = get_typestore(Stores.ROS2_HUMBLE)


def read_bag(bag: Path) -> dict[str, list]:
    """Return the messages of each topic in their order."""
    messages: dict[str, list] = {}
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            messages.setdefault(connection.topic, []).append(TYPES.deserialize_cdr(data, connection.msgtype))
    return messages


def recorder(bag: Path, *topics: str, **parameters: object) -> list[str]:
    return ros_arguments(parameters={'output': bag, 'topics': f'[{",".join(topics)}]', **parameters})


def test_nothing_is_lost_at_500_hertz_late_and_latched_topics_are_in_and_missing_ones_are_named(
    graph: Graph, tmp_path: Path
) -> None:
    device, namespace, bag = unique_namespace(), unique_namespace(), tmp_path / 'bag'
    topics = [PISTON_STATE, 'measured_force']
    for cylinder in CYLINDERS:
        topics += [f'{cylinder}/{name}' for name in ('setpoint', 'setpoint_applied', 'pressure')]
    settings = {
        'schedule': 'surface_following',
        'schedule_duration': 2.0,
        'start_subscribers': 1,
        'start_delay': 1.0,
        'exit_when_done': True,
    }
    latched, late, never = (f'{namespace}/{name}' for name in ('latched', 'late', 'never'))
    latched_out = graph.node.create_publisher(
        String, latched, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    latched_out.publish(String(data='said before'))
    wanted = [*(f'{device}/{topic}' for topic in topics), latched, late, never]
    with graph.run('recorder_node', recorder(bag, *wanted)) as process:
        with graph.run('rig_node', ros_arguments(device, settings)) as rig:
            graph.until(lambda: f'recording {latched}' in process.stderr)
            late_out = graph.publisher(Float64, late)
            graph.until(lambda: late_out.get_subscription_count())
            graph.until(lambda: f'recording {late}' in process.stderr)
            for value in range(1000):
                late_out.publish(Float64(data=float(value)))
            assert rig.wait() == 0
            (played,) = (int(line.split()[-2]) for line in rig.stderr.splitlines() if 'played' in line)
        assert late_out.wait_for_all_acked()
        assert graph.get('/recorder_node', 'output') == [str(bag)]  # behind the messages
        assert not bag.exists(), 'it appears when it is complete'
        process.stop(signal.SIGTERM)
        assert f'never seen, so not in the bag: {never}' in process.stderr
    messages = read_bag(bag)
    assert [message.data for message in messages.pop(latched)] == ['said before']
    assert [message.data for message in messages.pop(late)] == [float(value) for value in range(1000)]
    assert {topic: len(found) for topic, found in messages.items() if not topic.endswith('/setpoint')} == {
        f'{device}/{topic}': played for topic in topics if not topic.endswith('/setpoint')
    }
    assert messages[f'{device}/cylinder_a/setpoint']
    recording = read_recording(bag)
    assert len(recording.displacement) == played
    assert list(recording.cylinders) == list(CYLINDERS)


def test_a_simulator_that_hears_the_recording_again_answers_bit_for_bit(graph: Graph, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    steps = rng.normal(0.0, 1e-5, 200)
    stamps = 5_000_000_000_000 + np.cumsum(rng.integers(MILLISECOND, 4 * MILLISECOND, steps.size))
    changes = {index: 10 * PSI + rng.normal(0.0, 3e3, 2) for index in range(0, steps.size, 37)}
    original, again, bag = unique_namespace(), unique_namespace(), tmp_path / 'bag'
    sim, sim_again = SimClient(graph, original), SimClient(graph, again)
    topics = [f'{original}/{topic}' for topic in (PISTON_STATE, *map(setpoint_topic, CYLINDERS), *sim.heard)]
    # a busy machine may lose what is best effort
    reliable = {f'qos_overrides.{original}/{PISTON_STATE}.subscription.reliability': 'reliable'}
    with (
        graph.run('sim_node', ros_arguments(original, reliable)),
        graph.run('sim_node', ros_arguments(again)),
        graph.run('recorder_node', recorder(bag, *topics, storage='sqlite3')) as process,
    ):
        sim.meet()
        graph.until(lambda: process.stderr.count('recording /') == len(topics))
        graph.until(lambda: sim.piston_out.get_subscription_count() == 2)
        graph.until(lambda: all(graph.node.count_subscribers(f'{original}/{topic}') == 2 for topic in sim.heard))
        time.sleep(1.0)  # until the simulator has met the recorder, too, which nobody else is told
        sim.restart()
        for index, (stamp, position) in enumerate(zip(stamps.tolist(), np.cumsum(steps).tolist())):
            for cylinder, value in enumerate(changes.get(index, ())):
                sim.setpoint(cylinder, value)
            sim.send(stamp, position)
            if index == 100:  # a pause, in which there are previews
                graph.until(lambda: sim.previews['contact_force'])
        graph.until(lambda: sim.answer(int(stamps[-1])))
        graph.get('/recorder_node', 'output')  # behind the messages
        process.stop()
        messages = read_bag(bag)
        outputs = {
            topic: {nanoseconds(one.header.stamp): one for one in messages[f'{original}/{topic}']}
            for topic in sim.heard
        }
        sent = messages[f'{original}/{PISTON_STATE}']
        recorded = [one for one in sent if nanoseconds(one.header.stamp) in set(stamps.tolist())]
        assert len(recorded) == stamps.size
        sim_again.meet()
        for message in recorded:
            stamp = nanoseconds(message.header.stamp)
            for index, cylinder in enumerate(CYLINDERS):
                applied = outputs[f'{cylinder}/setpoint_applied'][stamp].fluid_pressure
                sim_again.setpoint(index, applied - AMBIENT_PRESSURE)
            answer = sim_again.sample(stamp, float(message.position[0]))
            for cylinder in CYLINDERS:
                for topic in (f'{cylinder}/pressure', f'{cylinder}/setpoint_applied'):
                    assert answer[topic] == outputs[topic][stamp].fluid_pressure
            assert answer['contact_force'].x == outputs['contact_force'][stamp].wrench.force.x


TRAP = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
"""
"""Lets a node import the modules of a folder."""


def test_a_type_that_a_stranger_names_imports_nothing_and_the_expected_type_is_recorded(
    graph: Graph, tmp_path: Path
) -> None:
    trap, bag, namespace = tmp_path / 'trap', tmp_path / 'bag', unique_namespace()
    (trap / 'trapped').mkdir(parents=True)
    for name in ('trapped/__init__.py', 'trapped/msg.py', 'trapped/__main__.py'):
        (trap / name).write_text(f'open({str(tmp_path / "sprung")!r}, "w")\nraise SystemExit(1)\n')
    piston, other, given = (f'{namespace}/{name}' for name in (PISTON_STATE, 'other', 'given'))
    wanted = (piston, other, f'{given}=std_msgs/msg/String')
    names = ('trapped', 'trapped.__main__', 'trapped::msg::dds_::Foo_', 'trapped/msg/Foo', 'std_msgs::msg::dds_::Bool_')
    stranger = Stranger()
    with graph.run('recorder_node', recorder(bag, *wanted), before=TRAP.format(folder=str(trap))) as process:
        senders = [stranger.sender(topic, name) for topic in (piston, given) for name in names]
        senders += [stranger.sender(other, name) for name in names[:4]]
        graph.until(lambda: all(f'{topic} is published as' in process.stderr for topic in (piston, other, given)))
        outs = {
            piston: (graph.publisher(JointState, piston), JointState(name=['piston'], position=[0.5])),
            other: (graph.publisher(Float64, other), Float64(data=0.5)),
            given: (graph.publisher(String, given), String(data='expected')),
        }
        for topic, (out, message) in outs.items():
            graph.until(lambda topic=topic: f'recording {topic}' in process.stderr)
            graph.until(out.get_subscription_count)
            out.publish(message)
            assert out.wait_for_all_acked()
        assert not graph.set('/recorder_node', use_sim_time=True).successful
        process.stop()
    assert not (tmp_path / 'sprung').exists()
    assert len(senders) == 14  # they have been there all the time
    messages = read_bag(bag)
    assert [one.position[0] for one in messages[piston]] == [0.5]
    assert [one.data for one in messages[other]] == [0.5]
    assert [one.data for one in messages[given]] == ['expected']


def test_a_stranger_whose_name_is_no_text_keeps_nothing_from_being_recorded(graph: Graph, tmp_path: Path) -> None:
    bag, topic = tmp_path / 'bag', f'{unique_namespace()}/{PISTON_STATE}'
    stranger = Stranger()
    stranger.sender(topic, 'std_msgs::msg::dds_::Float64_')
    stranger.take_name(b'\xff\xfenode\x80')
    with graph.run('recorder_node', recorder(bag, topic)) as process:
        out = graph.publisher(JointState, topic)
        graph.until(out.get_subscription_count)
        for _ in range(100):  # what is offered is unknown, so nothing is sent again to one who does not hear us yet
            out.publish(JointState(name=['piston'], position=[0.5]))
            time.sleep(0.02)
        process.stop()
        assert 'a name that is not a text' in process.stderr
    assert {one.position[0] for one in read_bag(bag)[topic]} == {0.5}


def test_what_is_lost_is_said(graph: Graph, tmp_path: Path) -> None:
    namespace, bag = unique_namespace(), tmp_path / 'bag'
    out = graph.publisher(Float64, f'{namespace}/fast')
    shallow = 'import cfd_pneumatic.nodes.recorder_node as node; node._DEPTH = 5'
    sent = 0
    with graph.run('recorder_node', recorder(bag, f'{namespace}/fast'), before=shallow) as process:
        graph.until(out.get_subscription_count)

        def burst() -> None:
            nonlocal sent
            for _ in range(500):
                sent += 1
                out.publish(Float64(data=float(sent)))

        graph.until(lambda: f'messages on {namespace}/fast are lost' in process.stderr, doing=burst)
        out.wait_for_all_acked()
        process.stop()
        written = [message.data for message in read_bag(bag)[f'{namespace}/fast']]
        lost = int(written[-1] - written[0]) + 1 - len(written)
        assert lost > 0
        assert f'{len(written)} messages in {bag}, {lost} were lost' in process.stderr


BAD = (
    ({}, "parameter 'output' is empty"),
    ({'output': '{}/bag'}, "parameter 'topics' is empty"),
    ({'output': '{}/bag', 'topics': '[a]', 'storage': 'tape'}, "parameter 'storage' is 'tape': choose mcap or sqlite3"),
    ({'output': '{}/there', 'topics': '[a]'}, 'there exists already'),
    ({'output': '{}/there', 'topics': '[a]', 'overwrite': True}, 'is not a bag and is not overwritten'),
    ({'output': '{}/there/bag', 'topics': '[a]'}, 'is not a folder'),
    ({'output': '{}/bag', 'topics': '[a b]'}, "parameter 'topics': 'a b': failed to resolve name"),
)  # fmt: skip


def test_what_cannot_be_recorded_is_one_line_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / 'there').write_text('mine')
    command_lines = []
    for parameters, _ in BAD:
        given = {
            name: value.format(tmp_path) if isinstance(value, str) else value for name, value in parameters.items()
        }
        command_lines.append(ros_arguments(parameters=given))
    for line, (_, message) in zip(refusals('recorder_node', command_lines), BAD):
        assert message in line
    assert [path.name for path in tmp_path.iterdir()] == ['there']
    assert (tmp_path / 'there').read_text() == 'mine'


def test_on_a_full_disk_it_ends_in_one_line_and_leaves_what_is_written(graph: Graph, tmp_path: Path) -> None:
    namespace, bag = unique_namespace(), tmp_path / 'bag'
    topic = f'{namespace}/{PISTON_STATE}'
    out = graph.publisher(JointState, topic)
    process = Process('recorder_node', recorder(bag, topic))
    try:
        graph.until(lambda: out.get_subscription_count() and f'recording {topic}' in process.stderr)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (5_000_000, 5_000_000))
        message = JointState(name=['piston'], velocity=[0.0] * 10_000)

        def burst() -> None:
            for message.header.stamp.nanosec in range(10):
                out.publish(message)

        graph.until(lambda: process.exit_code is not None, doing=burst)
        process.wait()
        assert process.exit_code == 2
        assert process.stderr.endswith(f'choose another folder; the messages before the error are in {bag}\n')
        assert 'Traceback' not in process.stderr
        assert 'is cut off: salvaged' in Bag(bag).notes[0]
    finally:
        process.reap()


def recorded_while(graph: Graph, folder: Path, storage: str, doing: Callable[[], object]) -> str:
    """Record 100 samples, with something that happens to the folder of the bag in between; return what is printed."""
    topic = f'{unique_namespace()}/{PISTON_STATE}'
    out = graph.publisher(JointState, topic)
    process = Process('recorder_node', recorder(folder / 'bag', topic, storage=storage))
    try:
        graph.until(lambda: out.get_subscription_count() and f'recording {topic}' in process.stderr)
        for number in range(100):
            if number == 50:
                doing()
                graph.until(lambda: 'was moved' in process.stderr or process.exit_code is not None)
            out.publish(JointState(name=['piston'], position=[0.5]))
        assert out.wait_for_all_acked()
        if process.exit_code is None:
            graph.get('/recorder_node', 'output')  # behind the messages
            os.kill(process.pid, signal.SIGINT)
        assert process.wait() == 2
        assert 'Traceback' not in process.stderr
        return process.stderr
    finally:
        process.reap()


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_folder_that_is_moved_meanwhile_is_reported_and_the_bag_is_complete_in_it(
    graph: Graph, tmp_path: Path, storage: str
) -> None:
    before, after = tmp_path / 'before', tmp_path / 'after'
    printed = recorded_while(graph, before, storage, lambda: before.rename(after))
    assert f'the recording goes on, and the bag will be {after}/bag.' in printed
    assert f'The bag is complete, but not at {before}/bag: move or use {after}/bag' in printed.splitlines()[-1]
    assert [len(found) for found in read_bag(after / 'bag').values()] == [100]
    assert os.listdir(after) == ['bag']


def test_a_folder_that_is_removed_meanwhile_ends_the_recording_in_one_line(graph: Graph, tmp_path: Path) -> None:
    printed = recorded_while(graph, tmp_path / 'before', 'mcap', lambda: shutil.rmtree(tmp_path / 'before'))
    assert f'cannot write {tmp_path}/before/bag: {tmp_path}/before was removed' in printed.splitlines()[-1]
