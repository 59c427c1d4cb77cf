# SPDX-License-Identifier: Apache-2.0
"""Health of a node: warnings that do not flood the log, and messages for `/diagnostics`."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

_THROTTLE = 5.0  # a continuing warning is repeated after this time [s]
_MOST_KINDS = 20  # largest number of kinds in this time: each message may have a new name

_NUMBER = re.compile(r'\d[\d.]*(e[+-]?\d+)?|\b(nan|inf)\b')

LOST = 'lost messages'
MISMATCHED = 'QoS mismatches'
REPEATED = 'repeated stamps'
WITHOUT_JOINT = 'messages without the joint'
LARGE = 'queues shortened for large messages'

_TROUBLES = (
    'resets', 'ignored samples', 'ignored stamps', 'ignored set-points', 'ignored measurements', LOST, MISMATCHED, LARGE
)  # fmt: skip
"""Counts that make `/diagnostics` warn if they have grown since the last report."""


def diagnostics(
    node: Node, part: str, level: bytes, message: str, values: Mapping[str, str], hardware_id: str = ''
) -> DiagnosticArray:
    """Return a message for `/diagnostics` on a part of a node; `hardware_id` is the device's serial number."""
    name = node.get_fully_qualified_name()
    status = DiagnosticStatus(name=f'{name}: {part}', hardware_id=hardware_id or name, level=level, message=message)
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = node.get_clock().now().to_msg()
    return array


def join_texts(*parts: str | None) -> str:
    """Join the parts of a message that are not empty."""
    return '; '.join(part for part in parts if part)


class Warnings:
    """Throttled warnings of a node; warnings that differ in numbers only are of the same kind."""

    def __init__(self, node: Node) -> None:
        """Set the node that logs the warnings."""
        self._node = node
        self._last_warned: dict[str, float] = {}

    def warn(self, message: str) -> None:
        """Log a warning unless a warning of the same kind was logged recently."""
        now, kind = time.monotonic(), _NUMBER.sub('#', message)
        self._last_warned = {kind: last for kind, last in self._last_warned.items() if now - last < _THROTTLE}
        if kind not in self._last_warned and len(self._last_warned) < _MOST_KINDS:
            self._last_warned[kind] = now
            self._node.get_logger().warning(message)


class InputHealth(Warnings):
    """
    Whether an input arrives and is valid, by steady time: a stopped `/clock` does not matter.

    Attributes
    ----------
    fault
        Fault of the last input, or None.
    foreign_input
        Text on messages for other receivers since the last input, or None.
    counts
        Numbers of events by name.

    """

    def __init__(self, node: Node, topic: str) -> None:
        """Monitor the input on a topic."""
        super().__init__(node)
        self._topic = topic
        self._last_accepted = time.monotonic()
        self.fault: str | None = f'no {topic} yet'
        self.foreign_input: str | None = None
        self.counts: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._lasting: set[str] = set()

    @property
    def silence(self) -> float:
        """Time since the last valid input [s]."""
        return time.monotonic() - self._last_accepted

    def accept(self) -> None:
        """Note a valid input."""
        self._last_accepted = time.monotonic()
        self.fault = self.foreign_input = None

    def reject(self, fault: str) -> None:
        """Note the fault of an invalid input, and warn."""
        self.fault = fault
        self.warn(f'ignored: {fault}')

    def set_lasting_warnings(self, warnings: Sequence[str]) -> None:
        """Set the lasting warnings, and log the new warnings."""
        kinds = {_NUMBER.sub('#', text): text for text in warnings}
        for kind in kinds.keys() - self._lasting:
            self.warn(kinds[kind])
        self._lasting = set(kinds)

    def increase(self, count: str) -> int:
        """Return the growth of a count since the last call of `recent_troubles`."""
        return self.counts[count] - self._reported[count]

    def recent_troubles(self) -> str | None:
        """Describe events since the last call that are no fault of the last input; None without events."""
        grown = {trouble: self.increase(trouble) for trouble in _TROUBLES}
        self._reported = self.counts.copy()
        warnings = [f'{count} {trouble}' for trouble, count in grown.items() if count]
        return f'since the last report: {", ".join(warnings)}' if warnings else None

    def status(self, timeout: float, lasting: Sequence[str] = ()) -> tuple[bytes, str]:
        """
        Return level and message for `/diagnostics`.

        Silence beyond a `timeout` [s] is an error; a `lasting` warning is a warning.
        """
        troubles = self.recent_troubles()
        if self.silence > timeout:
            why = self.fault or f'{self._topic} has been silent for {self.silence:.1f} s'
            return DiagnosticStatus.ERROR, join_texts(why, self.foreign_input, *lasting, troubles)
        if self.fault is not None or troubles is not None or lasting:
            return DiagnosticStatus.WARN, join_texts(self.fault, *lasting, troubles)
        return DiagnosticStatus.OK, f'following {self._topic}'
