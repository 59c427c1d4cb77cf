# SPDX-License-Identifier: Apache-2.0
"""A ROS graph for a test: the nodes as processes of their own, and a client that talks to them over DDS."""

from __future__ import annotations

import itertools
import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from patience import allowed, wait_until
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    FORCE_SETPOINT,
    PISTON_STATE,
    PREVIEW,
    pressure_topic,
    setpoint_applied_topic,
    setpoint_topic,
)
from cfd_pneumatic.nodes.health import LOST
from cfd_pneumatic.nodes.messages import nanoseconds, stamp_message

try:
    from rclpy.experimental import EventsExecutor as Executor
except ImportError:
    Executor = SingleThreadedExecutor

QUEUE = QoSProfile(depth=10_000)
MILLISECOND = 1_000_000
_RETRY = 5.0  # after which a sample without an answer is sent again [s]

OFTEN = {
    module: f'import cfd_pneumatic.nodes.{module} as module; module._DIAGNOSTICS_PERIOD = 0.1'
    for module in ('sim_node', 'monitor_node')
}
"""Lets a node report to `/diagnostics` ten times a second, and not once: tests wait for many reports."""

DESCRIBED = ['--params-file', str(Path(__file__).parents[2] / 'config' / 'table_1.yaml')]
"""Arguments that give a node the paper's gains: it warns if nobody gave it any."""

_numbers = itertools.count()


def environment_with_studies() -> dict[str, str]:
    """Return an environment whose programs can import `studies` from any working folder."""
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
    return os.environ | {'PYTHONPATH': paths}


def unique_namespace() -> str:
    return f'/test_{next(_numbers)}'


FORKING = """\
import gc, json, os, signal, socket, sys
from importlib import import_module
from cfd_pneumatic import model, monitoring
from cfd_pneumatic.runtime import start

for name in ('identifier_node', 'monitor_node', 'recorder_node', 'rig_node', 'sim_node'):
    import_module(f'cfd_pneumatic.nodes.{name}')
model.warm_up()
monitoring.warm_up()
gc.freeze()
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
asked = socket.socket(fileno=int(sys.argv[1]))
while (request := socket.recv_fds(asked, 1_000_000, 2))[0]:
    asking, (stderr, told), *_ = request
    if not os.fork():
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        node = os.fork()
        if not node:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            os.dup2(stderr, 2)
            for file in (asked.fileno(), stderr, told):
                os.close(file)
            module, before, sys.argv[1:] = json.loads(asking)
            exec(before, {})
            sys.exit(getattr(start, module)())
        os.write(told, b'%d\\n' % node)
        os.write(told, b'%d\\n' % os.waitstatus_to_exitcode(os.waitpid(node, 0)[1]))
        os._exit(0)
    for file in (stderr, told):
        os.close(file)
"""
"""
Forks nodes of a process in which all is imported and the model is there, which takes a node most of its start.

Between it and a node stands a process that tells the node's number and, in the end, its exit code.
"""


@cache
def forking() -> socket.socket:
    """Return where nodes are asked for."""
    ours, asked = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with asked:
        subprocess.Popen([sys.executable, '-c', FORKING, str(asked.fileno())], pass_fds=[asked.fileno()])
    return ours


