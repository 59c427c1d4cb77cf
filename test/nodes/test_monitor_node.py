# SPDX-License-Identifier: Apache-2.0
"""`monitor_node` beside a device over real DDS: residuals, predictions, alarms with their cause, faults of the feed."""

from __future__ import annotations

import math
import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from graph import (
    DESCRIBED,
    MILLISECOND,
    QUEUE,
    Graph,
    Process,
    environment_with_studies,
    ros_arguments,
    unique_namespace,
)
from patience import LONG_PATIENCE, allowed, wait_until
from rclpy.exceptions import InvalidParameterValueException
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CONTACT_FORCE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    residual_topic,
    setpoint_topic,
)
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.identification import identify
from cfd_pneumatic.nodes.health import LOST
from cfd_pneumatic.nodes.messages import stamp_message
from cfd_pneumatic.nodes.monitor_node import MonitorNode
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import Sensors, record, surface_following
from cfd_pneumatic.units import PSI
from studies.panel.specimen import draw_specimen

DEVICE = """
import os
from functools import partial
import numpy as np
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.rig_node import RigNode
from studies.panel.specimen import draw_specimen
os._exit(run('rig_node', partial(RigNode, draw_specimen(np.random.default_rng(7))[0].rig)))
"""
"""A program: `rig_node` with a device that is as the paper's model."""

MEASURED = (PISTON_STATE, *map(setpoint_topic, CYLINDERS), *map(pressure_topic, CYLINDERS), MEASURED_FORCE)
SETTINGS = {'block': 0.05, 'learning': 3.0, 'diagnosis_window': 10.0}

LEAK = 'effects_a.leak_conductance=1e-10'


@contextmanager
def device(namespace: str) -> Iterator[subprocess.Popen]:
    """Run the device, which follows a surface as soon as somebody listens."""
    settings = {'schedule': 'surface_following', 'repeat': True, 'start_subscribers': 2, 'start_delay': 0.3}
    program = [sys.executable, '-c', DEVICE, *ros_arguments(namespace, settings)]
    process = subprocess.Popen(program, env=environment_with_studies())
    try:
        yield process
        process.terminate()
        assert process.wait(allowed()) == 0
    finally:
        process.kill()
        process.wait()


def beside(namespace: str, source: str, file: Path | None = None, **settings: object) -> list[str]:
    """
    Return the command line of a monitor that hears what is published in another namespace, and loses none of it.

    What is best effort may be lost on a busy machine, and while its publisher is stopped.
    """
    reliable = {f'qos_overrides.{source}/{topic}.subscription.reliability': 'reliable' for topic in MEASURED}
    remapped = {topic: f'{source}/{topic}' for topic in MEASURED}
    arguments = ros_arguments(namespace, SETTINGS | reliable | settings, remapped)
    return [*arguments, *(DESCRIBED if file is None else ['--params-file', str(file)])]


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]


def have_ended(pids: list[int]) -> bool:
    def state(pid: int) -> str:
        try:
            return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
        except FileNotFoundError:
            return 'Z'

    return all(state(pid) == 'Z' for pid in pids)


