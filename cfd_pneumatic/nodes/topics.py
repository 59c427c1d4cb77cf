# SPDX-License-Identifier: Apache-2.0
"""Opening topics whose QoS parameters can override: `qos_overrides./cfd/sim/piston_state.subscription.reliability`."""

from __future__ import annotations

import time
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

_WAIT = 200_000_000  # longer no sample should wait for its callback [ns]
_SHORT = 50_000_000  # until they wait no longer than this, once too many wait [ns]
_STANDING = 1_000_000_000  # for so long all may, as behind a process that stood still [ns]
_KEPT = 10  # of so many samples one is taken while they wait for longer


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
    queue: Queue | None = None,
) -> Subscription:
    """
    Return a subscription, to serialised messages where `raw`; `qos` stays as it is.

    `on_lost` is told how many messages were lost since it was told last, `on_mismatch` how many publishers more offer
    less than is asked for, and the policy that differs. Of what waits in a `queue` one of ten is taken while messages
    come faster than they are taken.
    """
    events = SubscriptionEventCallbacks(
        incompatible_qos=on_mismatch
        and (lambda event: on_mismatch(event.total_count_change, qos_policy_name_from_kind(event.last_policy_kind)))
    )
    if on_lost is not None:
        callback = Counting(callback, on_lost, lambda: node.count_publishers(subscription.topic_name), queue)
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


class Counting:
    """
    A callback before which messages are counted that did not come: a queue that overflows raises no event.

    A publisher numbers its messages. A message does not say whose it is, so each is taken for the next of whoever's
    numbers it follows most closely.

    Parameters
    ----------
    callback
        Takes messages.
    on_lost
        Is told how many were lost since it was told last.
    publishers
        Says how many there are.
    queue
        In which the messages wait, where one of ten will do while they come faster than they are taken.

    """

    def __init__(
        self,
        callback: Callable[[Any], None],
        on_lost: Callable[[int], None],
        publishers: Callable[[], int],
        queue: Queue | None = None,
    ) -> None:
        self._callback, self._on_lost, self._publishers = callback, on_lost, publishers
        self._expected: list[int] = []  # last the number of whoever was heard last
        self._queue = queue
        self.__signature__ = signature(lambda message, info: None)  # by which rclpy sees that it wants both

    def __call__(self, *given: Any) -> None:
        """Take a message, and what the middleware tells of it."""
        message, info = given if len(given) == 2 else given[0]  # EventsExecutor gives the pair
        number = info.get('publication_sequence_number')
        if number is not None:  # else the middleware does not tell
            self._count(number)
            if self._queue is not None and self._queue.stands(info['received_timestamp']) and number % _KEPT:
                self._on_lost(1)
                return
        self._callback(message)

    def _count(self, number: int) -> None:
        expected = self._expected
        if number in expected:
            expected.remove(number)
            expected.append(number + 1)
            return
        before = max((one for one in expected if one < number), default=None)
        publishers = self._publishers()
        if before is None or len(expected) < publishers:  # one who has just come
            expected.append(number + 1)
            del expected[: -max(publishers, 1)]
        else:
            expected.remove(before)
            expected.append(number + 1)
            self._on_lost(number - before)


class Queue:
    """
    The messages that wait for a node's callbacks.

    After a process stood still they are many, and soon none. Where they stay many they come faster than they are
    taken: then whatever is taken is old, and waiting longer helps nobody.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self._since: int | None = None
        self._stands = False

    def stands(self, received: int) -> bool:
        """Return whether messages have waited too long for too long, this one since it was received [ns]."""
        now = time.time_ns()
        enough = _SHORT if self._stands else _WAIT
        if now - received <= enough or not received:  # else the middleware does not tell
            self._since, self._stands = None, False
            return False
        if self._since is None:
            self._since = now
        self._stands = now - self._since > _STANDING
        return self._stands


@contextmanager
def _named(topic: str) -> Iterator[None]:
    """Turn an override that rclpy cannot use into an error for the user, with the topic's name."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise InputError(f'{topic}: {error}; check its qos_overrides') from error
