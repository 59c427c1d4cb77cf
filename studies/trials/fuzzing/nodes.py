# SPDX-License-Identifier: Apache-2.0
"""
What strangers may send to nodes: serialised messages on their topics, and requests to their parameter services.

A node runs in this process, as its program makes it, with the executor that its program uses; what is sent goes
through DDS. Whatever comes out of the executor would have ended the program.
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
    stamp_message,
    warn_of_undeclared,
)
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import BINARY, DOUBLES, TEXTS, mutated

try:
    from rclpy.experimental import EventsExecutor as Executor
except ImportError:  # before Jazzy
    from rclpy.executors import SingleThreadedExecutor as Executor

_ANSWER = 5.0  # how long a node may take over what is sane [s]
_QUEUE = QoSProfile(depth=1000)
_MILLISECOND = 1_000_000
_ASKED = {ListParameters: 'list_parameters', GetParameters: 'get_parameters', DescribeParameters: 'describe_parameters'}
_FIELDS = {ListParameters: 'prefixes', GetParameters: 'names', DescribeParameters: 'names'}
_SANE = {PISTON_COMMAND: 1e-3, FORCE_SETPOINT: 20.0}  # what is sent on topics, else a set-point
_SETPOINTS = {setpoint_topic(name): Float64 for name in CYLINDERS}
_PRESSURES = {pressure_topic(name): FluidPressure for name in CYLINDERS}


class _WithNode(Kind):
    """Something that is sent to a node."""

    def __init__(self, make: Callable[..., Node], parameters: Mapping[str, Any] | None = None) -> None:
        self._make, self._parameters = make, parameters or {}

    def start(self, folder: Path) -> None:
        """Start the node, and who sends."""
        self._context = Context()
        rclpy.init(context=self._context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        overrides = [NodeParameter(name, value=value) for name, value in self._parameters.items()]
        if self._make is RecorderNode:
            self._bag = folder / 'bag'
            overrides.append(NodeParameter('output', value=str(self._bag)))
        set_logger_level('fuzzed', LoggingSeverity.FATAL)
        self._node = self._make(namespace='/fuzzed', context=self._context, parameter_overrides=overrides)
        warn_of_undeclared(self._node)
        self._client = Node('stranger', namespace='/fuzzed', context=self._context)
        self._executor = Executor(context=self._context)
        self._executor.add_node(self._node)
        self._executor.add_node(self._client)
        self._connect()

    @abstractmethod
    def _connect(self) -> None:
        """Open what is sent with, and wait until it arrives."""

    def stop(self) -> None:
        """End the node."""
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        self._client.destroy_node()
        rclpy.shutdown(context=self._context)

    def _until(self, condition: Callable[[], object], patience: float = _ANSWER) -> None:
        limit = time.monotonic() + patience
        while not condition():
            if time.monotonic() > limit:
                raise Fault('what is sane is not answered any more')
            self._executor.spin_once(timeout_sec=0.5)


class Messages(_WithNode):
    """
    Serialised messages, after each of which a sane one has to be answered with finite numbers.

    Parameters
    ----------
    make, parameters
        Makes the node, with some of its parameters.
    inputs
        Topics, and their types.
    answer
        Topic of the answers; none where it is asked how much was written.

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
        self._heard: list[FluidPressure] = []
        if self._answer:
            self._client.create_subscription(FluidPressure, self._answer, self._heard.append, _QUEUE)
        self._stamp, self._sent = 10**18, 0
        self._until(lambda: all(out.get_subscription_count() for out in self._outs.values()), 60.0)
        self._until(lambda: not self._answer or self._client.count_publishers(f'/fuzzed/{self._answer}'), 60.0)
        time.sleep(0.5)  # until the other side has met us, too
        self._ask()

    def valid(self, rng: Random) -> Input:
        """Return a message as devices send it."""
        topic = rng.choice(list(self._inputs))
        return Input({topic: bytes(serialize_message(self._sane(topic, rng)))})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a message with other bytes."""
        ((topic, content),) = parent.files.items()
        changed = mutated(content, rng, BINARY)
        return parent.changed(topic, changed[: len(content)] if self._inputs[topic] is Float64 else changed)

    def give(self, one: Input) -> str:
        """Send it, and something sane after it."""
        ((topic, content),) = one.files.items()
        before = self._counts()
        self._publish(topic, content)
        self._ask()
        if self._answer and not self.parses(one):  # a recorder takes it anyway
            raise InputError(f'{topic} is none of its type')
        ignored = [name for name, count in self._counts().items() if count != before.get(name, 0)]
        if any(name.startswith('ignored') for name in ignored):
            raise InputError(f'{topic} {", ".join(ignored)}')
        return f'{topic} {", ".join(ignored)}'

    def parses(self, one: Input) -> bool:
        """Return whether it is a message of its type."""
        ((topic, content),) = one.files.items()
        kind = self._inputs[topic]
        try:
            Layout(content, standard_types(), f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}', Serialization.CDR)
        except LayoutError:
            return False
        return True

    def stop(self) -> None:
        """End the node; what a recorder has heard has to be in its bag."""
        super().stop()
        if not self._answer:
            with Reader(self._bag) as reader:
                if reader.message_count != self._sent:
                    raise Fault(f'{reader.message_count} messages are in the bag, of {self._sent}')

    def _counts(self) -> dict[str, int]:
        return dict(self._node._health.counts) if hasattr(self._node, '_health') else {}

    def _publish(self, topic: str, message: Any) -> None:
        self._outs[topic].publish(message)
        self._sent += 1

    def _sane(self, topic: str, rng: Random | None = None) -> Any:
        """Return a message that is as it should be, one of several such for a generator."""
        message = self._inputs[topic]()
        number = rng.random() if rng else 0.5
        if isinstance(message, Float64):
            message.data = _SANE.get(topic, 3e4) * (1.0 + 0.1 * number)
            return message
        message.header.stamp = stamp_message(self._stamp)
        if isinstance(message, JointState):
            message.name = ['elbow', 'piston'][rng.randrange(2) if rng else 1 :]
            message.position = [1e-3 * number] * len(message.name)
        elif isinstance(message, FluidPressure):
            message.fluid_pressure = AMBIENT_PRESSURE + 5e4 + 100.0 * number
        return message

    def _ask(self) -> None:
        """Send what is sane, and wait for a sane answer."""
        self._stamp += _MILLISECOND
        heard = len(self._heard)
        asked = [topic for topic, kind in self._inputs.items() if kind is not Float64] or [PISTON_COMMAND]
        for topic in asked:
            self._publish(topic, self._sane(topic))
        if not self._answer:
            self._until(lambda: self._node._written == self._sent)  # type: ignore[attr-defined]
            return
        if PISTON_STATE in asked:
            self._until(lambda: self._heard and nanoseconds(self._heard[-1].header.stamp) == self._stamp)
        else:
            self._until(lambda: len(self._heard) > heard)
        if not all(math.isfinite(answer.fluid_pressure) for answer in self._heard):
            raise Fault('what is sane is answered with no number')
        self._heard.clear()


class Parameters(_WithNode):
    """Requests to a node's services for parameters: each is to be answered, and no number taken that is none."""

    def __init__(self, make: Callable[..., Node], parameters: Mapping[str, Any] | None = None) -> None:
        super().__init__(make, parameters)
        self.name = f'parameters of {_module(make)}'

    def _connect(self) -> None:
        self._service = self._client.create_client(SetParameters, f'{self._node.get_name()}/set_parameters')
        self._asked = {
            kind: self._client.create_client(kind, f'{self._node.get_name()}/{name}') for kind, name in _ASKED.items()
        }
        for client in (self._service, *self._asked.values()):
            self._until(client.service_is_ready, 60.0)
        time.sleep(0.5)  # until the other side has met us, too
        self._own = {name: one.get_parameter_value() for name, one in self._node._parameters.items()}
        self._names = sorted(self._own)
        self._free = [name for name in self._names if not self._node.describe_parameter(name).read_only]

    def valid(self, rng: Random) -> Input:
        """Return a request for values that the node began with."""
        names = rng.sample(self._free, min(rng.choice((1, 1, 2, 4)), len(self._free)))  # each once
        return _requested(Parameter(name=name, value=self._own[name]) for name in names)

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a request with another value, or another name."""
        request = deserialize_message(parent.files['request'], SetParameters.Request)
        request.parameters = request.parameters or [Parameter()]
        one = rng.choice(request.parameters)
        if rng.random() < 0.1:
            one.name = rng.choice((rng.choice(self._names), *map(_text, TEXTS)))
        elif rng.random() < 0.8:
            _vary(one.value, rng)
        else:
            one.value = ParameterValue(type=rng.choice((*range(11), 255)))
            _vary(one.value, rng)
        return Input(_requested(request.parameters).files, whole=False)

    def give(self, one: Input) -> str:
        """Send it, and look at the answer."""
        request = deserialize_message(one.files['request'], SetParameters.Request)
        future = self._service.call_async(request)
        self._until(future.done)
        names = [parameter.name for parameter in request.parameters]
        for kind, client in self._asked.items():  # an answer of any kind will do
            self._until(client.call_async(kind.Request(**{_FIELDS[kind]: names * 2})).done)
        results = future.result().results
        if len(results) != len(request.parameters):
            raise Fault(f'{len(results)} answers to {len(request.parameters)} parameters')
        for parameter, result in zip(request.parameters, results):
            taken = result.successful and 0 < parameter.value.type < 10
            value = parameter_value_to_python(parameter.value) if taken else None
            numbers = value if isinstance(value, list) else [value]
            if any(isinstance(number, float) and not math.isfinite(number) for number in numbers):
                raise Fault(f'{parameter.name} is taken: {numbers[:4]}')
        if not all(map(self._node.has_parameter, self._names)):
            raise Fault('a parameter is gone')
        reasons = ' '.join(result.reason for result in results if not result.successful)
        if reasons:
            raise InputError(reasons)
        return ''

    def parses(self, one: Input) -> bool:
        """Return whether all are parameters of the node, and of their types."""
        request = deserialize_message(one.files['request'], SetParameters.Request)
        return all(
            parameter.name in self._own and parameter.value.type == self._own[parameter.name].type
            for parameter in request.parameters
        )


def _requested(parameters: Any) -> Input:
    return Input({'request': bytes(serialize_message(SetParameters.Request(parameters=list(parameters))))})


def _vary(value: ParameterValue, rng: Random) -> None:
    """Change a value, but not its type."""
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
    """Return all kinds of what nodes are sent."""
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
