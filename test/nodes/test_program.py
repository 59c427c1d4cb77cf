# SPDX-License-Identifier: Apache-2.0
"""Every node's main, ended by a signal at a bad moment, and what it says of parameters that are none."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import product
from pathlib import Path

import pytest
from graph import Graph, ros_arguments, unique_namespace
from patience import allowed
from sensor_msgs.msg import JointState

from cfd_pneumatic.convention import PISTON_STATE

BIN = Path(sys.executable).parent
NODES = ('sim_node', 'monitor_node', 'identifier_node', 'rig_node', 'recorder_node')

PROGRAM = """
import os, signal, sys, time
from rclpy.node import Node
from cfd_pneumatic.nodes.program import run

signal.signal(signal.SIGHUP, signal.SIG_DFL)  # where nohup runs the tests, it is ignored

class Ended(Node):
    def __init__(self):
        if {while_made}:
            os.kill(os.getpid(), signal.{name})
            time.sleep(10.0)
        super().__init__('ended')
        self.create_timer(0.01, self.work)

    def work(self):
        os.kill(os.getpid(), signal.{name})
        self.create_timer(1.0, print)
        self.get_logger().info('worked')

    def destroy_node(self):
        os.kill(os.getpid(), signal.SIGINT)
        print('what has to be finished is', end=' ')
        super().destroy_node()
        print('finished')

sys.exit(run('ended', Ended, []))
"""
"""A node that ends itself in the middle of its work; an interrupt comes while it finishes."""

BUSY = """
import ctypes, sys
import cfd_pneumatic.nodes.program as program

def make():
    print('busy', flush=True)
    ctypes.CDLL(None).sleep(300)

sys.exit(program.run('busy', make, []))
"""
"""A node whose making is in machine code for long, as a compiler's, which hears no signal."""


IMPORTED = """
from rclpy.parameter import Parameter
from rclpy.time_source import TimeSource
before = dict(vars(TimeSource)), dict(vars(Parameter.Type))
import cfd_pneumatic.nodes.sim_node
assert (dict(vars(TimeSource)), dict(vars(Parameter.Type))) == before
"""


def test_importing_a_node_changes_nothing_of_rclpy() -> None:
    subprocess.run([sys.executable, '-c', IMPORTED], check=True)


def is_heeded(pid: int, number: signal.Signals) -> bool:
    """Return whether a process has a handler for a signal."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    (caught,) = (line.split()[1] for line in status.splitlines() if line.startswith('SigCgt'))
    return bool(int(caught, 16) >> (number - 1) & 1)


def used(pid: int) -> float:
    """Return how much CPU time a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def test_a_signal_at_a_bad_moment_ends_it_without_a_complaint() -> None:
    def ended(case: tuple[str, bool]) -> subprocess.CompletedProcess[str]:
        program = PROGRAM.format(name=case[0], while_made=case[1])
        return subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=False)

    cases = list(product(('SIGTERM', 'SIGINT', 'SIGHUP'), (True, False)))
    with ThreadPoolExecutor() as workers:
        for case, one in zip(cases, workers.map(ended, cases)):
            said = '' if case[1] else 'what has to be finished is finished\n'
            assert (one.returncode, one.stdout) == (0, said), (case, one.stderr)
            assert [line for line in one.stderr.splitlines() if 'worked' not in line] == [], case


def test_a_signal_ends_it_in_the_middle_of_machine_code() -> None:
    numbers = signal.SIGINT, signal.SIGTERM
    with ExitStack() as stack:
        start = [sys.executable, '-c', BUSY]
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'text': True}
        nodes = [stack.enter_context(subprocess.Popen(start, **pipes)) for _ in numbers]
        for node, number in zip(nodes, numbers):
            node.stdout.readline()
            began = time.monotonic()
            node.send_signal(number)
            _, said = node.communicate(timeout=allowed())
            assert (node.returncode, said) == (0, '')
            assert time.monotonic() - began < allowed(15.0), 'it slept on'


