"""Every node's main, ended by a signal at a bad moment, and what it says of parameters that are none."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import pytest
from graph import Graph, ros_arguments, unique_namespace
from sensor_msgs.msg import JointState

from cfd_pneumatic.convention import PISTON_STATE

BIN = Path(sys.executable).parent
NODES = ('sim_node', 'monitor_node', 'identifier_node', 'rig_node', 'recorder_node')
PATIENCE = 60.0  # of the one who waits for a program to come to a certain point [s]

PROGRAM = """
import os, signal, sys, time
from rclpy.node import Node
from cfd_pneumatic.nodes.program import run

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
    ctypes.CDLL(None).sleep(30)

sys.exit(program.run('busy', make, []))
"""
"""A node whose making is in machine code for long, as a compiler's, which hears no signal."""


def is_heeded(pid: int, number: signal.Signals) -> bool:
    """Return whether a process has a handler for a signal."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    (caught,) = (line.split()[1] for line in status.splitlines() if line.startswith('SigCgt'))
    return bool(int(caught, 16) >> (number - 1) & 1)


@pytest.mark.parametrize(('name', 'while_made'), list(product(('SIGTERM', 'SIGINT', 'SIGHUP'), (True, False))))
def test_a_signal_at_a_bad_moment_ends_it_without_a_complaint(name: str, while_made: bool) -> None:
    program = PROGRAM.format(name=name, while_made=while_made)
    ended = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=False)
    said = '' if while_made else 'what has to be finished is finished\n'
    assert (ended.returncode, ended.stdout) == (0, said), ended.stderr
    assert [line for line in ended.stderr.splitlines() if 'worked' not in line] == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_the_middle_of_machine_code(number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', BUSY], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as busy:
        assert busy.stdout is not None
        busy.stdout.readline()
        began = time.monotonic()
        busy.send_signal(number)
        _, said = busy.communicate(timeout=PATIENCE)
    assert (busy.returncode, said) == (0, '')
    assert time.monotonic() - began < 15.0, 'it slept on'


@pytest.mark.parametrize('module', NODES)
def test_a_signal_at_any_moment_of_the_start_ends_it_silently(graph: Graph, tmp_path: Path, module: str) -> None:
    """From its first own line, while samples come at 500 Hz, until it runs."""
    namespace = unique_namespace()
    out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
    for index in range(8):
        needed = {'topics': f'[{namespace}/{PISTON_STATE}]', 'output': tmp_path / f'bag_{index}'}
        arguments = ros_arguments(namespace, needed if module == 'recorder_node' else {})
        with subprocess.Popen(
            [BIN / module, *arguments], stderr=subprocess.PIPE, text=True, start_new_session=True
        ) as process:
            graph.until(lambda process=process: is_heeded(process.pid, signal.SIGTERM))
            until = time.monotonic() + 0.2 * index  # [s]
            while time.monotonic() < until:
                out.publish(JointState(name=['piston'], position=[0.0]))
                time.sleep(0.002)
            os.killpg(process.pid, (signal.SIGINT, signal.SIGTERM)[index % 2])  # as a terminal does
            _, said = process.communicate(timeout=PATIENCE)
        usual = ('[INFO]', 'zero stamp', 'never seen')
        assert process.returncode == 0
        assert [line for line in said.splitlines() if not any(word in line for word in usual)] == []


@pytest.mark.parametrize('module', NODES)
def test_a_parameter_that_nobody_declared_is_warned_about(graph: Graph, tmp_path: Path, module: str) -> None:
    given = {'cylinder_a.taau': 0.1, 'frame': 'cfd', 'topics': '[/nothing]', 'output': tmp_path / 'bag'}
    with graph.run(module, ros_arguments(unique_namespace(), given)) as process:
        graph.until(lambda: 'parameter frame is none of this node' in process.stderr)
        if module in ('sim_node', 'monitor_node'):
            assert 'cylinder_a.taau is none of this node, and has no effect: did you mean cylinder_a.tau?' in (
                process.stderr
            )


def test_a_parameter_without_a_name_is_refused(graph: Graph) -> None:
    namespace = unique_namespace()
    with graph.run('sim_node', ros_arguments(namespace, {})):
        assert not graph.set(f'{namespace}/sim_node', **{'': math.nan}).successful


def test_without_a_home_it_ends_in_one_line() -> None:
    without = {name: value for name, value in os.environ.items() if name not in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')}
    ended = subprocess.run([BIN / 'sim_node'], capture_output=True, text=True, check=False, env=without)
    line = 'sim_node: error: ROS cannot start: it writes its log below HOME, which is not set: set it, or ROS_LOG_DIR\n'
    assert (ended.returncode, ended.stderr) == (2, line)


@pytest.mark.parametrize('module', NODES)
def test_what_ros_has_against_a_node_is_one_line(tmp_path: Path, module: str) -> None:
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
    needed = ['-p', 'topics:=[/nothing]', '-p', f'output:={tmp_path / "bag"}'] if module == 'recorder_node' else []
    for enclave_name, why in (('/cell', 'ROS cannot make the node'), ('/missing', 'does not exist')):
        ended = subprocess.run(
            [BIN / module, '--ros-args', '--enclave', enclave_name, *needed],
            env=os.environ | secured,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        (line,) = ended.stderr.splitlines()
        assert ended.returncode == 2
        assert line.startswith(f'{module}: error: ')
        assert why in line