class Forked:
    """A forked node; as much of `Popen` as a test wants."""

    def __init__(self, module: str, arguments: Sequence[str], before: str, stderr: int) -> None:
        told, tell = os.pipe()
        socket.send_fds(forking(), [json.dumps([module, before, arguments]).encode()], [stderr, tell])
        os.close(tell)
        self._told = os.fdopen(told, 'rb', buffering=0)
        self.pid = int(self._told.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        if self.returncode is None and select.select([self._told], [], [], 0.0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            if not select.select([self._told], [], [], timeout)[0]:
                raise TimeoutError(f'it has not ended in {timeout} s')
            self.returncode = int(self._told.readline())
            self._told.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Process:
    """A node that runs."""

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        *,
        before: str = '',
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
    ) -> None:
        """
        Start it, perhaps in a folder and with environment variables of its own.

        `before` is Python that its process runs first. It reports to `/diagnostics` ten times a second.
        """
        self._stderr = TemporaryFile()  # noqa: SIM115
        often = OFTEN.get(module, '')
        if before or environment or folder:
            start = (
                f'{before}\n{often}\nimport sys; from cfd_pneumatic.runtime.start import {module}; sys.exit({module}())'
            )
            self._process: subprocess.Popen | Forked = subprocess.Popen(
                [sys.executable, '-c', start, *arguments],
                stderr=self._stderr,
                env=os.environ | dict(environment or {}),
                cwd=folder,
            )
        else:
            self._process = Forked(module, arguments, often, self._stderr.fileno())

    @property
    def stderr(self) -> str:
        file = self._stderr.fileno()  # not its position, which the process shares
        return os.pread(file, os.fstat(file).st_size, 0).decode()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.poll()

    def wait(self) -> int:
        """Return the exit code."""
        return self._process.wait(allowed())

    def stop(self, number: int = signal.SIGINT) -> None:
        """End it as a user does, cleanly."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        assert self.wait() == 0, self.stderr
        assert 'Traceback' not in self.stderr, self.stderr

    def reap(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._stderr.close()


def ros_arguments(
    namespace: str = '', parameters: Mapping[str, Any] | None = None, remaps: Mapping[str, str] | None = None
) -> list[str]:
    """Return a command line, numbers and lists as a user writes them."""
    arguments = ['--ros-args']
    if namespace:
        arguments += ['-r', f'__ns:={namespace}']
    for name, value in (parameters or {}).items():
        arguments += ['-p', f'{name}:={str(value).lower() if isinstance(value, bool) else value}']
    for name, target in (remaps or {}).items():
        arguments += ['-r', f'{name}:={target}']
    return arguments


REFUSED = """\
import json, os, signal, sys
from importlib import import_module

main = import_module(f'cfd_pneumatic.nodes.{sys.argv[1]}').main
for arguments in json.loads(sys.argv[2]):
    child = os.fork()
    if not child:
        signal.alarm(60)  # ends a node that runs
        sys.argv[1:] = arguments
        os._exit(main())
    print(f'exit code {os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])}', file=sys.stderr)
"""
"""Runs a node with one command line after the other, each in a process of its own, which has the imports done."""


def refusals(module: str, command_lines: Iterable[Sequence[str]]) -> list[str]:
    """Return what a node says to each of these command lines: one line, with exit code 2."""
    command_lines = list(command_lines)
    start = [sys.executable, '-c', REFUSED, module, json.dumps(command_lines)]
    said = subprocess.run(start, stderr=subprocess.PIPE, text=True, check=True, timeout=allowed()).stderr
    lines = [line for line in said.splitlines() if not line.startswith('[INFO]')]
    assert lines[1::2] == ['exit code 2'] * len(command_lines), said
    assert all(line.startswith(f'{module}: error: ') for line in lines[::2]), said
    return lines[::2]


class Graph:
    """The client."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node(f'client_{next(_numbers)}', context=self.context)
        self.executor = Executor(context=self.context)
        self.executor.add_node(self.node)
        self.diagnostics: list[DiagnosticStatus] = []
        self.clients: dict[str, Client] = {}
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda array: self.diagnostics.extend(array.status), QUEUE
        )

    def close(self) -> None:
        self.executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    @contextmanager
    def run(self, module: str, arguments: Sequence[str], **options: Any) -> Iterator[Process]:
        """Run a node, with the options of `Process`; it is ended cleanly, or there is an error."""
        process = Process(module, arguments, **options)
        try:
            yield process
            process.stop()
        except BaseException:
            print(f'{module}, exit code {process.exit_code}, had said:\n{process.stderr}')
            raise
        finally:
            process.reap()

    @contextmanager
    def run_here(self, node: Node) -> Iterator[Node]:
        """Run a node in this process, beside the client, which takes a tenth of the time, and destroy it."""
        self.executor.add_node(node)
        try:
            yield node
        finally:
            self.executor.remove_node(node)
            for _ in range(10):
                self.executor.spin_once(timeout_sec=0.0)  # or what it was about to do meets a node that is destroyed
            node.destroy_node()

    def until(
        self,
        condition: Callable[[], Any],
        *,
        doing: Callable[[], None] | None = None,
        every: float = 0.1,
        otherwise: Callable[[], Any] = lambda: 'nothing of the kind',
    ) -> Any:
        """
        Return what the condition gives as soon as it is true; meanwhile do something again and again [s].

        `otherwise` returns what a failure reports.
        """
        again = 0.0

        def meanwhile() -> None:
            nonlocal again
            if doing is not None and time.monotonic() >= again:
                doing()
                again = time.monotonic() + allowed(every)  # or it would hear less and less of what answers
            self.executor.spin_once(timeout_sec=0.05)

        return wait_until(condition, meanwhile=meanwhile, found=otherwise)

    def listen(self, message_type: type, topic: str, qos: QoSProfile = QUEUE) -> list[Any]:
        """Return a list that messages are appended to."""
        heard: list[Any] = []
        self.node.create_subscription(message_type, topic, heard.append, qos)
        return heard

    def publisher(self, message_type: type, topic: str) -> Publisher:
        return self.node.create_publisher(message_type, topic, QUEUE)

    def discover(self, service: type, *names: str) -> None:
        """Let services and a client of each discover each other, all at once, where they have not."""
        # a reply that leaves before its sender has discovered the client is lost: one client for all calls
        new = {name: self.node.create_client(service, name) for name in names if name not in self.clients}
        if new:
            self.clients |= new
            self.until(lambda: all(client.service_is_ready() for client in new.values()))
            for node in {name.rpartition('/')[0] for name in new}:
                self._greet(node)

    def _greet(self, node: str) -> None:
        """Ask a node again and again until it answers a client that is younger than all others, which it knows then."""
        client = self.node.create_client(GetParameters, f'{node}/get_parameters')
        answers: list[Future] = []
        self.until(
            lambda: any(map(Future.done, answers)),
            doing=lambda: client.service_is_ready() and answers.append(client.call_async(GetParameters.Request())),
            every=0.2,
        )
        self.node.destroy_client(client)

    def call(self, service: type, name: str, request: Any = None) -> Any:
        self.discover(service, name)
        client = self.clients[name]
        self.until(client.service_is_ready)
        futures: list[Future] = []

        def ask() -> None:
            futures.append(client.call_async(service.Request() if request is None else request))

        # on a busy machine a reply may be lost all the same; what is done once must not be asked for again
        every = math.inf if service is Trigger else 5.0
        return self.until(lambda: next(filter(Future.done, futures), None), doing=ask, every=every).result()

    def trigger(self, name: str) -> Trigger.Response:
        return self.call(Trigger, name)

    def set(self, node: str, **values: Any) -> SetParametersResult:
        """Set one parameter; a name's dot is written as two underscores."""
        parameters = _parameter_messages(values)
        (result,) = self.call(
            SetParameters, f'{node}/set_parameters', SetParameters.Request(parameters=parameters)
        ).results
        return result

    def set_atomically(self, node: str, **values: Any) -> SetParametersResult:
        request = SetParametersAtomically.Request(parameters=_parameter_messages(values))
        return self.call(SetParametersAtomically, f'{node}/set_parameters_atomically', request).result

    def get(self, node: str, *names: str) -> list[Any]:
        values = self.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values
        return [rclpy.parameter.parameter_value_to_python(value) for value in values]

    def await_answers(self, *nodes: str) -> None:
        """Wait until nodes answer, which they do once their topics are open."""
        self.discover(GetParameters, *(f'{node}/get_parameters' for node in nodes))
        for node in nodes:
            self.get(node, 'use_sim_time')

    def next_diagnostics(
        self, node: str, accept: Callable[[DiagnosticStatus], bool], *, doing: Callable[[], None] | None = None
    ) -> DiagnosticStatus:
        """Return the first acceptable status of a node that comes from now on."""
        self.diagnostics.clear()

        def found() -> DiagnosticStatus | None:
            return next((one for one in self.diagnostics if one.name.startswith(f'{node}: ') and accept(one)), None)

        return self.until(
            found, doing=doing, otherwise=lambda: [(status.name, status.message) for status in self.diagnostics[-9:]]
        )


