# SPDX-License-Identifier: Apache-2.0
"""
Send serialised messages to the topics of nodes, and requests to their parameter services.

A node runs in this process with the settings and the executor of its program. Messages and requests go through DDS. An
exception of the executor is a fault, because the exception would end the program.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter as NodeParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CYLINDERS,
    FORCE_SETPOINT,
    MEASURED_FORCE,
    PISTON_COMMAND,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import Layout, LayoutError, Serialization, standard_types
from cfd_pneumatic.nodes import (
    IdentifierNode,
    MonitorNode,
    RecorderNode,
    RigNode,
    SimNode,
    nanoseconds,
    patch_rclpy,
    stamp_message,
    warn_of_undeclared,
)
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import BINARY, DOUBLES, TEXTS, mutated

try:
    from rclpy.experimental import EventsExecutor as Executor
except ImportError:  # before Jazzy
    from rclpy.executors import SingleThreadedExecutor as Executor

_ANSWER = 5.0  # time limit of an answer to a valid input [s]
_QUEUE = QoSProfile(depth=1000)
_MILLISECOND = 1_000_000
_SERVICES = {
    ListParameters: 'list_parameters',
    GetParameters: 'get_parameters',
    DescribeParameters: 'describe_parameters',
}
_FIELDS = {ListParameters: 'prefixes', GetParameters: 'names', DescribeParameters: 'names'}
_VALID_VALUES = {PISTON_COMMAND: 1e-3, FORCE_SETPOINT: 20.0}  # by topic; all other topics get set-points
_SETPOINTS = {setpoint_topic(name): Float64 for name in CYLINDERS}
_PRESSURES = {pressure_topic(name): FluidPressure for name in CYLINDERS}


class _WithNode(Kind):
    """A kind of inputs that are sent to a node."""

    def __init__(self, make: Callable[..., Node], parameters: Mapping[str, Any] | None = None) -> None:
        self._make, self._parameters = make, parameters or {}

    def start(self, folder: Path) -> None:
        """Start the node and the sender."""
        patch_rclpy()
        self._context = Context()
        rclpy.init(context=self._context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        overrides = [NodeParameter(name, value=value) for name, value in self._parameters.items()]
        if self._make is RecorderNode:
            self._bag = folder / 'bag'
            overrides.append(NodeParameter('output', value=str(self._bag)))
        set_logger_level('fuzzed', LoggingSeverity.FATAL)
        self._node = self._make(namespace='/fuzzed', context=self._context, parameter_overrides=overrides)
        warn_of_undeclared(self._node)
        self._client = Node('sender', namespace='/fuzzed', context=self._context)
        self._executor = Executor(context=self._context)
        self._executor.add_node(self._node)
        self._executor.add_node(self._client)
        self._connect()

    @abstractmethod
    def _connect(self) -> None:
        """Create publishers or clients, and wait for the connection."""

    def stop(self) -> None:
        """End the node and the sender."""
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        self._client.destroy_node()
        rclpy.shutdown(context=self._context)

    def _until(self, condition: Callable[[], object], patience: float = _ANSWER) -> None:
        limit = time.monotonic() + patience
        while not condition():
            if time.monotonic() > limit:
                raise Fault('the node does not answer a valid input any more')
            self._executor.spin_once(timeout_sec=0.5)


class Messages(_WithNode):
    """
    Serialised messages; after each the node must answer a valid message with finite numbers.

    Parameters
    ----------
    make, parameters
        Class of the node, and its parameters.
    inputs
        Types of the messages by topic.
    answer
        Topic of the answers; empty for a recorder, of which written messages are counted.

    """

    def __init__(
        self,
        make: Callable[..., Node],
        inputs: Mapping[str, type],
        answer: str = '',
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(make, parameters)
        self.name = f'messages to {_module(make)}'
        self._inputs, self._answer = inputs, answer

    def _connect(self) -> None:
        self._outs = {topic: self._client.create_publisher(kind, topic, _QUEUE) for topic, kind in self._inputs.items()}
        self._received: list[FluidPressure] = []
        if self._answer:
            self._client.create_subscription(FluidPressure, self._answer, self._received.append, _QUEUE)
        self._stamp, self._sent = 10**18, 0
        self._until(lambda: all(out.get_subscription_count() for out in self._outs.values()), 60.0)
        self._until(lambda: not self._answer or self._client.count_publishers(f'/fuzzed/{self._answer}'), 60.0)
        time.sleep(0.5)  # until the node has discovered the sender
        self._check_answer()

    def valid(self, rng: Random) -> Input:
        """Return a message of a device."""
        topic = rng.choice(list(self._inputs))
        return Input({topic: bytes(serialize_message(self._valid_message(topic, rng)))})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a message with changed bytes."""
        ((topic, content),) = parent.files.items()
        changed = mutated(content, rng, BINARY)
        return parent.changed(topic, changed[: len(content)] if self._inputs[topic] is Float64 else changed)

    def give(self, case: Input) -> str:
        """Send the input, and then a valid message."""
        ((topic, content),) = case.files.items()
        before = self._counts()
        self._publish(topic, content)
        self._check_answer()
        if self._answer and not self.parses(case):  # a recorder records any message
            raise InputError(f"{topic}: the message is not of the topic's type")
        ignored = [name for name, count in self._counts().items() if count != before.get(name, 0)]
        if any(name.startswith('ignored') for name in ignored):
            raise InputError(f'{topic} {", ".join(ignored)}')
        return f'{topic} {", ".join(ignored)}'

    def parses(self, case: Input) -> bool:
        """Return whether the input is a message of the topic's type."""
        ((topic, content),) = case.files.items()
        kind = self._inputs[topic]
        try:
            Layout(content, standard_types(), f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}', Serialization.CDR)
        except LayoutError:
            return False
        return True

    def stop(self) -> None:
        """End the node; the bag of a recorder must have all sent messages."""
        super().stop()
        if not self._answer:
            with Reader(self._bag) as reader:
                if reader.message_count != self._sent:
                    raise Fault(f'the bag has {reader.message_count} of {self._sent} messages')

    def _counts(self) -> dict[str, int]:
        return dict(self._node._health.counts) if hasattr(self._node, '_health') else {}

    def _publish(self, topic: str, message: Any) -> None:
        self._outs[topic].publish(message)
        self._sent += 1

    def _valid_message(self, topic: str, rng: Random | None = None) -> Any:
        """Return a valid message, random if a generator is given."""
        message = self._inputs[topic]()
        number = rng.random() if rng else 0.5
        if isinstance(message, Float64):
            message.data = _VALID_VALUES.get(topic, 3e4) * (1.0 + 0.1 * number)
            return message
        message.header.stamp = stamp_message(self._stamp)
        if isinstance(message, JointState):
            message.name = ['elbow', 'piston'][rng.randrange(2) if rng else 1 :]
            message.position = [1e-3 * number] * len(message.name)
        elif isinstance(message, FluidPressure):
            message.fluid_pressure = AMBIENT_PRESSURE + 5e4 + 100.0 * number
        return message

    def _check_answer(self) -> None:
        """Send valid messages, wait for the answer, and check that the answer is finite."""
        self._stamp += _MILLISECOND
        received = len(self._received)
        topics = [topic for topic, kind in self._inputs.items() if kind is not Float64] or [PISTON_COMMAND]
        for topic in topics:
            self._publish(topic, self._valid_message(topic))
        if not self._answer:
            self._until(lambda: self._node._written == self._sent)  # type: ignore[attr-defined]
            return
        if PISTON_STATE in topics:
            self._until(lambda: self._received and nanoseconds(self._received[-1].header.stamp) == self._stamp)
        else:
            self._until(lambda: len(self._received) > received)
        if not all(math.isfinite(answer.fluid_pressure) for answer in self._received):
            raise Fault('the answer to a valid message is not finite')
        self._received.clear()


