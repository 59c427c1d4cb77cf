# SPDX-License-Identifier: Apache-2.0
"""`rig_node` as a process of its own, over real DDS."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from patience import allowed, wait_until
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_COMMAND,
    PISTON_STATE,
    pressure_topic,
    setpoint_applied_topic,
    setpoint_topic,
)
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.messages import nanoseconds
from cfd_pneumatic.nodes.rig_node import RigNode
from cfd_pneumatic.planning import Limits, Sensing
from cfd_pneumatic.planning.family import family
from cfd_pneumatic.planning.proposal import Drawing
from cfd_pneumatic.rig import paper_step, record, written_schedule
from cfd_pneumatic.units import PSI

NAMESPACE = '/cfd/device'


TYPES = {
    PISTON_STATE: JointState,
    MEASURED_FORCE: WrenchStamped,
    **{pressure_topic(cylinder): FluidPressure for cylinder in CYLINDERS},
    **{setpoint_applied_topic(cylinder): FluidPressure for cylinder in CYLINDERS},
    **{setpoint_topic(cylinder): Float64 for cylinder in CYLINDERS},
}


class Listener:
    """Hears what the rig publishes; it takes messages itself, several times as fast as an executor hands them over."""

    def __init__(self) -> None:
        self.node = Node('listener', namespace=NAMESPACE)
        self.heard: dict[str, list] = {}
        self.sent: dict[str, list[int]] = {}  # when, as the rig says [ns]: topics may overtake each other on the way
        self._subscriptions: dict[str, Subscription] = {}

    def listen(self, *topics: str, to: str = NAMESPACE) -> None:
        for topic in reversed(topics):  # a schedule begins with who hears the first of them
            self.heard[topic], self.sent[topic] = [], []
            self._subscriptions[topic] = self.node.create_subscription(
                TYPES[topic], f'{to}/{topic}', lambda message: None, QoSProfile(depth=2000)
            )

    def _take(self) -> None:
        for topic, subscription in self._subscriptions.items():
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, False):
                    self.heard[topic].append(taken[0])
                    self.sent[topic].append(taken[1]['source_timestamp'])

    def publisher(self, topic: str) -> Callable[[float], None]:
        out = self.node.create_publisher(Float64, topic, 10)
        self.until(lambda: out.get_subscription_count() > 0)
        return lambda value: out.publish(Float64(data=value))

    def until(self, condition: Callable[[], bool]) -> None:
        def meanwhile() -> None:
            time.sleep(2e-3)
            self._take()

        def found() -> dict[str, int]:
            return {topic: len(messages) for topic, messages in self.heard.items()}

        wait_until(condition, meanwhile=meanwhile, found=found)

    def positions(self) -> np.ndarray:
        return np.array([message.position[0] for message in self.heard[PISTON_STATE]])

    def pressures(self, topic: str) -> np.ndarray:
        return np.array([message.fluid_pressure for message in self.heard[topic]])

    def stamps(self, topic: str = PISTON_STATE) -> np.ndarray:
        return np.array([nanoseconds(message.header.stamp) for message in self.heard[topic]])


@pytest.fixture
def listener() -> Iterator[Listener]:
    rclpy.init()
    ear = Listener()
    yield ear
    ear.node.destroy_node()
    rclpy.shutdown()


@contextmanager
def rig(namespace: str = NAMESPACE, **parameters: object) -> Iterator[subprocess.Popen]:
    """Run the node; it ends with the block at the latest."""
    program = 'import sys; from cfd_pneumatic.runtime.start import rig_node; sys.exit(rig_node())'
    command = [sys.executable, '-c', program, '--ros-args', '-r', f'__ns:={namespace}']
    for name, value in parameters.items():
        command += ['-p', f'{name.replace("__", ".")}:={value}']
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=allowed())
        except subprocess.TimeoutExpired:
            process.kill()  # leaves shared memory behind
            process.communicate()


def end(process: subprocess.Popen) -> None:
    """Interrupt it as a user does."""
    process.send_signal(signal.SIGINT)
    assert process.wait(allowed()) == 0


@pytest.fixture(scope='module')
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a planned schedule."""
    file = tmp_path_factory.mktemp('planned') / 'schedule.csv'
    segments = [one for one in family() if one.name in ('sweep', 'set-point step of 100%, A')]
    file.write_text(Drawing(Limits((3e4, 6e4)), Sensing(), (3e4, 4e4), 0.1).draw(segments).table())
    return file


