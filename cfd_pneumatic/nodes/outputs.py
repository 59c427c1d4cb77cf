"""What a device measures and its simulator answers: pressures, applied set-points, the contact force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geometry_msgs.msg import Vector3, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Header

from cfd_pneumatic import convention
from cfd_pneumatic.nodes.messages import stamp_message
from cfd_pneumatic.nodes.topics import publish_on


class Outputs:
    """
    The topics on which every sample is answered.

    Messages are made once and filled anew, with one header for all: making them would take longer than publishing.
    """

    def __init__(self, node: Node, cylinders: Sequence[str], force_topic: str, qos: QoSProfile) -> None:
        """Publish for some cylinders, the force on a topic of its own name."""
        self._header = Header()
        self._pressure, self._force = FluidPressure(), WrenchStamped()
        self._pressure.header = self._force.header = self._header
        self._axis = 'x'
        self._pressures_out, self._applied_out = (
            [publish_on(node, FluidPressure, topic(name), qos) for name in cylinders]
            for topic in (convention.pressure_topic, convention.setpoint_applied_topic)
        )
        self._force_out = publish_on(node, WrenchStamped, force_topic, qos)

    def orient(self, frame_id: str, axis: str) -> None:
        """Let the force point along an axis of a frame from now on."""
        self._header.frame_id = frame_id
        self._force.wrench.force = Vector3()
        self._axis = axis

    def publish(self, stamp: int, pressures: Iterable[float], force: float) -> None:
        """Publish absolute pressures [Pa] and the contact force [N] at a stamp [ns]."""
        self._header.stamp = stamp_message(stamp)
        self._publish(self._pressures_out, pressures)
        setattr(self._force.wrench.force, self._axis, force)
        self._force_out.publish(self._force)

    def publish_applied(self, setpoints: Iterable[float]) -> None:
        """Publish the absolute set-points [Pa] that acted up to the sample that was published last."""
        self._publish(self._applied_out, setpoints)

    def _publish(self, publishers: Sequence[Publisher], pressures: Iterable[float]) -> None:
        for publisher, pressure in zip(publishers, pressures):
            self._pressure.fluid_pressure = pressure
            publisher.publish(self._pressure)
