# SPDX-License-Identifier: Apache-2.0
"""`recorder_node`: topics to a bag, as `ros2 bag record` does, where no rosbag2 is installed."""

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
from cfd_pneumatic.nodes.topics import listen_to
from cfd_pneumatic.recording import STORAGES, BagWriter

_LOOK_PERIOD = 0.1  # how often topics that were not there yet are looked for [s]
_FOLLOW_PERIOD = 1.0  # how often the folder of the bag is looked for [s]
_DEPTH = 10_000  # messages of one topic that may wait while others are written, or the node waits for a core
_BUDGET = 16 * 2**20  # of the messages of a topic that wait [bytes]
_LEAST = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)  # every publisher offers as much
_MOST_SHOWN, _LONGEST_SHOWN = 5, 100  # types in a message, and characters of each


class RecorderNode(BoundedNode):
    """
    Writes every message of the chosen topics to a bag until it is interrupted; the bag appears when it is complete.

    Parameters: `topics` (absolute or relative names, each recorded once it appears, perhaps with the message type as
    NAME=TYPE), `output` (folder of the bag), `storage` (mcap or sqlite3), `overwrite`.

    A topic is recorded with one type: the given one, the convention's, or the only one that is offered.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Open the bag and wait for the topics."""
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
        self.create_timer(_LOOK_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._bag = BagWriter(output, storage=storage, overwrite=overwrite)
        self.create_timer(_FOLLOW_PERIOD, self._follow, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare(
            'topics',
            [''],
            texts('names of the topics to record, perhaps with the message type as NAME=TYPE', read_only=True),
        )
        declare('output', '', text('folder of the bag to be written', read_only=True))
        declare('storage', 'mcap', text('storage of the bag', 'mcap or sqlite3', read_only=True))
        declare('overwrite', False, switch('replace a bag that is there', read_only=True))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters as every node does, but keep the clock by which the bag's messages are stamped."""
        clock = self.get_parameter('use_sim_time').value
        if any(one.name == 'use_sim_time' and one.value != clock for one in parameter_list):
            return SetParametersResult(successful=False, reason='use_sim_time cannot change while a bag is recorded')
        return super().set_parameters_atomically(parameter_list)

    def _topic_and_type(self, text: str) -> tuple[str, str | None]:
        """Return a topic's full name, and the type that it is recorded with; None if any will do."""
        name, _, given = text.partition('=')
        try:
            topic = self.resolve_topic_name(name)
        except RuntimeError as error:
            raise InputError(f"parameter 'topics': {name!r}: {error}") from error
        if given:
            message_class(given)
        return topic, given or expected_type(topic)

    def _look(self) -> None:
        """Subscribe to wanted topics that have a publisher by now."""
        for topic, expected in self._expected.items():
            try:
                self._look_for(topic, expected)
            except Exception as error:  # whatever discovery brings from strangers, the recording goes on
                self._warnings.warn(f'{topic}: cannot be recorded yet: {printable(str(error))[:_LONGEST_SHOWN]}')

    def _look_for(self, topic: str, expected: str | None) -> None:
        offered: dict[str, list[QoSProfile]] = {}
        try:
            for publisher in self.get_publishers_info_by_topic(topic):
                offered.setdefault(publisher.topic_type, []).append(publisher.qos_profile)
        except UnicodeDecodeError:  # of a stranger's names; what is offered besides stays unknown
            if expected is not None and self.count_publishers(topic):
                offered[expected] = [_LEAST]
            self._warnings.warn(f'{topic} has a publisher whose name is not a text: give the type to record')
        known = [name for name in offered if is_message_type(name)]
        wanted = self._recorded.get(topic) or expected or (known[0] if len(known) == 1 else None)
        others = sorted(offered.keys() - {wanted})
        if others:
            shown = ', '.join(printable(name)[:_LONGEST_SHOWN] for name in others[:_MOST_SHOWN])
            what = f'only {wanted} is recorded' if wanted else f'give the type to record, -p topics:=[{topic}=TYPE]'
            self._warnings.warn(f'{topic} is published as {shown}: {what}')
        if wanted in offered and topic not in self._recorded:
            self._record(topic, wanted, offered[wanted])

    def _record(self, topic: str, type_name: str, offered: Sequence[QoSProfile]) -> None:
        message_type = message_class(type_name)
        self._bag.add_topic(topic, type_name)
        self._recorded[topic] = type_name
        listen_to(
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

    def _follow(self) -> None:
        """Warn if somebody moves the folder of the bag; end if nothing that is written there can be kept."""
        try:
            if self._bag.relocate():
                self.get_logger().warning(
                    f'the folder of the bag was moved: the recording goes on, and the bag will be {self._bag.path}. '
                    'The node will end with exit code 2, since the bag is not where it was named.'
                )
        except InputError as error:
            self._fail(error)

    def _fail(self, error: InputError) -> None:
        self._failure = self._failure or error
        self.context.try_shutdown()

    def _on_lost(self, topic: str, lost: int) -> None:
        self._lost += lost
        self._warnings.warn(f'messages on {topic} are lost: they come faster than they are written')

    def destroy_node(self) -> None:
        """Complete the bag; where the disk is full, leave what is written."""
        unseen = sorted(self._expected.keys() - self._recorded.keys())
        if unseen:
            self.get_logger().warning(f'never seen, so not in the bag: {", ".join(unseen)}')
        try:
            if self._failure is not None:
                raise self._failure
            self._bag.close()
        except InputError as error:
            self._bag.keep_incomplete()
            raise InputError(f'{error}; what was recorded before is in {self._bag.path}') from error
        lost = f', {self._lost} were lost' if self._lost else ''
        self.get_logger().info(f'{self._written} messages in {self._bag.path}{lost}')
        self._bag.check_place()
        super().destroy_node()


def _qos_for(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the most that every publisher offers: nothing lost, and what was latched before we came."""
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
