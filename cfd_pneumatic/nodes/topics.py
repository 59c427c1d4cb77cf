# SPDX-License-Identifier: Apache-2.0
"""Opening topics whose QoS parameters can override: `qos_overrides./cfd/sim/piston_state.subscription.reliability`."""

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

_WAIT = 200_000_000  # longer no sample should wait for its callback [ns]
_SHORT = 50_000_000  # until they wait no longer than this, once too many wait [ns]
_STANDING = 1_000_000_000  # for so long all may, as behind a process that stood still [ns]
_KEPT = 10  # of so many samples one is taken while they wait for longer

BUDGET = 8 * 2**20
"""Largest size of the messages of a topic that wait [bytes]: 5,000 samples of a robot with twenty joints fit."""

_OVERHEAD = 256  # of a message in the middleware's queue [bytes]
_PAUSE = 0.01  # in which the executor lets go of a queue [s]
_REMEMBERED = 1_000  # messages by which one that comes twice is recognised
_LOOK_PERIOD = 0.1  # how often publishers are looked for that keep their last message [s]
_LATCHED_DEPTH = 10  # publishers whose last message is heard
_CALM = 30.0  # after the last large message the queue gets its full depth again [s]


def publish_on(node: Node, message_type: type, topic: str) -> Publisher:
    """Return a publisher with `OUTPUT_QOS`, a copy of it: rclpy writes the overrides into what it is given."""
    with _named(topic):
        return node.create_publisher(
            message_type, topic, copy(OUTPUT_QOS), qos_overriding_options=QoSOverridingOptions.with_default_policies()
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
    on_large: Callable[[str], None] | None = None,
    queue: Queue | None = None,
    budget: int = BUDGET,
    accept: Callable[[Mapping[str, Any]], bool] = lambda _: True,
) -> QoSProfile:
    """
    Call a function for each message on a topic, with the serialised message if `raw`; return the QoS that acts.

    Parameters
    ----------
    node, message_type, topic, callback, qos
        As of `Node.create_subscription`; `qos` stays as it is, and parameters of the node may override it.
    raw
        Whether the function takes serialised messages. Messages that are none of the type are counted as lost if not.
    on_lost
        Is called with the number of messages that were lost since its last call.
    on_mismatch
        Is called with the number of further publishers that offer less than `qos`, and the policy that differs.
    on_large
        Is called with a text when the depth of the queue changes because of the messages' size.
    queue
        If given, one of ten waiting messages is taken while messages come faster than they are taken.
    budget
        Largest size of the messages that wait [bytes].
    accept
        Tells by what the middleware knows of a message whether it is taken.

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
    take = callback if raw else _deserialised(message_type, callback, lost)
    counting = Counting(take, lost, lambda: node.count_publishers(node.resolve_topic_name(topic)), queue, accept)
    return _Subscribed(node, message_type, topic, counting, qos, events, on_large or (lambda _: None), budget).qos


def listen_to_held(
    node: Node, message_type: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile, **options: Any
) -> QoSProfile:
    """
    Call a function for each value on a topic where the last one holds, also with what was sent before we came.

    Return the QoS that acts, with the overrides in the node's parameters.

    A publisher that is transient local keeps its last message for those who come later. Who asks for it does not hear
    the others, who complain, so it is a subscription of its own, made when there is such a publisher; a message that
    both hear counts once.

    Parameters
    ----------
    node, message_type, topic, callback, qos, options
        As of `listen_to`.

    """
    seen: deque[tuple[int, int | None]] = deque(maxlen=_REMEMBERED)

    def is_new(info: Mapping[str, Any]) -> bool:
        key = info['source_timestamp'], info.get('publication_sequence_number')
        if key in seen:
            return False
        seen.append(key)
        return True

    acting = listen_to(node, message_type, topic, callback, qos, accept=is_new, **options)
    take = _deserialised(message_type, callback, options.get('on_lost') or (lambda _: None))

    def listen_if_latched() -> None:
        durabilities = {one.qos_profile.durability for one in publishers_of(node, topic)}
        if DurabilityPolicy.TRANSIENT_LOCAL not in durabilities:
            return
        node.destroy_timer(looking)
        node.create_subscription(
            message_type,
            topic,
            _WithInfo(lambda message, info: is_new(info) and take(message)),
            QoSProfile(depth=_LATCHED_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),  # others may be volatile
        )

    looking = node.create_timer(_LOOK_PERIOD, listen_if_latched, clock=Clock(clock_type=ClockType.STEADY_TIME))
    return acting


def _deserialised(
    message_type: type, callback: Callable[[Any], None], on_lost: Callable[[int], None]
) -> Callable[[bytes], None]:
    """Return a function that calls another one with the message that it deserialises."""

    def take(message: bytes) -> None:
        try:
            made = deserialize_message(message, message_type)
        except Exception:  # the middleware raises whatever a stranger's bytes make it stumble over
            on_lost(1)
            return
        callback(made)

    return take


class _WithInfo:
    """A callback that takes a message and what the middleware knows of it."""

    def __init__(self, take: Callable[[bytes, Mapping[str, Any]], object]) -> None:
        self._take = take
        self.__signature__ = signature(lambda message, info: None)  # by which rclpy sees that it wants both

    def __call__(self, *given: Any) -> None:
        message, info = given if len(given) == 2 else given[0]  # EventsExecutor gives the pair
        self._take(message, info)


class _Subscribed:
    """
    A subscription whose queue is bounded in bytes.

    The middleware bounds a queue in messages only, and it keeps the memory of the largest ones. So a topic whose large
    messages wait is opened anew with less depth, and with the full depth again when large messages have stayed away.
    While a topic is opened anew messages are lost, and counted.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        counting: Counting,
        qos: QoSProfile,
        events: SubscriptionEventCallbacks,
        on_large: Callable[[str], None],
        budget: int,
    ) -> None:
        self._node, self._topic, self._counting = node, topic, counting
        self._on_large, self._budget = on_large, budget
        self._create = partial(
            node.create_subscription, message_type, topic, _WithInfo(self._take), raw=True, event_callbacks=events
        )
        with _named(topic):
            overriding = QoSOverridingOptions.with_default_policies()
            self._subscription = self._create(qos_profile=copy(qos), qos_overriding_options=overriding)
        self.qos = self._subscription.qos_profile
        self._full = self.qos.depth
        self._large_until = 0.0

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        self._fit_depth(len(message) + _OVERHEAD, info['received_timestamp'])
        self._counting(message, info)

    def _fit_depth(self, size: int, received: int) -> None:
        """Open the topic with the depth that messages of a size [bytes] leave room for, if the node falls behind."""
        fitting = max(1, min(self._full, self._budget // size))
        if fitting < self._full:
            self._large_until = time.monotonic() + _CALM
        if fitting < self.qos.depth and time.time_ns() - received > _SHORT:
            self._reopen(fitting)
            self._on_large(
                f'{self._topic} has messages of {size:,} bytes, faster than they are taken: at most {fitting} of them '
                'wait, others are lost. Find out who publishes them'
            )
        elif self.qos.depth < self._full and time.monotonic() > self._large_until:
            self._reopen(self._full)

    def _reopen(self, depth: int) -> None:
        """Close the topic, and open it when the executor has released the queue: two queues would share memory."""
        self.qos.depth = depth
        self._node.destroy_subscription(self._subscription)
        self._opening = self._node.create_timer(_PAUSE, self._open, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _open(self) -> None:
        self._node.destroy_timer(self._opening)
        self._subscription = self._create(qos_profile=self.qos)
        _return_memory()


def _return_memory() -> None:
    """Have the C library give freed memory back to the system, of which it keeps what a queue of large messages had."""
    trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)
    if trim is not None:
        trim(0)


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
    accept
        Tells by what the middleware knows of a message whether it is taken.

    """

    def __init__(
        self,
        callback: Callable[[Any], None],
        on_lost: Callable[[int], None],
        publishers: Callable[[], int],
        queue: Queue | None = None,
        accept: Callable[[Mapping[str, Any]], bool] = lambda _: True,
    ) -> None:
        self._callback, self._on_lost, self._publishers, self._accept = callback, on_lost, publishers, accept
        self._expected: list[int] = []  # last the number of whoever was heard last
        self._queue = queue

    def __call__(self, message: Any, info: Mapping[str, Any]) -> None:
        """Take a message, and what the middleware tells of it."""
        number = info.get('publication_sequence_number')
        if number is not None:  # else the middleware does not tell
            self._count(number)
            if self._queue is not None and self._queue.stands(info['received_timestamp']) and number % _KEPT:
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
