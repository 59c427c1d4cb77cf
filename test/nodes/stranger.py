# SPDX-License-Identifier: Apache-2.0
"""A participant of DDS that is not a node of ROS 2: it names types as it likes, and sends texts as any type."""

# Annotations stay types here: cyclonedds reads them.

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

LOOPBACK = """
<CycloneDDS><Domain Id="any">
  <General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>
"""


class Stranger:
    """The participant; it is there as long as this object."""

    def __init__(self) -> None:
        pytest.importorskip('cyclonedds', reason='cyclonedds, with which a stranger takes part, is not here')
        from cyclonedds.domain import Domain, DomainParticipant

        number = int(os.environ['ROS_DOMAIN_ID'])
        self._domain = Domain(number, LOOPBACK)
        self._participant = DomainParticipant(number)
        self._writers: list[Any] = []

    def sender(self, topic: str, type_name: str) -> Callable[[str], None]:
        """Return what sends a text on a topic of ROS 2, as a message of a type that DDS calls by a name."""
        from cyclonedds.idl import IdlStruct
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        @dataclass
        class Text(IdlStruct, typename=type_name):
            text: str

        kind: Any = Text
        kind.__idl__.idl_transformed_typename = type_name
        reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)))
        writer = DataWriter(self._participant, Topic(self._participant, f'rt{topic}', kind, qos=reliable))
        self._writers.append(writer)
        return lambda text: writer.write(kind(text))

    def take_name(self, name: bytes) -> None:
        """Say that a node of ROS 2 with a name of any bytes owns all senders."""
        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.types import array, sequence, uint8
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        @dataclass
        class Owner(IdlStruct, typename='owner'):
            namespace: sequence[uint8]
            name: sequence[uint8]
            readers: sequence[array[uint8, 16]]
            writers: sequence[array[uint8, 16]]

        @dataclass
        class Owners(IdlStruct, typename='owners'):
            participant: array[uint8, 16]
            nodes: sequence[Owner]

        kind: Any = Owners
        kind.__idl__.idl_transformed_typename = 'rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_'
        latched = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(1),
        )
        topic = Topic(self._participant, 'ros_discovery_info', kind, qos=latched)
        self._announcer = DataWriter(self._participant, topic, qos=latched)
        writers = [list(writer.guid.bytes) for writer in self._writers]
        node = Owner(list(b'/\0'), [*name, 0], [], writers)
        self._announcer.write(kind(list(self._participant.guid.bytes), [node]))