@pytest.mark.parametrize('turn', [0, 1])
def test_a_signal_at_any_moment_of_the_start_ends_it_silently(graph: Graph, tmp_path: Path, turn: int) -> None:
    """
    From its first own line, while samples come at 500 Hz, until it runs.

    Each node at two of ten moments: once it has used so much CPU time.
    """
    processes, outs = [], []
    with ExitStack() as stack:
        for module in NODES:
            topic = f'{unique_namespace()}/{PISTON_STATE}'
            outs.append(graph.publisher(JointState, topic))
            needed = {'topics': f'[{topic}]', 'output': tmp_path / 'bag'} if module == 'recorder_node' else {}
            start = [BIN / module, *ros_arguments(topic.rpartition('/')[0], needed)]
            one = subprocess.Popen(start, stderr=subprocess.PIPE, text=True, start_new_session=True)
            processes.append(stack.enter_context(one))
        starting, late = dict(enumerate(processes)), time.monotonic() + allowed(3.0)
        while starting:
            for out in outs:
                out.publish(JointState(name=['piston'], position=[0.0]))
            for number, one in [*starting.items()]:
                moment = 0.08 * (2 * number + turn)  # [s]
                due = used(one.pid) >= moment or time.monotonic() > late  # it may have nothing more to do
                if due and is_heeded(one.pid, signal.SIGTERM):
                    kind = signal.SIGINT, signal.SIGTERM
                    os.killpg(one.pid, kind[(number + turn) % 2])  # as a terminal does
                    del starting[number]
            assert time.monotonic() < late + allowed(), 'a signal is not heeded'
            time.sleep(0.002)
        for module, one in zip(NODES, processes):
            _, said = one.communicate(timeout=allowed())
            usual = ('[INFO]', 'zero stamp', 'never seen')
            assert one.returncode == 0, module
            assert [line for line in said.splitlines() if not any(word in line for word in usual)] == [], module


def test_signals_that_go_on_change_nothing() -> None:
    """As from somebody who keeps Ctrl-C down; the last of them come while Python itself ends."""
    start = [BIN / 'sim_node', *ros_arguments(unique_namespace(), {})]
    with subprocess.Popen(start, stderr=subprocess.PIPE, text=True) as one:
        assert any('ready' in line for line in one.stderr)
        while one.poll() is None:
            one.send_signal(signal.SIGINT)
            time.sleep(0.001)
        assert (one.returncode, one.stderr.read()) == (0, '')


def test_a_parameter_that_nobody_declared_is_warned_about_and_one_without_a_name_refused(
    graph: Graph, tmp_path: Path
) -> None:
    given = {'cylinder_a.taau': 0.1, 'frame': 'cfd', 'topics': '[/nothing]', 'output': tmp_path / 'bag'}
    namespace = unique_namespace()
    with ExitStack() as stack:
        nodes = {module: stack.enter_context(graph.run(module, ros_arguments(namespace, given))) for module in NODES}
        for module, process in nodes.items():
            graph.until(lambda process=process: 'this node has no parameter frame' in process.stderr)
            if module in ('sim_node', 'monitor_node'):
                assert (
                    'this node has no parameter cylinder_a.taau: its value has no effect. Did you mean cylinder_a.tau?'
                    in process.stderr
                )
        assert not graph.set(f'{namespace}/sim_node', **{'': math.nan}).successful


def test_without_a_home_it_ends_in_one_line() -> None:
    without = {name: value for name, value in os.environ.items() if name not in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')}
    ended = subprocess.run([BIN / 'sim_node'], capture_output=True, text=True, check=False, env=without)
    reason = 'the log folder is below HOME, and HOME is not set. Set HOME or ROS_LOG_DIR'
    assert (ended.returncode, ended.stderr) == (2, f'sim_node: error: ROS cannot start: {reason}\n')


def test_what_ros_has_against_a_node_is_one_line(tmp_path: Path) -> None:
    enclave = tmp_path / 'enclaves' / 'cell'
    enclave.mkdir(parents=True)
    for file in ('identity_ca.cert', 'cert', 'key', 'permissions_ca.cert'):
        (enclave / f'{file}.pem').touch()
    for file in ('governance', 'permissions'):
        (enclave / f'{file}.p7s').touch()
    secured = {
        'ROS_SECURITY_ENABLE': 'true',
        'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': str(tmp_path),
    }
    recorded = ['-p', 'topics:=[/nothing]', '-p', f'output:={tmp_path / "bag"}']

    def ended(case: tuple[str, str]) -> subprocess.CompletedProcess[str]:
        module, enclave_name = case
        needed = recorded if module == 'recorder_node' else []
        start = [BIN / module, '--ros-args', '--enclave', enclave_name, *needed]
        return subprocess.run(start, env=os.environ | secured, stderr=subprocess.PIPE, text=True, check=False)

    # ROS looks for the enclave before there is a node, whichever that is
    cases = [('sim_node', '/cell'), ('recorder_node', '/cell'), ('sim_node', '/missing')]
    with ThreadPoolExecutor() as workers:
        for case, one in zip(cases, workers.map(ended, cases)):
            (line,) = one.stderr.splitlines()
            assert one.returncode == 2, case
            assert line.startswith(f'{case[0]}: error: ')
            assert ('does not exist' if case[1] == '/missing' else 'ROS cannot make the node') in line