@pytest.fixture(scope='module')
def rigs(planned: Path) -> Iterator[dict[str, subprocess.Popen]]:
    """Yield rigs by their namespaces, which start all at once; each waits for the test that listens to it."""
    schedules = {
        '/planned': {'schedule': planned, 'seed': 3, 'exit_when_done': True},
        '/repeated': {'schedule': 'paper_step', 'schedule_setpoint': 10 * PSI, 'seed': 3, 'repeat': True},
        '/unknown': {'schedule': 'paper'},
    }
    with ExitStack() as running:
        yield {
            namespace: running.enter_context(rig(namespace, start_subscribers=1, start_delay=0.3, **parameters))
            for namespace, parameters in schedules.items()
        }


def test_a_schedule_from_a_file_is_played_as_it_is_recorded(
    listener: Listener, rigs: dict[str, subprocess.Popen], planned: Path
) -> None:
    """And it announces its set-points with the sample before they act."""
    listener.listen(*TYPES, to='/planned')
    process = rigs['/planned']
    expected = record(written_schedule(planned), seed=3)
    listener.until(lambda: process.poll() is not None)
    sampled = [topic for topic in TYPES if TYPES[topic] is not Float64]
    listener.until(lambda: all(len(listener.heard[topic]) >= expected.times.size for topic in sampled))
    assert process.returncode == 0
    assert np.array_equal(listener.positions(), expected.displacement)
    assert np.array_equal([message.wrench.force.x for message in listener.heard[MEASURED_FORCE]], expected.force)
    for index, cylinder in enumerate(CYLINDERS):
        assert np.array_equal(listener.pressures(pressure_topic(cylinder)), expected.pressures[:, index])
        assert np.array_equal(listener.pressures(setpoint_applied_topic(cylinder)), expected.setpoints[:, index])
        assert np.array_equal(listener.stamps(pressure_topic(cylinder)), listener.stamps())
    stamps = listener.stamps()
    assert (stamps - stamps[0]) * 1e-9 == pytest.approx(expected.times - expected.times[0], abs=2e-9)
    first = listener.heard[PISTON_STATE][0]
    assert list(first.name) == ['piston']
    speeds = np.array([message.velocity[0] for message in listener.heard[PISTON_STATE]])
    assert speeds[1:] == pytest.approx(np.diff(expected.displacement) / 2e-3)

    changing = setpoint_topic('cylinder_a')
    applied = listener.pressures(setpoint_applied_topic('cylinder_a'))
    assert np.ptp(applied) == pytest.approx(3e4)
    announced = [message.data for message in listener.heard[changing]]
    assert sorted(set(announced)) == pytest.approx(sorted(set(applied - AMBIENT_PRESSURE)))
    felt = np.flatnonzero(np.diff(applied)) + 1
    sent = np.array(listener.sent[changing])[np.flatnonzero(np.diff(announced)) + 1]
    assert np.searchsorted(listener.sent[PISTON_STATE], sent) == pytest.approx(felt, abs=1)