def _parameter_messages(values: Mapping[str, Any]) -> list[Any]:
    return [Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()]


class SimClient:
    """Plays the device to a `sim_node` and hears its answers."""

    def __init__(
        self, graph: Graph, namespace: str, *, inputs: str | None = None, cylinders: Sequence[str] = CYLINDERS
    ) -> None:
        """Talk to the node in a namespace; its inputs are in another one where `inputs` names it."""
        self.graph = graph
        self.node = f'{namespace}/sim_node'
        self.cylinders = cylinders
        source = namespace if inputs is None else inputs
        self.piston_out = graph.publisher(JointState, f'{source}/{PISTON_STATE}')
        self.setpoints_out = [graph.publisher(Float64, f'{source}/{setpoint_topic(name)}') for name in cylinders]
        self.force_out = graph.publisher(Float64, f'{source}/{FORCE_SETPOINT}')
        self.heard = {
            topic: graph.listen(message_type, f'{namespace}/{topic}')
            for topic, message_type in (
                *((pressure_topic(name), FluidPressure) for name in cylinders),
                *((setpoint_applied_topic(name), FluidPressure) for name in cylinders),
                (CONTACT_FORCE, WrenchStamped),
            )
        }
        self.previews = {
            topic: graph.listen(message_type, f'{namespace}/{PREVIEW}{topic}')
            for topic, message_type in (
                *((pressure_topic(name), FluidPressure) for name in cylinders),
                (CONTACT_FORCE, WrenchStamped),
            )
        }
        self.stamp, self.position = 1_000_000_000_000, 0.0
        self.sent = 0

    def meet(self) -> SimClient:
        """Wait until messages get through in both directions, and begin anew."""
        outs = [*self.setpoints_out, self.force_out]
        self.graph.until(lambda: all(out.get_subscription_count() for out in outs))
        self.graph.until(lambda: all(self.heard.values()), doing=lambda: self.send(self.stamp + MILLISECOND, 0.0))
        # topics are discovered one after the other: an early answer may have been heard on some of them only
        self.graph.until(lambda: len({str(messages[-1].header.stamp) for messages in self.heard.values()}) == 1)
        return self.restart()

    def restart(self) -> SimClient:
        """Reset the node and forget what was heard."""
        assert self.graph.trigger(f'{self.node}/reset').success
        for messages in (*self.heard.values(), *self.previews.values()):
            messages.clear()
        self.sent = 0
        return self

    def send(self, stamp: int, position: float, joint: str = 'piston') -> None:
        self.stamp, self.position = stamp, position
        message = JointState(name=[joint], position=[position])
        message.header.stamp = stamp_message(stamp)
        self.piston_out.publish(message)
        self.sent += 1

    def setpoint(self, index: int, value: float) -> None:
        self.setpoints_out[index].publish(Float64(data=float(value)))

    def force_setpoint(self, value: float) -> None:
        self.force_out.publish(Float64(data=float(value)))

    def sample(self, stamp: int, position: float) -> dict[str, Any]:
        """Send a sample, again if it may be lost, for the node ignores a repeated stamp; return its answer by topic."""
        self.send(stamp, position)
        sent = time.monotonic()

        def send_again() -> None:
            if time.monotonic() - sent > _RETRY:
                self.send(stamp, position)

        return self.graph.until(lambda: self.answer(stamp), doing=send_again, every=_RETRY)

    def account_for_all(self, lost: int) -> list[int]:
        """
        Wait until each sample since the restart is answered or counted as lost; return the stamps that are answered.

        `lost` is how many were counted before. More samples, with the same position, show whether the last one is lost.
        """
        topics = [*self.heard]

        def all_accounted_for() -> bool:
            self.send(self.stamp + MILLISECOND, self.position)
            answers = self.sent - (self.count(LOST) - lost)
            return all(len(self.heard[topic]) == answers for topic in topics)

        self.graph.until(all_accounted_for)
        answered, *others = ([stamp for stamp, _ in self.series(topic)] for topic in topics)
        assert others == [answered] * len(others)
        return answered

    def answer(self, stamp: int) -> dict[str, Any] | None:
        """Return the answer to a stamp once it is whole, newest first where there are several."""
        found = {
            topic: next((message for message in reversed(messages) if nanoseconds(message.header.stamp) == stamp), None)
            for topic, messages in self.heard.items()
        }
        if None in found.values():
            return None
        return {
            topic: message.wrench.force if topic == CONTACT_FORCE else message.fluid_pressure
            for topic, message in found.items()
        }

    def series(self, topic: str, previews: bool = False) -> list[tuple[int, float]]:
        """Return stamps and values heard on a topic, or on that of its previews."""
        return [
            (
                nanoseconds(message.header.stamp),
                message.wrench.force.x if topic == CONTACT_FORCE else message.fluid_pressure,
            )
            for message in (self.previews if previews else self.heard)[topic]
        ]

    def count(self, key: str) -> int:
        """Return a counter from fresh diagnostics."""
        status = self.graph.next_diagnostics(self.node, lambda _: True)
        return int(next(value.value for value in status.values if value.key == key))
