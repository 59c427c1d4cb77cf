# SPDX-License-Identifier: Apache-2.0
"""`recorder_node`: topics to a bag, as `ros2 bag record` does, where no rosbag2 is installed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.health import Warnings
from cfd_pneumatic.nodes.parameters import switch, text, texts
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.samples import message_class
from cfd_pneumatic.nodes.topics import Counting
from cfd_pneumatic.recording import BagWriter
from cfd_pneumatic.recording.bags.blocks import MessageBlock
from cfd_pneumatic.recording.bags.storages import STORAGES

_LOOK_PERIOD = 0.1  # how often topics that were not there yet are looked for [s]
_DEPTH = 10_000  # messages of one topic that may wait while others are written, or the node waits for a core


class RecorderNode(Node):
    """
    Writes every message of the chosen topics to a bag until it is interrupted; the bag appears when it is complete.

    Parameters: `topics` (absolute or relative names, each recorded once it appears), `output` (folder of the bag),
    `storage` (mcap or sqlite3), `overwrite`.
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
        self._wanted = {self._full_name(topic) for topic in topics if topic}
        if not self._wanted:
            raise InputError("parameter 'topics' is empty: name the topics, -p topics:=[/cfd/device/piston_state]")
        self._written = self._lost = 0
        self._warnings = Warnings(self)
        self._failure: InputError | None = None
        self.create_timer(_LOOK_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._bag = BagWriter(output, storage=storage, overwrite=overwrite)

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare('topics', [''], texts('names of the topics to record', read_only=True))
        declare('output', '', text('folder of the bag to be written', read_only=True))
        declare('storage', 'mcap', text('storage of the bag', 'mcap or sqlite3', read_only=True))
        declare('overwrite', False, switch('replace a bag that is there', read_only=True))

    def _full_name(self, topic: str) -> str:
        try:
            return self.resolve_topic_name(topic)
        except RuntimeError as error:
            raise InputError(f"parameter 'topics': {topic!r}: {error}") from error

    def _look(self) -> None:
        """Subscribe to wanted topics that have a publisher by now."""
        for topic, types in self.get_topic_names_and_types():
            publishers = self.get_publishers_info_by_topic(topic) if topic in self._wanted else []
            if publishers:
                self._wanted.discard(topic)
                self._record(topic, types[0], [info.qos_profile for info in publishers])

    def _record(self, topic: str, type_name: str, offered: Sequence[QoSProfile]) -> None:
        try:
            message_type = message_class(type_name)
            self._bag.add_topic(topic, type_name)
        except (InputError, ImportError, AttributeError) as error:
            self.get_logger().error(f'{topic} is left out: {error}')
            return
        write = Counting(
            partial(self._write, topic), partial(self._on_lost, topic), partial(self.count_publishers, topic)
        )
        self.create_subscription(message_type, topic, write, _qos_for(offered), raw=True)
        self.get_logger().info(f'recording {topic}')

    def _write(self, topic: str, payload: Any) -> None:
        if self._failure is not None:
            return
        try:
            self._bag.write(topic, MessageBlock.of([self.get_clock().now().nanoseconds], [payload]))
            self._written += 1
        except InputError as error:
            self._failure = error
            self.context.try_shutdown()

    def _on_lost(self, topic: str, lost: int) -> None:
        self._lost += lost
        self._warnings.warn(f'messages on {topic} are lost: they come faster than they are written')

    def destroy_node(self) -> None:
        """Complete the bag; where the disk is full, leave what is written."""
        if self._wanted:
            self.get_logger().warning(f'never seen, so not in the bag: {", ".join(sorted(self._wanted))}')
        try:
            if self._failure is not None:
                raise self._failure
            self._bag.close()
        except InputError as error:
            self._bag.leave()
            raise InputError(f'{error}; what was recorded before is in {self._bag.path}') from error
        lost = f', {self._lost} were lost' if self._lost else ''
        self.get_logger().info(f'{self._written} messages in {self._bag.path}{lost}')
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
