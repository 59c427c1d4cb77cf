"""Opening topics whose QoS parameters can override: `qos_overrides./cfd/sim/piston_state.subscription.reliability`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from inspect import signature
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from cfd_pneumatic.errors import InputError

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # before Jazzy
    from rclpy.qos_event import SubscriptionEventCallbacks


def publish_on(node: Node, message_type: type, topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher; `qos` stays as it is, for rclpy writes the overrides into what it is given."""
    with _named(topic):
        return node.create_publisher(
            message_type, topic, copy(qos), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )


def listen_to(
    node: Node,
    message_type: type,
    topic: str,
    callback: Callable[[Any], None],
    qos: QoSProfile,
    raw: bool = False,
    on_lost: Callable[[int], None] | None = None,
    on_mismatch: Callable[[int, str], None] | None = None,
) -> Subscription:
    """
    Return a subscription, to serialised messages where `raw`; `qos` stays as it is.

    `on_lost` is told how many messages were lost since it was told last, `on_mismatch` how many publishers more offer
    less than is asked for, and the policy that differs.
    """
    events = SubscriptionEventCallbacks(
        incompatible_qos=on_mismatch
        and (lambda event: on_mismatch(event.total_count_change, qos_policy_name_from_kind(event.last_policy_kind))),
    )
    if on_lost is not None:
        callback = _Counting(callback, on_lost, lambda: node.count_publishers(subscription.topic_name))
    with _named(topic):
        subscription = node.create_subscription(
            message_type,
            topic,
            callback,
            copy(qos),
            raw=raw,
            event_callbacks=events,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
    return subscription


class _Counting:
    """
    A callback before which messages are counted that did not come: a queue that overflows raises no event.

    A publisher numbers its messages. A message does not say whose it is, so each is taken for the next of whoever's
    numbers it follows most closely.
    """

    def __init__(
        self, callback: Callable[[Any], None], on_lost: Callable[[int], None], publishers: Callable[[], int]
    ) -> None:
        self._callback, self._on_lost, self._publishers = callback, on_lost, publishers
        self._expected: list[int] = []
        self.__signature__ = signature(lambda message, info: None)  # by which rclpy sees that it wants both

    def __call__(self, *given: Any) -> None:
        message, info = given if len(given) == 2 else given[0]  # EventsExecutor gives the pair
        number = info.get('publication_sequence_number')
        if number is not None:  # else the middleware does not tell
            self._count(number)
        self._callback(message)

    def _count(self, number: int) -> None:
        expected = self._expected
        if number in expected:
            expected[expected.index(number)] += 1
            return
        before = max((one for one in expected if one < number), default=None)
        publishers = self._publishers()
        if before is None or len(expected) < publishers:  # one who has just come
            expected.append(number + 1)
            del expected[: -max(publishers, 1)]
        else:
            expected[expected.index(before)] = number + 1
            self._on_lost(number - before)


@contextmanager
def _named(topic: str) -> Iterator[None]:
    """Turn an override that rclpy cannot use into an error for the user, with the topic's name."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise InputError(f'{topic}: {error}; check its qos_overrides') from error