def test_without_a_schedule_it_does_as_it_is_told(listener: Listener) -> None:
    listener.listen(PISTON_STATE, pressure_topic('cylinder_a'), setpoint_applied_topic('cylinder_a'))
    with rig(schedule='none', faults='none', cylinder_a__initial_setpoint=5 * PSI) as process:
        command, setpoint = (listener.publisher(topic) for topic in (PISTON_COMMAND, setpoint_topic('cylinder_a')))
        listener.until(lambda: len(listener.heard[PISTON_STATE]) > 20)
        assert listener.pressures(pressure_topic('cylinder_a'))[0] == pytest.approx(AMBIENT_PRESSURE + 5 * PSI, abs=300)
        pressure = pressure_topic('cylinder_a')
        for nonsense in (math.nan, math.inf):
            command(nonsense)
            setpoint(nonsense)
        setpoint(1e6)
        command(1e-3)
        setpoint(8 * PSI)
        listener.until(lambda: abs(listener.heard[PISTON_STATE][-1].position[0] - 1e-3) < 1e-5)
        listener.until(lambda: abs(listener.heard[pressure][-1].fluid_pressure - AMBIENT_PRESSURE - 8 * PSI) < 500)
        command(1.0)
        listener.until(lambda: abs(listener.heard[PISTON_STATE][-1].position[0] - 6.35e-3) < 1e-5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(allowed()) == 0
        assert 'ignored: piston_command nan' in process.stderr.read()
    assert set(listener.pressures(setpoint_applied_topic('cylinder_a'))) == {
        AMBIENT_PRESSURE + 5 * PSI, AMBIENT_PRESSURE + 8 * PSI}  # fmt: skip
    speeds = np.diff(listener.positions()) / 2e-3
    assert 0.15 < np.max(speeds) < 0.205


def test_each_output_has_one_reliable_publisher_and_comes_at_its_rate_a_stall_or_not(listener: Listener) -> None:
    """What a stalled machine missed is published afterwards."""
    listener.listen(PISTON_STATE)
    with rig(sample_rate=1000.0) as process:
        listener.until(lambda: len(listener.heard[PISTON_STATE]) > 300)
        for topic, message_type in TYPES.items():
            publishers = listener.node.get_publishers_info_by_topic(f'{NAMESPACE}/{topic}')
            if message_type is Float64:
                assert publishers == [], 'a device does not publish its own set-points'
            else:
                (publisher,) = publishers
                assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        process.send_signal(signal.SIGCONT)
        listener.until(lambda: len(listener.heard[PISTON_STATE]) > 1200)
    assert np.diff(listener.stamps()) * 1e-9 == pytest.approx(1e-3, abs=5e-4)


def test_a_repeated_schedule_has_no_seam(listener: Listener, rigs: dict[str, subprocess.Popen]) -> None:
    applied = setpoint_applied_topic('cylinder_a')
    listener.listen(PISTON_STATE, applied, to='/repeated')
    listener.until(lambda: all(len(heard) > 1000 for heard in listener.heard.values()))
    end(rigs['/repeated'])
    assert np.diff(listener.stamps()) * 1e-9 == pytest.approx(2e-3, abs=5e-4)
    assert set(listener.pressures(applied)) == {AMBIENT_PRESSURE + 10 * PSI}
    positions = listener.positions()
    assert np.array_equal(positions[:350], record(paper_step(10 * PSI), seed=3).displacement)
    assert np.max(np.abs(np.diff(positions[450:850]))) < 2e-5, 'it goes back gently'
    assert positions[850:1000] == pytest.approx(positions[:150], abs=1e-5)


def test_what_cannot_be_played_ends_with_one_line(rigs: dict[str, subprocess.Popen]) -> None:
    process = rigs['/unknown']
    _, errors = process.communicate(timeout=allowed())
    assert process.returncode == 2
    (line,) = errors.strip().splitlines()
    assert line == (
        "rig_node: error: schedule 'paper' is not known: use one of paper_step, out_and_back, surface_following, "
        'or a file *.csv'
    )


@pytest.fixture
def graph() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.mark.usefixtures('graph')
def test_every_parameter_is_described() -> None:
    node = RigNode()
    own = [name for name in node._parameters if not name.startswith(('qos_overrides', 'use_sim_time', 'start_type'))]
    assert 'schedule' in own
    for descriptor in node.describe_parameters(own):
        assert len(descriptor.description) > 15, descriptor.name
        if descriptor.floating_point_range:
            assert descriptor.description.endswith(']'), f'{descriptor.name} has no unit'
    node.destroy_node()


@pytest.mark.usefixtures('graph')
@pytest.mark.parametrize(
    ('values', 'error', 'message'),
    [
        ({'schedule': 'paper_step', 'schedule_duration': 3.0}, InputError, "no option 'duration'"),
        ({'cylinder_a.initial_setpoint': 1e6}, InputError, 'between vacuum and the supply'),
        ({'sample_rate': 0.0}, InvalidParameterValueException, 'sample_rate'),
        ({'device': 'best'}, InputError, "device 'best' is not known: use one of real, paper"),
        ({'faults': 'effects_a.leak=1e-10'}, InputError, 'effects_a.leak is not known'),
        ({'faults': 'seal.coulomb=1.0'}, InputError, 'seal.coulomb cannot be a fault'),
        ({'faults': 'effects_a.dead_band=many'}, InputError, "'effects_a.dead_band=many' must be NAME=NUMBER"),
        ({'faults': 'effects_a.dead_band=-5.0'}, InputError, 'give a positive number'),
        ({'faults': 'a leak'}, InputError, "'a' must be NAME=NUMBER"),
        ({'faults': 'effects_a.dead_band: 300'}, InputError, "'effects_a.dead_band:' must be NAME=NUMBER"),
    ],
)
def test_what_the_rig_cannot_be_is_named(values: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        RigNode(parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])