@pytest.fixture(scope='module')
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the parameter file of an identification of the device."""
    rig = draw_specimen(np.random.default_rng(7))[0].rig
    got = record(surface_following(duration=20.0, seed=1), rig, seed=1)
    file = tmp_path_factory.mktemp('identified') / 'parameters.yaml'
    file.write_text(identified_device(identify([recording_of(got)])).text)
    return file


def listen(graph: Graph, message_type: type, topic: str) -> list[bytes]:
    """Return a list that messages are appended to as they come: to read each takes longer than to write it."""
    heard: list[bytes] = []
    graph.node.create_subscription(message_type, topic, heard.append, QUEUE, raw=True)
    return heard


def meanwhile(graph: Graph, monitor: str, part: str) -> str:
    """Return what a monitor has said of a part since it was last waited for."""
    return graph.until(lambda: [one.message for one in graph.diagnostics if one.name == f'{monitor}: {part}'])[-1]


def stamp_of(message: bytes) -> int:
    """Return the stamp that a message begins with [ns]."""
    seconds, rest = struct.unpack_from('<iI', message, 4)
    return seconds * 10**9 + rest


@pytest.mark.slow
def test_a_leak_that_appears_is_named_and_samples_that_are_lost_are_counted(graph: Graph, identified: Path) -> None:
    real, own = unique_namespace(), unique_namespace()
    monitor = f'{own}/monitor_node'
    pistons = listen(graph, JointState, f'{real}/{PISTON_STATE}')
    predicted = listen(graph, FluidPressure, f'{own}/{PREDICTED}{pressure_topic("cylinder_a")}')
    residuals = {name: listen(graph, FluidPressure, f'{own}/{residual_topic(name)}') for name in CYLINDERS}
    forces = listen(graph, WrenchStamped, f'{own}/{residual_topic(CONTACT_FORCE)}')

    def status(part: str, words: str) -> DiagnosticStatus:
        return graph.next_diagnostics(monitor, lambda one: one.name.endswith(part) and words in one.message)

    def sooner_or_later(part: str, words: str) -> DiagnosticStatus:
        latest: list[DiagnosticStatus] = []
        wait_until(
            lambda: latest and words in latest[-1].message,
            seconds=LONG_PATIENCE,
            meanwhile=lambda: latest.append(status(part, '')),
            found=lambda: latest[-1].message,
        )
        return latest[-1]

    with graph.run('monitor_node', beside(own, real, identified)) as process, device(real) as rig:
        assert status('cylinder_a', 'learning the usual residual').level == DiagnosticStatus.OK
        assert status('cylinder_a', 'agrees with its model').level == DiagnosticStatus.OK
        assert graph.set(f'{real}/rig_node', faults=LEAK).successful
        alarm = status('cylinder_a', 'cylinder A loses ')
        assert alarm.level == DiagnosticStatus.WARN
        what = r'cylinder A loses [\d.]+ Pa more than its model (on average|at rest): the diagnosis is running'
        assert re.fullmatch(what, alarm.message), 'as the piston moves or rests just then'
        named = sooner_or_later('cylinder_a', 'looks like leakage (conductance ')
        assert named.level == DiagnosticStatus.ERROR
        assert meanwhile(graph, monitor, 'cylinder_b') == 'agrees with its model'
        rig.send_signal(signal.SIGSTOP)
        silent = status('feed', 'piston_state has been silent for ')
        assert silent.level == DiagnosticStatus.ERROR
        lost = sum(int(value.value) for value in silent.values if value.key == LOST)  # on a busy machine
        sent = len(pistons)
        rig.send_signal(signal.SIGCONT)
        status('feed', 'following piston_state')
        workers = children(process.pid)
        assert workers
    graph.until(lambda: have_ended(workers))
    stamps = [stamp_of(message) for message in pistons]
    for heard in (predicted, *residuals.values(), forces):
        answered = {stamp_of(message) for message in heard}
        first = stamps.index(min(answered))
        assert sum(stamp not in answered for stamp in stamps[first:sent]) <= lost
        assert len(answered) > 3000
    healthy = [deserialize_message(one, FluidPressure).fluid_pressure for one in residuals['cylinder_b'][1000:]]
    assert np.std(healthy) == pytest.approx(Sensors().pressure_noise, rel=0.2)


class Driver:
    """A device's drivers, as fast as they may be: stamps decide, not the clock."""

    def __init__(self, graph: Graph, namespace: str) -> None:
        self.graph = graph
        self.piston_out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
        self.pressures_out = [
            graph.publisher(FluidPressure, f'{namespace}/{pressure_topic(name)}') for name in CYLINDERS
        ]
        for name in CYLINDERS:
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            out = graph.node.create_publisher(Float64, f'{namespace}/{setpoint_topic(name)}', latched)
            out.publish(Float64(data=10 * PSI))
        self.rng = np.random.default_rng(1)
        self.stamp = 10**18

    def meet(self) -> None:
        outs = [self.piston_out, *self.pressures_out]
        self.graph.until(lambda: all(out.get_subscription_count() for out in outs))

    def publish(self, seconds: float, stuck: float | None = None) -> None:
        for index in range(round(seconds * 500)):
            self.stamp += 2 * MILLISECOND
            header = JointState().header
            header.stamp = stamp_message(self.stamp)
            self.piston_out.publish(JointState(header=header, name=['piston'], position=[0.0]))
            for side, out in enumerate(self.pressures_out):
                pressure = AMBIENT_PRESSURE + 10 * PSI + 50.0 * self.rng.standard_normal()
                pressure = stuck if stuck is not None and side == 0 else pressure
                out.publish(FluidPressure(header=header, fluid_pressure=pressure))
            if index % 50 == 0:
                time.sleep(0.01)


