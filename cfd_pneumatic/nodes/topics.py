# SPDX-License-Identifier: Apache-2.0
"""Topics with QoS that parameters can override, as `qos_overrides./cfd/sim/piston_state.subscription.reliability`."""

from __future__ import annotations

import ctypes
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from functools import partial
from inspect import signature
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.messages import OUTPUT_QOS
from cfd_pneumatic.nodes.publishers import publishers_of

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # before Jazzy
    from rclpy.qos_event import SubscriptionEventCallbacks

_LONGEST_WAIT = 200_000_000  # longest wait of a sample for its callback [ns]
_SHORT_WAIT = 50_000_000  # wait below which a backlog is over [ns]
_STALE_AFTER = 1_000_000_000  # how long samples may wait too long, as after a pause of the process [ns]
_KEEP_EVERY = 10  # while a backlog is stale, only each tenth sample is taken

BUDGET = 8 * 2**20
"""Largest size of the waiting messages of a topic [bytes]: 5,000 samples of a robot with twenty joints fit."""

_OVERHEAD = 256  # size of a message's header in the middleware's queue [bytes]
_PAUSE = 0.01  # time until the executor has released a queue [s]
_REMEMBERED = 1_000  # recent messages among which duplicates are recognised
_LOOK_PERIOD = 0.1  # period of the search for latched publishers [s]
_LATCHED_DEPTH = 10  # latched publishers of a topic
_CALM_TIME = 30.0  # time after the last large message until the queue has its full depth again [s]


def create_publisher(node: Node, message_type: type, topic: str) -> Publisher:
    """Return a publisher with a copy of `OUTPUT_QOS`, because rclpy writes the overrides into the profile."""
    with _naming(topic):
        return node.create_publisher(
            message_type, topic, copy(OUTPUT_QOS), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )


def subscribe(
    node: Node,
    message_type: type,
    topic: str,
    callback: Callable[[Any], None],
    qos: QoSProfile,
    raw: bool = False,
    on_lost: Callable[[int], None] | None = None,
    on_mismatch: Callable[[int, str], None] | None = None,
    on_large: Callable[[str], None] | None = None,
    backlog: Backlog | None = None,
    budget: int = BUDGET,
    accept: Callable[[Mapping[str, Any]], bool] = lambda _: True,
) -> QoSProfile:
    """
    Call a function for each message on a topic, serialised if `raw`; return the QoS that applies.

    Parameters
    ----------
    node, message_type, topic, callback, qos
        As in `Node.create_subscription`; parameters of the node may override a copy of `qos`.
    raw
        Whether the function takes serialised messages. Otherwise invalid messages are counted as lost.
    on_lost
        Called with the number of messages lost since the last call.
    on_mismatch
        Called with the number of new publishers that offer less than `qos`, and the differing policy.
    on_large
        Called with a text when large messages reduce the depth of the queue.
    backlog
        If given, only each tenth message is taken while messages arrive faster than they are taken.
    budget
        Largest size of the waiting messages [bytes].
    accept
        Returns whether a message is taken, from the middleware's information.

    Raises
    ------
    InputError
        If the overrides in the node's parameters cannot be used.

    """
    events = SubscriptionEventCallbacks(
        incompatible_qos=on_mismatch
        and (lambda event: on_mismatch(event.total_count_change, qos_policy_name_from_kind(event.last_policy_kind)))
    )
    lost = on_lost or (lambda _: None)
    take = callback if raw else _deserialising(message_type, callback, lost)
    counter = LossCounter(take, lost, lambda: node.count_publishers(node.resolve_topic_name(topic)), backlog, accept)
    subscription = _BoundedSubscription(
        node, message_type, topic, counter, qos, events, on_large or (lambda _: None), budget
    )
    return subscription.qos


