"""Opening topics whose QoS parameters can override: `qos_overrides./cfd/sim/piston_state.subscription.reliability`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from cfd_pneumatic.errors import InputError


def publish_on(node: Node, message_type: type, topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher; `qos` stays as it is, for rclpy writes the overrides into what it is given."""
    with _named(topic):
        return node.create_publisher(
            message_type, topic, copy(qos), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )


def listen_to(
    node: Node, message_type: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile, raw: bool = False
) -> Subscription:
    """Return a subscription, to serialised messages where `raw`; `qos` stays as it is."""
    with _named(topic):
        return node.create_subscription(
            message_type,
            topic,
            callback,
            copy(qos),
            raw=raw,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )


@contextmanager
def _named(topic: str) -> Iterator[None]:
    """Turn an override that rclpy cannot use into an error for the user, with the topic's name."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise InputError(f'{topic}: {error}; check its qos_overrides') from error