class Monitor(NamedTuple):
    """A running monitor beside a driver."""

    process: Process
    name: str
    source: str
    driver: Driver


@pytest.fixture(scope='module')
def monitors(graph: Graph) -> Iterator[dict[str, Monitor]]:
    """Yield monitors that start at once, by whether their feed is lossless; they need not end well."""
    # what a reliable publisher sends again after an overrun takes a minute
    topics = (PISTON_STATE, *map(pressure_topic, CYLINDERS))
    running = {}
    for kind in ('lossless', 'lossy'):
        source, own = unique_namespace(), unique_namespace()
        once = {f'qos_overrides.{source}/{topic}.subscription.reliability': 'best_effort' for topic in topics}
        arguments = beside(own, source, timeout=2.0, **(once if kind == 'lossy' else {}))
        process = Process('monitor_node', arguments)
        running[kind] = Monitor(process, f'{own}/monitor_node', source, Driver(graph, source))
    try:
        yield running
    finally:
        for one in running.values():
            one.process.reap()


def test_a_killed_process_for_diagnoses_is_started_again_and_is_an_error_if_it_is_killed_once_more(
    graph: Graph, monitors: dict[str, Monitor]
) -> None:
    process, monitor, _, _ = monitors['lossless']

    def status(words: str) -> DiagnosticStatus:
        return graph.next_diagnostics(monitor, lambda one: one.name.endswith('diagnosis') and words in one.message)

    def killed() -> DiagnosticStatus:
        for pid in children(process.pid):
            os.kill(pid, signal.SIGKILL)
        return status('was ended by signal 9 (Killed)')

    assert status('ready').level == DiagnosticStatus.OK
    again = killed()
    assert (again.level, again.values[0].value) == (DiagnosticStatus.WARN, '1')
    failed = killed()
    while failed.level == DiagnosticStatus.WARN:  # it was sent before
        failed = status('')
    assert failed.level == DiagnosticStatus.ERROR
    assert failed.message.startswith('alarms are not diagnosed: the diagnosis process ')
    assert '[WARN]' in process.stderr
    assert '[ERROR]' in process.stderr