def subscribe_latched(
    node: Node, message_type: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile, **options: Any
) -> QoSProfile:
    """
    Call a function for each message on a topic, including latched messages; return the QoS that applies.

    A transient local publisher keeps its last message for later subscribers. A transient local subscription does not
    receive volatile publishers. So a second subscription is created when a transient local publisher appears. A message
    that both subscriptions receive counts once.

    Parameters
    ----------
    node, message_type, topic, callback, qos, options
        As in `subscribe`.

    """
    seen: deque[tuple[int, int | None]] = deque(maxlen=_REMEMBERED)

    def is_new(info: Mapping[str, Any]) -> bool:
        key = info['source_timestamp'], info.get('publication_sequence_number')
        if key in seen:
            return False
        seen.append(key)
        return True

    acting_qos = subscribe(node, message_type, topic, callback, qos, accept=is_new, **options)
    take = _deserialising(message_type, callback, options.get('on_lost') or (lambda _: None))

    def listen_if_latched() -> None:
        durabilities = {publisher.qos_profile.durability for publisher in publishers_of(node, topic)}
        if DurabilityPolicy.TRANSIENT_LOCAL not in durabilities:
            return
        node.destroy_timer(timer)
        node.create_subscription(
            message_type,
            topic,
            _InfoCallback(lambda message, info: is_new(info) and take(message)),
            QoSProfile(depth=_LATCHED_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            raw=True,
            # The default callbacks would warn of volatile publishers.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    timer = node.create_timer(_LOOK_PERIOD, listen_if_latched, clock=Clock(clock_type=ClockType.STEADY_TIME))
    return acting_qos


def _deserialising(
    message_type: type, callback: Callable[[Any], None], on_lost: Callable[[int], None]
) -> Callable[[bytes], None]:
    """Return a function that deserialises a message and calls `callback`."""

    def take(message: bytes) -> None:
        try:
            deserialised = deserialize_message(message, message_type)
        except Exception:  # the middleware raises any exception for bytes that it cannot parse
            on_lost(1)
            return
        callback(deserialised)

    return take


class _InfoCallback:
    """A callback with a message and the middleware's information on the message."""

    def __init__(self, take: Callable[[bytes, Mapping[str, Any]], object]) -> None:
        self._take = take
        self.__signature__ = signature(lambda message, info: None)  # rclpy inspects the signature

    def __call__(self, *given: Any) -> None:
        message, info = given if len(given) == 2 else given[0]  # EventsExecutor passes a pair
        self._take(message, info)


class _BoundedSubscription:
    """
    A subscription whose queue is bounded in bytes.

    The middleware bounds a queue in messages only, and keeps the memory of the largest messages. So a topic with large
    waiting messages is opened anew with less depth, and later with the full depth again. Messages that arrive in
    between are lost, and counted.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        counter: LossCounter,
        qos: QoSProfile,
        events: SubscriptionEventCallbacks,
        on_large: Callable[[str], None],
        budget: int,
    ) -> None:
        self._node, self._topic, self._counter = node, topic, counter
        self._on_large, self._budget = on_large, budget
        self._create = partial(
            node.create_subscription, message_type, topic, _InfoCallback(self._take), raw=True, event_callbacks=events
        )
        with _naming(topic):
            overriding = QoSOverridingOptions.with_default_policies()
            self._subscription = self._create(qos_profile=copy(qos), qos_overriding_options=overriding)
        self.qos = self._subscription.qos_profile
        self._full = self.qos.depth
        self._large_until = 0.0

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        self._fit_depth(len(message) + _OVERHEAD, info['received_timestamp'])
        self._counter(message, info)

    def _fit_depth(self, size: int, received: int) -> None:
        """Reduce the depth for messages of a size [bytes] if the node falls behind; restore the depth later."""
        fitting = max(1, min(self._full, self._budget // size))
        if fitting < self._full:
            self._large_until = time.monotonic() + _CALM_TIME
        if fitting < self.qos.depth and time.time_ns() - received > _SHORT_WAIT:
            self._reopen(fitting)
            self._on_large(
                f'{self._topic} has messages of {size:,} bytes, faster than they are processed. At most {fitting} '
                'messages wait, further messages are lost. Reduce their size or rate'
            )
        elif self.qos.depth < self._full and time.monotonic() > self._large_until:
            self._reopen(self._full)

    def _reopen(self, depth: int) -> None:
        """Close the topic, and open it after the executor has released the queue: two queues would share memory."""
        self.qos.depth = depth
        self._node.destroy_subscription(self._subscription)
        self._opening = self._node.create_timer(_PAUSE, self._open, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _open(self) -> None:
        self._node.destroy_timer(self._opening)
        self._subscription = self._create(qos_profile=self.qos)
        _return_memory()


def _return_memory() -> None:
    """Return freed memory to the system: the C library would keep that of large messages."""
    trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)
    if trim is not None:
        trim(0)


class LossCounter:
    """
    A callback that counts lost messages: the overflow of a queue raises no event.

    Publishers number their messages, but a message does not name its publisher. So each message is assigned to the
    publisher with the closest smaller number.

    Parameters
    ----------
    callback
        Called with each message.
    on_lost
        Called with the number of messages lost since the last call.
    publishers
        Returns the number of publishers.
    backlog
        Backlog of the messages; while it is stale, only each tenth message is taken.
    accept
        Returns whether a message is taken, from the middleware's information.

    """

    def __init__(
        self,
        callback: Callable[[Any], None],
        on_lost: Callable[[int], None],
        publishers: Callable[[], int],
        backlog: Backlog | None = None,
        accept: Callable[[Mapping[str, Any]], bool] = lambda _: True,
    ) -> None:
        self._callback, self._on_lost, self._publishers, self._accept = callback, on_lost, publishers, accept
        self._expected: list[int] = []  # next number of each publisher, the most recent publisher last
        self._backlog = backlog

    def __call__(self, message: Any, info: Mapping[str, Any]) -> None:
        """Take a message with the middleware's information."""
        number = info.get('publication_sequence_number')
        if number is not None:  # the middleware may not provide it
            self._count(number)
            if (
                self._backlog is not None
                and self._backlog.is_stale(info['received_timestamp'])
                and number % _KEEP_EVERY
            ):
                self._on_lost(1)
                return
        if self._accept(info):
            self._callback(message)

    def _count(self, number: int) -> None:
        expected = self._expected
        if number in expected:
            expected.remove(number)
            expected.append(number + 1)
            return
        before = max((next_number for next_number in expected if next_number < number), default=None)
        publishers = self._publishers()
        if before is None or len(expected) < publishers:  # a new publisher
            expected.append(number + 1)
            del expected[: -max(publishers, 1)]
        else:
            expected.remove(before)
            expected.append(number + 1)
            self._on_lost(number - before)


class Backlog:
    """
    The messages that wait for a node's callbacks.

    After a pause of the process the backlog is long, and soon empty. A backlog that stays long is stale: messages
    arrive faster than they are taken, so that all taken messages are old.
    """

    def __init__(self) -> None:
        """Begin without a backlog."""
        self._since: int | None = None
        self._is_stale = False

    def is_stale(self, received: int) -> bool:
        """Return whether the backlog is stale, given when the present message was received [ns]."""
        now = time.time_ns()
        enough = _SHORT_WAIT if self._is_stale else _LONGEST_WAIT
        if now - received <= enough or not received:  # the middleware may not provide it
            self._since, self._is_stale = None, False
            return False
        if self._since is None:
            self._since = now
        self._is_stale = now - self._since > _STALE_AFTER
        return self._is_stale


@contextmanager
def _naming(topic: str) -> Iterator[None]:
    """Turn an invalid override into an error for the user, with the topic's name."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise InputError(f'{topic}: {error}; check its qos_overrides') from error
