# SPDX-License-Identifier: Apache-2.0
"""Output topics of devices and their models: pressures, applied set-points, contact force, residuals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import FluidPressure

from cfd_pneumatic import convention
from cfd_pneumatic.nodes.samples import SampleWriter, force_writer, pressure_writer
from cfd_pneumatic.nodes.topics import create_publisher

Writers = tuple[SampleWriter, SampleWriter]
"""Writers of the messages of pressures and of forces."""


def make_writers(node: Node, frame_id: str, axis: str) -> Writers:
    """Return the writers of messages in a frame, with the force along an axis."""
    return pressure_writer(node, frame_id), force_writer(node, frame_id, axis)


class SignalOutputs:
    """The topics on which pressures and the force are published."""

    def __init__(self, node: Node, cylinders: Sequence[str], force_topic: str, prefix: str = '') -> None:
        """Open topics for cylinders and the force, with a prefix; call `set_writers` before `publish`."""
        self._pressures_out = [
            create_publisher(node, FluidPressure, prefix + convention.pressure_topic(name)) for name in cylinders
        ]
        self._force_out = create_publisher(node, WrenchStamped, prefix + force_topic)

    def set_writers(self, writers: Writers) -> None:
        """Set the writers of the messages."""
        self._pressure, self._force = writers

    def publish(self, stamp: int, pressures: Iterable[float], force: float) -> None:
        """Publish absolute pressures [Pa] and the contact force [N] at a stamp [ns]."""
        self._publish(self._pressures_out, stamp, pressures)
        self._force_out.publish(self._force.filled(stamp, force))

    def _publish(self, publishers: Sequence[Publisher], stamp: int, pressures: Iterable[float]) -> None:
        for publisher, pressure in zip(publishers, pressures):
            publisher.publish(self._pressure.filled(stamp, pressure))


class Outputs(SignalOutputs):
    """The topics that answer each sample: pressures, force, and applied set-points."""

    def __init__(self, node: Node, cylinders: Sequence[str], force_topic: str, prefix: str = '') -> None:
        """Open topics for cylinders and the force, with a prefix; call `set_writers` before `publish`."""
        super().__init__(node, cylinders, force_topic, prefix)
        self._applied_out = [
            create_publisher(node, FluidPressure, prefix + convention.setpoint_applied_topic(name))
            for name in cylinders
        ]
        self._present = [convention.CYLINDERS.index(name) for name in cylinders]

    def publish_applied(self, stamp: int, setpoints: Sequence[float]) -> None:
        """Publish the absolute set-points (A, B) [Pa] that acted up to a sample at a stamp [ns], by cylinder."""
        self._publish(self._applied_out, stamp, (setpoints[index] for index in self._present))


class ResidualOutputs:
    """The topics of residuals, measured minus predicted; differences of pressures have the type of pressures."""

    def __init__(self, node: Node, cylinders: Sequence[str]) -> None:
        """Open topics for cylinders and the contact force; call `set_writers` before `publish`."""
        self._out = {name: create_publisher(node, FluidPressure, convention.residual_topic(name)) for name in cylinders}
        force = convention.CONTACT_FORCE
        self._out[force] = create_publisher(node, WrenchStamped, convention.residual_topic(force))

    def set_writers(self, writers: Writers) -> None:
        """Set the writers of the messages."""
        pressure, force = writers
        self._writers = {**dict.fromkeys(self._out, pressure), convention.CONTACT_FORCE: force}

    def publish(self, name: str, stamp: int, residual: float) -> None:
        """Publish the residual [Pa or N] of a cylinder or of the contact force, at a stamp [ns]."""
        self._out[name].publish(self._writers[name].filled(stamp, residual))
