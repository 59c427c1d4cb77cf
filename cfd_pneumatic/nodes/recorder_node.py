# SPDX-License-Identifier: Apache-2.0
"""`recorder_node`: records topics to a bag, as `ros2 bag record` does, without rosbag2."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cfd_pneumatic.convention import expected_type
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.messages import MessageBlock
from cfd_pneumatic.nodes.bounded_node import BoundedNode
from cfd_pneumatic.nodes.health import Warnings
from cfd_pneumatic.nodes.parameters import switch, text, texts
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.samples import is_message_type, message_class
from cfd_pneumatic.nodes.topics import subscribe
from cfd_pneumatic.recording import STORAGES, BagWriter

_LOOK_PERIOD = 0.1  # period of the search for new topics [s]
_FOLDER_PERIOD = 1.0  # period of the checks of the bag's folder [s]
_DEPTH = 10_000  # messages of a topic that may wait while other topics are written
_BUDGET = 16 * 2**20  # largest size of the waiting messages of a topic [bytes]
_MINIMAL_QOS = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)  # compatible with every publisher
_MOST_SHOWN, _LONGEST_SHOWN = 5, 100  # types in a message, and characters of each


class RecorderNode(BoundedNode):
    """
    Records topics to a bag until an interrupt; the bag appears when it is complete.

    Parameters: `topics` (absolute or relative names, optionally with the message type as NAME=TYPE), `output` (folder
    of the bag), `storage` (mcap or sqlite3), `overwrite`. Each topic is recorded from its appearance on.

    A topic is recorded with a single type: the given type, the type of the convention, or the only offered type.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Open the bag and search for the topics."""
        super().__init__('recorder_node', **kwargs)
        self._declare_parameters()
        topics, output, storage, overwrite = (
            self.get_parameter(name).value for name in ('topics', 'output', 'storage', 'overwrite')
        )
        if not output:
            raise InputError("parameter 'output' is empty: give the folder of the bag, -p output:=my_bag")
        if storage not in STORAGES:
            raise InputError(f"parameter 'storage' is {storage!r}: choose {' or '.join(STORAGES)}")
        self._expected = dict(self._topic_and_type(topic) for topic in topics if topic)
        if not self._expected:
            raise InputError("parameter 'topics' is empty: name the topics, -p topics:=[/cfd/device/piston_state]")
        self._recorded: dict[str, str] = {}
        self._written = self._lost = 0
        self._warnings = Warnings(self)
        self._failure: InputError | None = None
        self.create_timer(_LOOK_PERIOD, self._find_topics, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._bag = BagWriter(output, storage=storage, overwrite=overwrite)
        self.create_timer(_FOLDER_PERIOD, self._check_folder, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare(
            'topics',
            [''],
            texts('names of the topics to record, optionally with the message type as NAME=TYPE', read_only=True),
        )
        declare('output', '', text('folder of the bag', read_only=True))
        declare('storage', 'mcap', text('storage of the bag', 'mcap or sqlite3', read_only=True))
        declare('overwrite', False, switch('replace an existing bag', read_only=True))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, but refuse a change of the clock that stamps the messages of the bag."""
        clock = self.get_parameter('use_sim_time').value
        if any(parameter.name == 'use_sim_time' and parameter.value != clock for parameter in parameter_list):
            return SetParametersResult(successful=False, reason='use_sim_time cannot change while a bag is recorded')
        return super().set_parameters_atomically(parameter_list)

    def _topic_and_type(self, text: str) -> tuple[str, str | None]:
        """Return a topic's full name, and the type to record; None for any type."""
        name, _, type_name = text.partition('=')
        try:
            topic = self.resolve_topic_name(name)
        except RuntimeError as error:
            raise InputError(f"parameter 'topics': {name!r}: {error}") from error
        if type_name:
            message_class(type_name)
        return topic, type_name or expected_type(topic)

    def _find_topics(self) -> None:
        """Subscribe to topics that have a publisher."""
        for topic, expected in self._expected.items():
            try:
                self._find_topic(topic, expected)
            except Exception as error:  # an error in discovery must not end the recording
                self._warnings.warn(f'{topic}: cannot be recorded yet: {printable(str(error))[:_LONGEST_SHOWN]}')

    def _find_topic(self, topic: str, expected: str | None) -> None:
        offered: dict[str, list[QoSProfile]] = {}
        try:
            for publisher in self.get_publishers_info_by_topic(topic):
                offered.setdefault(publisher.topic_type, []).append(publisher.qos_profile)
        except UnicodeDecodeError:  # a name that is no text hides the offered types
            if expected is not None and self.count_publishers(topic):
                offered[expected] = [_MINIMAL_QOS]
            self._warnings.warn(f'{topic} has a publisher with a name that is not a text: give the type to record')
        known_types = [name for name in offered if is_message_type(name)]
        wanted = self._recorded.get(topic) or expected or (known_types[0] if len(known_types) == 1 else None)
        unrecorded = sorted(offered.keys() - {wanted})
        if unrecorded:
            shown = ', '.join(printable(name)[:_LONGEST_SHOWN] for name in unrecorded[:_MOST_SHOWN])
            remedy = f'only {wanted} is recorded' if wanted else f'give the type to record, -p topics:=[{topic}=TYPE]'
            self._warnings.warn(f'{topic} is published as {shown}: {remedy}')
        if wanted in offered and topic not in self._recorded:
            self._record(topic, wanted, offered[wanted])

    def _record(self, topic: str, type_name: str, offered: Sequence[QoSProfile]) -> None:
        message_type = message_class(type_name)
        self._bag.add_topic(topic, type_name)
        self._recorded[topic] = type_name
        subscribe(
            self,
            message_type,
            topic,
            partial(self._write, topic),
            _qos_for(offered),
            raw=True,
            on_lost=partial(self._on_lost, topic),
            on_large=self._warnings.warn,
            budget=_BUDGET,
        )
        self.get_logger().info(f'recording {topic}')

    def _write(self, topic: str, payload: Any) -> None:
        if self._failure is not None:
            return
        try:
            self._bag.write(topic, MessageBlock.from_payloads([self.get_clock().now().nanoseconds], [payload]))
            self._written += 1
        except InputError as error:
            self._fail(error)

    def _check_folder(self) -> None:
        """Warn if the folder of the bag was moved; end if the bag can no longer be written."""
        try:
            if self._bag.relocate():
                self.get_logger().warning(
                    f'the folder of the bag was moved: the recording goes on, and the bag will be {self._bag.path}. '
                    'The node will end with exit code 2, because the bag is not at the given path.'
                )
        except InputError as error:
            self._fail(error)

    def _fail(self, error: InputError) -> None:
        self._failure = self._failure or error
        self.context.try_shutdown()

    def _on_lost(self, topic: str, lost: int) -> None:
        self._lost += lost
        self._warnings.warn(f'messages on {topic} are lost: they arrive faster than they are written')

    def destroy_node(self) -> None:
        """Complete the bag; keep the written part if the disk is full."""
        unseen = sorted(self._expected.keys() - self._recorded.keys())
        if unseen:
            self.get_logger().warning(f'never seen, so not in the bag: {", ".join(unseen)}')
        try:
            if self._failure is not None:
                raise self._failure
            self._bag.close()
        except InputError as error:
            self._bag.keep_incomplete()
            raise InputError(f'{error}; the messages before the error are in {self._bag.path}') from error
        lost = f', {self._lost} were lost' if self._lost else ''
        self.get_logger().info(f'{self._written} messages in {self._bag.path}{lost}')
        self._bag.check_place()
        super().destroy_node()


def _qos_for(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strictest QoS that every publisher offers: reliable, and with latched messages."""
    reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
    latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


main = partial(run, 'recorder_node', RecorderNode)

if __name__ == '__main__':
    sys.exit(main())
