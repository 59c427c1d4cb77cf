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
        return lambda text: writer.write(kind(text))