class Parameters(_WithNode):
    """Requests to a node's parameter services: each must be answered, and non-finite numbers refused."""

    def __init__(self, make: Callable[..., Node], parameters: Mapping[str, Any] | None = None) -> None:
        super().__init__(make, parameters)
        self.name = f'parameters of {_module(make)}'

    def _connect(self) -> None:
        self._service = self._client.create_client(SetParameters, f'{self._node.get_name()}/set_parameters')
        self._read_clients = {
            kind: self._client.create_client(kind, f'{self._node.get_name()}/{name}')
            for kind, name in _SERVICES.items()
        }
        for client in (self._service, *self._read_clients.values()):
            self._until(client.service_is_ready, 60.0)
        time.sleep(0.5)  # until the node has discovered the sender
        self._initial = {name: parameter.get_parameter_value() for name, parameter in self._node._parameters.items()}
        self._names = sorted(self._initial)
        self._writable = [name for name in self._names if not self._node.describe_parameter(name).read_only]

    def valid(self, rng: Random) -> Input:
        """Return a request that sets initial values."""
        names = rng.sample(self._writable, min(rng.choice((1, 1, 2, 4)), len(self._writable)))  # without repetition
        return _request_of(Parameter(name=name, value=self._initial[name]) for name in names)

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a request with a changed value or name."""
        request = deserialize_message(parent.files['request'], SetParameters.Request)
        request.parameters = request.parameters or [Parameter()]
        parameter = rng.choice(request.parameters)
        if rng.random() < 0.1:
            parameter.name = rng.choice((rng.choice(self._names), *map(_text, TEXTS)))
        elif rng.random() < 0.8:
            _vary(parameter.value, rng)
        else:
            parameter.value = ParameterValue(type=rng.choice((*range(11), 255)))
            _vary(parameter.value, rng)
        return Input(_request_of(request.parameters).files, whole=False)

    def give(self, case: Input) -> str:
        """Send the request and check the answer."""
        request = deserialize_message(case.files['request'], SetParameters.Request)
        future = self._service.call_async(request)
        self._until(future.done)
        names = [parameter.name for parameter in request.parameters]
        for kind, client in self._read_clients.items():  # any answer is right
            self._until(client.call_async(kind.Request(**{_FIELDS[kind]: names * 2})).done)
        results = future.result().results
        if len(results) != len(request.parameters):
            raise Fault(f'{len(results)} answers to {len(request.parameters)} parameters')
        for parameter, result in zip(request.parameters, results):
            is_set = result.successful and 0 < parameter.value.type < 10
            value = parameter_value_to_python(parameter.value) if is_set else None
            numbers = value if isinstance(value, list) else [value]
            if any(isinstance(number, float) and not math.isfinite(number) for number in numbers):
                raise Fault(f'{parameter.name} is set to numbers that are not finite: {numbers[:4]}')
        if not all(map(self._node.has_parameter, self._names)):
            raise Fault('a parameter does not exist any more')
        reasons = ' '.join(result.reason for result in results if not result.successful)
        if reasons:
            raise InputError(reasons)
        return ''

    def parses(self, case: Input) -> bool:
        """Return whether all names are parameters of the node, with values of their types."""
        request = deserialize_message(case.files['request'], SetParameters.Request)
        return all(
            parameter.name in self._initial and parameter.value.type == self._initial[parameter.name].type
            for parameter in request.parameters
        )


def _request_of(parameters: Any) -> Input:
    return Input({'request': bytes(serialize_message(SetParameters.Request(parameters=list(parameters))))})


def _vary(value: ParameterValue, rng: Random) -> None:
    """Change a value without its type."""
    number = rng.choice(DOUBLES) if rng.random() < 0.5 else value.double_value * rng.choice((-1.0, 0.5, 2.0, 1e6))
    value.bool_value = rng.random() < 0.5
    value.double_value = number
    value.integer_value = rng.choice((0, 1, -1, 2**63 - 1, -(2**63)))
    value.string_value = _text(rng.choice(TEXTS))
    numbers = list(value.double_array_value) or [1.0]
    numbers[rng.randrange(len(numbers))] = number
    value.double_array_value = numbers * rng.choice((1, 1, 1, 2, 100)) if rng.random() < 0.9 else []
    value.string_array_value = [_text(rng.choice(TEXTS)) for _ in range(rng.choice((0, 1, 3)))]


def _text(content: bytes) -> str:
    return content.decode(errors='replace')


def _module(make: Callable[..., Node]) -> str:
    return make.__module__.rpartition('.')[2]


def kinds() -> list[Kind]:
    """Return all kinds of inputs of nodes."""
    recorded = {'topics': [f'/fuzzed/{PISTON_STATE}', f'/fuzzed/{MEASURED_FORCE}']}
    learning = {'learning': 2.0, 'block': 0.02}
    piston = {PISTON_STATE: JointState, **_SETPOINTS}
    measured = {**piston, **_PRESSURES, MEASURED_FORCE: WrenchStamped}
    answer = pressure_topic(CYLINDERS[0])
    return [
        Messages(SimNode, {**piston, FORCE_SETPOINT: Float64}, answer),
        Messages(MonitorNode, measured, PREDICTED + answer, learning),
        Messages(RigNode, {PISTON_COMMAND: Float64, **_SETPOINTS}, answer, {'sample_rate': 2000.0}),
        Messages(RecorderNode, {PISTON_STATE: JointState, MEASURED_FORCE: WrenchStamped}, parameters=recorded),
        *map(Parameters, (SimNode, MonitorNode, IdentifierNode)),
        Parameters(RigNode, {'sample_rate': 10.0}),
        Parameters(RecorderNode, recorded),
    ]
