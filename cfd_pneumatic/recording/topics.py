# SPDX-License-Identifier: Apache-2.0
"""Find the topics of our convention in a bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cfd_pneumatic.convention import CYLINDERS, PISTON_STATE, ROLES, Role, pressure_topic
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags import Topic
from cfd_pneumatic.recording.message_texts import listed
from cfd_pneumatic.recording.sources import SignalSource


def convention_channels(topics: Mapping[str, Topic], namespace: str | None) -> list[SignalSource]:
    """
    Return the channels of a bag in our convention.

    Parameters
    ----------
    topics : Mapping
        The bag's topics.
    namespace : str or None
        Namespace of the topics; None if only one namespace fits.

    Raises
    ------
    InputError
        If no namespace fits, several fit and none is chosen, or a topic's type differs from the convention.

    """
    chosen = _choose_namespace(topics, namespace)
    channels = [
        _channel(topics, chosen, role, cylinder)
        for role in ROLES.values()
        for cylinder in (CYLINDERS if role.of_cylinder else (None,))
    ]
    present = [channel for channel in channels if channel is not None]
    measured = {channel.cylinder for channel in present if channel.role == 'pressure'}
    return [channel for channel in present if channel.cylinder is None or channel.cylinder in measured]


def resolve(namespace: str | None, topic: str) -> str:
    """Return a topic's full name; a topic that begins with a slash is already full."""
    return topic if topic.startswith('/') else f'{_normalise(namespace or "")}/{topic}'


def list_topics(topics: Mapping[str, Topic]) -> str:
    """Return topics with their types, for a message."""
    return listed([f'{name} ({topics[name].msgtype})' for name in sorted(topics)])


def _choose_namespace(topics: Mapping[str, Topic], namespace: str | None) -> str:
    fitting = sorted(_fitting(topics))
    pressures = ' or '.join(map(pressure_topic, CYLINDERS))
    if namespace is not None:
        chosen = _normalise(namespace)
        if chosen in fitting:
            return chosen
        alternatives = f'; namespaces that do: {_list(fitting)}' if fitting else ''
        raise InputError(
            f'no {pressures} in the namespace {chosen or "/"}{alternatives}; the topics are {list_topics(topics)}'
        )
    if not fitting:
        raise InputError(f'no {pressures}: give a mapping file for the topics that there are: {list_topics(topics)}')
    if len(fitting) > 1:
        raise InputError(f'several devices are recorded: choose a namespace, one of {_list(fitting)}')
    return fitting[0]


def _fitting(topics: Iterable[str]) -> set[str]:
    """Return the namespaces with a pressure and a displacement; if there are none, all with a pressure."""
    names = set(topics)
    ends = [f'/{pressure_topic(cylinder)}' for cylinder in CYLINDERS]
    measured = {name.removesuffix(end) for name in names for end in ends if name.endswith(end)}
    return {namespace for namespace in measured if f'{namespace}/{PISTON_STATE}' in names} or measured


def _channel(topics: Mapping[str, Topic], namespace: str, role: Role, cylinder: str | None) -> SignalSource | None:
    topic = topics.get(f'{namespace}/{role.topic_of(cylinder)}')
    if topic is None:
        return None
    if topic.msgtype != role.msgtype:
        raise InputError(f'topic {topic.name} holds {topic.msgtype}, not {role.msgtype}: give a mapping file')
    return SignalSource(role.name, cylinder, topic.name, gauge=role.gauge)


def _normalise(namespace: str) -> str:
    name = namespace.strip('/')
    return f'/{name}' if name else ''


def _list(namespaces: Iterable[str]) -> str:
    return listed([namespace or '/' for namespace in namespaces])
