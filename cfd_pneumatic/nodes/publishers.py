# SPDX-License-Identifier: Apache-2.0
"""Publishers that discovery shows for a node's topics: too many, incompatible, or on another topic."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from cfd_pneumatic.convention import JOINT_STATE
from cfd_pneumatic.errors import printable

_MOST_SHOWN = 5  # names in a message
_LONGEST_SHOWN = 100  # characters of a name in a message


def type_name(message_type: type) -> str:
    """Return the name of a message class, as std_msgs/msg/Float64."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


def several_publishers(topic: str, senders: Collection[str]) -> Iterator[str]:
    """Yield a warning if a topic that must have one publisher has several."""
    if len(senders) > 1:
        yield f'{len(senders)} publish {topic}, {_list_names(senders)}: stop all but one'


def publisher_names(node: Node, topic: str, expected_type: str) -> list[str]:
    """Return the nodes that publish a topic with the expected type, once for each publisher."""
    return sorted(
        _node_name(publisher) for publisher in publishers_of(node, topic) if publisher.topic_type == expected_type
    )


def unheard_publishers(node: Node, topic: str, expected_type: str, qos: QoSProfile) -> Iterator[str]:
    """Yield warnings on publishers that a subscription with this type and QoS does not receive."""
    publishers = publishers_of(node, topic)
    is_reliable = qos.reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.SYSTEM_DEFAULT)
    unheard = sorted(
        _node_name(publisher)
        for publisher in publishers
        if is_reliable
        and publisher.topic_type == expected_type
        and publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    )
    if unheard:
        yield f'{topic} of {_list_names(unheard)} is best effort, and not received: publish it reliably'
    for wrong_type in sorted({publisher.topic_type for publisher in publishers} - {expected_type}):
        names = sorted(_node_name(publisher) for publisher in publishers if publisher.topic_type == wrong_type)
        shown_type = _list_names([wrong_type])
        yield f'{topic} of {_list_names(names)} is {shown_type}, and not received: publish {expected_type}'


def other_topics(node: Node, topic: str) -> str | None:
    """Return a text on other topics with joints, or None."""
    expected = node.resolve_topic_name(topic)
    try:
        topics = [
            name
            for name, types in node.get_topic_names_and_types()
            if JOINT_STATE in types and name != expected and node.count_publishers(name)
        ]
    except UnicodeDecodeError:  # a name that is no text
        return None
    return f'joints are published on {_list_names(sorted(topics))}: remap {topic}:=TOPIC' if topics else None


def publishers_of(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the publishers of a topic; empty if the name of a publisher is no text, which rclpy cannot handle."""
    try:
        return list(node.get_publishers_info_by_topic(node.resolve_topic_name(topic)))
    except UnicodeDecodeError:
        return []


def _node_name(publisher: TopicEndpointInfo) -> str:
    """Return the full name of a publisher's node."""
    return f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'


def _list_names(names: Iterable[str]) -> str:
    names = list(names)
    shown = ', '.join(printable(name)[:_LONGEST_SHOWN] for name in names[:_MOST_SHOWN])
    return shown if len(names) <= _MOST_SHOWN else f'{shown} and {len(names) - _MOST_SHOWN} more'