@pytest.mark.slow
def test_faults_of_the_feed_are_named_and_the_watch_goes_on(graph: Graph, monitors: dict[str, Monitor]) -> None:
    process, monitor, _, driver = monitors['lossless']

    def status(part: str, words: str, stuck: float | None = None) -> DiagnosticStatus:
        return graph.next_diagnostics(
            monitor,
            lambda one: one.name.endswith(part) and words in one.message,
            doing=lambda: driver.publish(0.4, stuck),
        )

    driver.meet()
    graph.next_diagnostics(monitor, lambda one: 'no cylinder_a/pressure yet' in one.message)
    driver.publish(4.0)
    status('cylinder_a', 'agrees with its model')
    level = AMBIENT_PRESSURE + 10 * PSI
    stuck = status('feed', f'cylinder_a/pressure is stuck at {level:.6g} Pa', stuck=level)
    assert stuck.level == DiagnosticStatus.ERROR
    status('feed', 'following piston_state')
    driver.stamp += 3_600_000 * MILLISECOND
    jumped = status('feed', 'the clock of piston_state jumped ahead by 3.6e+03 s')
    assert jumped.level == DiagnosticStatus.WARN
    driver.stamp -= 7_200_000 * MILLISECOND
    status('feed', 'the clock of piston_state jumped back by 7.2e+03 s')
    status('feed', 'following piston_state')
    assert meanwhile(graph, monitor, 'cylinder_a') == 'agrees with its model'
    assert graph.trigger(f'{monitor}/learn').success
    assert 'learning' in status('cylinder_b', 'learning').message
    process.stop()


def test_what_has_gone_wrong_since_the_last_report_is_a_warning(graph: Graph, monitors: dict[str, Monitor]) -> None:
    process, monitor, source, driver = monitors['lossy']
    force_out = graph.publisher(WrenchStamped, f'{source}/{MEASURED_FORCE}')

    def feed(words: str, doing: Callable[[], None] = lambda: None) -> DiagnosticStatus:
        return graph.next_diagnostics(
            monitor,
            lambda one: one.name.endswith('feed') and words in one.message,
            doing=lambda: (driver.publish(0.1), doing()),
        )

    def refused() -> None:
        force = WrenchStamped()
        force.wrench.force.x = math.nan
        force_out.publish(force)

    def overrun() -> None:
        os.kill(process.pid, signal.SIGSTOP)
        driver.publish(1.0)
        os.kill(process.pid, signal.SIGCONT)

    driver.meet()
    graph.until(force_out.get_subscription_count)
    feed('following piston_state', lambda: driver.piston_out.publish(JointState(name=['elbow'], position=[0.0])))
    refusals = feed('ignored measurements', refused)
    assert (refusals.level, 'since the last report' in refusals.message) == (DiagnosticStatus.WARN, True)
    assert feed('lost messages', overrun).level == DiagnosticStatus.WARN
    feed('following piston_state')
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    graph.node.create_publisher(Float64, f'{source}/{setpoint_topic("cylinder_a")}', best_effort)
    feed('QoS mismatches')


def test_the_process_for_diagnoses_ends_with_a_node_that_is_killed(graph: Graph, monitors: dict[str, Monitor]) -> None:
    process = monitors['lossy'].process
    graph.until(lambda: 'ready for piston_state' in process.stderr)
    for pid in children(process.pid):
        os.kill(pid, signal.SIGKILL)
    graph.next_diagnostics(monitors['lossy'].name, lambda one: 'was started again' in one.message)
    workers = children(process.pid)
    assert workers
    assert 'Traceback' not in process.stderr, process.stderr
    os.kill(process.pid, signal.SIGKILL)
    graph.until(lambda: have_ended(workers))


@pytest.fixture
def ros() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.mark.usefixtures('ros')
def test_what_cannot_be_watched_by_is_refused() -> None:
    with pytest.raises(InvalidParameterValueException, match='false_alarm_interval'):
        MonitorNode(parameter_overrides=[Parameter('false_alarm_interval', value=1.0)])


@pytest.mark.usefixtures('ros')
def test_every_parameter_is_described() -> None:
    node = MonitorNode()
    own = [name for name in node._parameters if not name.startswith(('qos_overrides', 'use_sim_time', 'start_type'))]
    assert {'false_alarm_interval', 'learning', 'cylinder_a.k_x', 'cylinder_b.leakage.enabled'} <= set(own)
    for descriptor in node.describe_parameters(own):
        assert len(descriptor.description) > 15, descriptor.name
        if descriptor.floating_point_range:
            assert descriptor.description.endswith(']'), f'{descriptor.name} has no unit'
    node.destroy_node()
