# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself: warnings that don't flood the log, and messages for `/diagnostics`."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

_THROTTLE = 5.0  # a warning that keeps coming is repeated this often [s]
_KINDS = 20  # so many kinds in that time; a stranger may send another name in each message

_NUMBER = re.compile(r'\d[\d.]*(e[+-]?\d+)?|\b(nan|inf)\b')

LOST = 'lost messages'
MISMATCHED = 'QoS mismatches'
REPEATED = 'repeated stamps'
WITHOUT_JOINT = 'messages without the joint'
LARGE = 'queues shortened for large messages'

_TROUBLES = (
    'resets', 'ignored samples', 'ignored stamps', 'ignored set-points', 'ignored measurements', LOST, MISMATCHED, LARGE
)  # fmt: skip
"""What makes `/diagnostics` warn where it has happened since the last report."""


def diagnostics(
    node: Node, part: str, level: bytes, message: str, values: Mapping[str, str], hardware_id: str = ''
) -> DiagnosticArray:
    """Return a message for `/diagnostics` on a part of a node, perhaps with the serial number of the device."""
    name = node.get_fully_qualified_name()
    status = DiagnosticStatus(name=f'{name}: {part}', hardware_id=hardware_id or name, level=level, message=message)
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = node.get_clock().now().to_msg()
    return array


def joined(*parts: str | None) -> str:
    """Return what there is of a message's parts."""
    return '; '.join(part for part in parts if part)


class Warnings:
    """The warnings of a node; those that differ in their numbers alone are of one kind, repeated now and then."""

    def __init__(self, node: Node) -> None:
        """Warn in the log of a node."""
        self._node = node
        self._last: dict[str, float] = {}

    def warn(self, message: str) -> None:
        """Warn, unless there was a warning of this kind a moment ago."""
        now, kind = time.monotonic(), _NUMBER.sub('#', message)
        self._last = {told: at for told, at in self._last.items() if now - at < _THROTTLE}
        if kind not in self._last and len(self._last) < _KINDS:
            self._last[kind] = now
            self._node.get_logger().warning(message)


class InputHealth(Warnings):
    """
    Whether an input comes, and is of use; by steady time, which a stopped `/clock` does not stop.

    Attributes
    ----------
    fault
        What is wrong with the input that came last, or None.
    meanwhile
        What came that is no input of ours since the last one that was, or None.
    counts
        How often what has happened.

    """

    def __init__(self, node: Node, topic: str) -> None:
        """Watch over the input on a topic."""
        super().__init__(node)
        self._topic = topic
        self._last_good = time.monotonic()
        self.fault: str | None = f'no {topic} yet'
        self.meanwhile: str | None = None
        self.counts: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._standing: set[str] = set()

    @property
    def silence(self) -> float:
        """Time since the last good input [s]."""
        return time.monotonic() - self._last_good

    def good(self) -> None:
        """Note an input that can be used."""
        self._last_good = time.monotonic()
        self.fault = self.meanwhile = None

    def bad(self, fault: str) -> None:
        """Note an input that cannot."""
        self.fault = fault
        self.warn(f'ignored: {fault}')

    def standing(self, words: Sequence[str]) -> None:
        """Note what lasts; log what has not lasted since the last time."""
        kinds = {_NUMBER.sub('#', text): text for text in words}
        for kind in kinds.keys() - self._standing:
            self.warn(kinds[kind])
        self._standing = set(kinds)

    def grown(self, count: str) -> int:
        """Return by how much a count has grown since the last call of `troubles`."""
        return self.counts[count] - self._reported[count]

    def troubles(self) -> str | None:
        """Return in words what has gone wrong since this was asked last, though the last input was good; or None."""
        grown = {trouble: self.grown(trouble) for trouble in _TROUBLES}
        self._reported = self.counts.copy()
        words = [f'{count} {trouble}' for trouble, count in grown.items() if count]
        return f'since the last report: {", ".join(words)}' if words else None

    def verdict(self, timeout: float, standing: Sequence[str] = ()) -> tuple[bytes, str]:
        """
        Return level and message for `/diagnostics`.

        Silence beyond a `timeout` [s] is an error; what is `standing`, and not as it should be, is a warning.
        """
        troubles = self.troubles()
        if self.silence > timeout:
            why = self.fault or f'{self._topic} has been silent for {self.silence:.1f} s'
            return DiagnosticStatus.ERROR, joined(why, self.meanwhile, *standing, troubles)
        if self.fault is not None or troubles is not None or standing:
            return DiagnosticStatus.WARN, joined(self.fault, *standing, troubles)
        return DiagnosticStatus.OK, f'following {self._topic}'
