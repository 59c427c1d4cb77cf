"""What a node says of itself: warnings that don't flood the log, and messages for `/diagnostics`."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

_THROTTLE = 5.0  # a warning that keeps coming is repeated this often [s]


def diagnostics(node: Node, part: str, level: bytes, message: str, values: Mapping[str, str]) -> DiagnosticArray:
    """Return a message for `/diagnostics` on one part of a node."""
    name = node.get_fully_qualified_name()
    status = DiagnosticStatus(name=f'{name}: {part}', hardware_id=name, level=level, message=message)
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = node.get_clock().now().to_msg()
    return array


class InputHealth:
    """
    Whether an input comes, and is of use; by steady time, which a stopped `/clock` does not stop.

    Attributes
    ----------
    fault
        What is wrong with the input that came last, or None.
    counts
        How often what has happened.

    """

    def __init__(self, node: Node, topic: str) -> None:
        """Watch over the input on a topic."""
        self._node = node
        self._topic = topic
        self._last = time.monotonic()
        self._warned: dict[str, float] = {}
        self.fault: str | None = f'no {topic} yet'
        self.counts: Counter[str] = Counter()

    @property
    def silence(self) -> float:
        """Time since the last good input [s]."""
        return time.monotonic() - self._last

    def good(self) -> None:
        """Note an input that can be used."""
        self._last = time.monotonic()
        self.fault = None

    def bad(self, fault: str) -> None:
        """Note an input that cannot."""
        self.fault = fault
        self.warn('fault', f'ignored: {fault}')

    def warn(self, kind: str, message: str) -> None:
        """Warn, unless there was a warning of this kind a moment ago."""
        now = time.monotonic()
        if now - self._warned.get(kind, -math.inf) >= _THROTTLE:
            self._warned[kind] = now
            self._node.get_logger().warning(message)

    def verdict(self, timeout: float) -> tuple[bytes, str]:
        """Return level and message for `/diagnostics`; silence beyond a `timeout` [s] is an error."""
        if self.silence > timeout:
            return DiagnosticStatus.ERROR, self.fault or f'{self._topic} has been silent for {self.silence:.1f} s'
        if self.fault is not None:
            return DiagnosticStatus.WARN, self.fault
        return DiagnosticStatus.OK, f'following {self._topic}'
