# SPDX-License-Identifier: Apache-2.0
"""What a device measures and its simulator answers: pressures, applied set-points, the contact force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import FluidPressure

from cfd_pneumatic import convention
from cfd_pneumatic.nodes.samples import SampleWriter, force_writer, pressure_writer
from cfd_pneumatic.nodes.topics import publish_on

Writers = tuple[SampleWriter, SampleWriter]
"""What makes the messages of pressures, and of forces."""


def writers(node: Node, frame_id: str, axis: str) -> Writers:
    """Return what makes the messages of a frame in which the force points along an axis."""
    return pressure_writer(node, frame_id), force_writer(node, frame_id, axis)


class Answers:
    """The topics on which pressures and the force are published."""

    def __init__(self, node: Node, cylinders: Sequence[str], force_topic: str, below: str = '') -> None:
        """Open topics for some cylinders and for the force, below a name where there is one. Then `orient`."""
        self._pressures_out = [
            publish_on(node, FluidPressure, below + convention.pressure_topic(name)) for name in cylinders
        ]
        self._force_out = publish_on(node, WrenchStamped, below + force_topic)

    def orient(self, writers: Writers) -> None:
        """Write messages as these do from now on."""
        self._pressure, self._force = writers

    def publish(self, stamp: int, pressures: Iterable[float], force: float) -> None:
        """Publish absolute pressures [Pa] and the contact force [N] at a stamp [ns]."""
        self._publish(self._pressures_out, stamp, pressures)
        self._force_out.publish(self._force.filled(stamp, force))

    def _publish(self, publishers: Sequence[Publisher], stamp: int, pressures: Iterable[float]) -> None:
        for publisher, pressure in zip(publishers, pressures):
            publisher.publish(self._pressure.filled(stamp, pressure))


class Outputs(Answers):
    """The topics on which every sample is answered, also with the set-points that acted."""

    def __init__(self, node: Node, cylinders: Sequence[str], force_topic: str, below: str = '') -> None:
        """Open topics for some cylinders and for the force, below a name where there is one. Then `orient`."""
        super().__init__(node, cylinders, force_topic, below)
        self._applied_out = [
            publish_on(node, FluidPressure, below + convention.setpoint_applied_topic(name)) for name in cylinders
        ]
        self._present = [convention.CYLINDERS.index(name) for name in cylinders]

    def publish_applied(self, stamp: int, setpoints: Sequence[float]) -> None:
        """Publish those of the absolute set-points (A, B) [Pa] that acted up to a sample at a stamp [ns]."""
        self._publish(self._applied_out, stamp, (setpoints[index] for index in self._present))


class ResidualOutputs:
    """The topics on which measured less predicted is published: a difference, also where the type is a pressure's."""

    def __init__(self, node: Node, cylinders: Sequence[str]) -> None:
        """Open topics for some cylinders and for the contact force. Then `orient`."""
        self._out = {name: publish_on(node, FluidPressure, convention.residual_topic(name)) for name in cylinders}
        force = convention.CONTACT_FORCE
        self._out[force] = publish_on(node, WrenchStamped, convention.residual_topic(force))

    def orient(self, writers: Writers) -> None:
        """Write messages as these do from now on."""
        pressure, force = writers
        self._writers = {**dict.fromkeys(self._out, pressure), convention.CONTACT_FORCE: force}

    def publish(self, name: str, stamp: int, residual: float) -> None:
        """Publish the residual [Pa or N] of a cylinder or of the contact force, at a stamp [ns]."""
        self._out[name].publish(self._writers[name].filled(stamp, residual))
