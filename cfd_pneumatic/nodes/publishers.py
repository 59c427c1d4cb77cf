# SPDX-License-Identifier: Apache-2.0
"""Who publishes what a node hears, as far as discovery tells: too many, unheard, or on another topic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from cfd_pneumatic.convention import JOINT_STATE
from cfd_pneumatic.errors import printable

_MOST_SHOWN = 5  # names in a message
_LONGEST_SHOWN = 100  # characters of each


def several_publishers(node: Node, topic: str) -> Iterator[str]:
    """Yield in words that more than one node publishes a topic that has one sender by its meaning."""
    senders = _senders(node, topic)
    if len(senders) > 1:
        yield f'{len(senders)} publish {topic}, {_listed(name for name, _ in senders)}: leave one'


def unheard_publishers(node: Node, topic: str) -> Iterator[str]:
    """Yield in words that somebody publishes a topic best effort that is heard reliably only."""
    unheard = [name for name, is_reliable in _senders(node, topic) if not is_reliable]
    if unheard:
        yield f'{topic} of {_listed(unheard)} is best effort, and so not heard: publish it reliably'


def other_topics(node: Node, topic: str) -> str | None:
    """Return in words which other topics carry joints; None if there are none."""
    own = node.resolve_topic_name(topic)
    try:
        found = [name for name, types in node.get_topic_names_and_types() if JOINT_STATE in types and name != own]
    except UnicodeDecodeError:  # of a stranger's names
        return None
    return f'joints are published on {_listed(sorted(found))}: remap it, {topic}:=TOPIC' if found else None


def publishers_of(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return who publishes a topic; nobody if one of them has a name that is no text, for then rclpy tells of none."""
    try:
        return list(node.get_publishers_info_by_topic(node.resolve_topic_name(topic)))
    except UnicodeDecodeError:
        return []


def _senders(node: Node, topic: str) -> list[tuple[str, bool]]:
    """Return the names of those who publish a topic, and whether each does so reliably."""
    return sorted(
        (
            f'{one.node_namespace.rstrip("/")}/{one.node_name}',
            one.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT,
        )
        for one in publishers_of(node, topic)
    )


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    shown = ', '.join(printable(name)[:_LONGEST_SHOWN] for name in names[:_MOST_SHOWN])
    return shown if len(names) <= _MOST_SHOWN else f'{shown} and {len(names) - _MOST_SHOWN} more'
