"""What a device measures and its simulator answers: pressures, applied set-points, the contact force."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Header

from cfd_pneumatic import convention
from cfd_pneumatic.nodes.topics import publish_on

_BLANK = math.pi  # found again in the bytes of a message, as no text contains its 0xfb
_NUMBER = struct.Struct('=d')
_STAMP = struct.Struct('=iI')
_STAMP_AT = 4  # a header comes first, behind four bytes that say how the message is encoded
_SECOND = 1_000_000_000  # [ns]


class _Form:
    """
    A serialised message with blanks for its stamp and one number.

    To make a message and have it serialised takes longer than the model's step, and there are five to a sample.
    """

    def __init__(self, message: FluidPressure | WrenchStamped) -> None:
        """Take a message with a header and one `_BLANK`."""
        self._bytes = bytearray(serialize_message(message))
        self._number_at = self._bytes.index(_NUMBER.pack(_BLANK))

    def stamp(self, stamp: int) -> None:
        """Write a stamp [ns]."""
        _STAMP.pack_into(self._bytes, _STAMP_AT, *divmod(stamp, _SECOND))

    def filled(self, number: float) -> bytes:
        """Return the message with a number."""
        _NUMBER.pack_into(self._bytes, self._number_at, number)
        return bytes(self._bytes)


class Outputs:
    """The topics on which every sample is answered."""

    def __init__(
        self, node: Node, cylinders: Sequence[str], force_topic: str, qos: QoSProfile, below: str = ''
    ) -> None:
        """Publish for some cylinders, the force on a topic of its own name; below a name, where `below` gives one."""
        self._pressures_out, self._applied_out = (
            [publish_on(node, FluidPressure, below + topic(name), qos) for name in cylinders]
            for topic in (convention.pressure_topic, convention.setpoint_applied_topic)
        )
        self._present = [convention.CYLINDERS.index(name) for name in cylinders]
        self._force_out = publish_on(node, WrenchStamped, below + force_topic, qos)
        self.orient('', 'x')

    def orient(self, frame_id: str, axis: str) -> None:
        """Let the force point along an axis of a frame from now on."""
        self._pressure, self._force = _pressure_form(frame_id), _force_form(frame_id, axis)

    def publish(self, stamp: int, pressures: Iterable[float], force: float) -> None:
        """Publish absolute pressures [Pa] and the contact force [N] at a stamp [ns]."""
        self._pressure.stamp(stamp)
        self._force.stamp(stamp)
        self._publish(self._pressures_out, pressures)
        self._force_out.publish(self._force.filled(force))

    def publish_applied(self, setpoints: Sequence[float]) -> None:
        """Publish those of the absolute set-points (A, B) [Pa] that acted up to the sample that was published last."""
        self._publish(self._applied_out, (setpoints[index] for index in self._present))

    def _publish(self, publishers: Sequence[Publisher], pressures: Iterable[float]) -> None:
        for publisher, pressure in zip(publishers, pressures):
            publisher.publish(self._pressure.filled(pressure))


class ResidualOutputs:
    """The topics on which measured less predicted is published: a difference, also where the type is a pressure's."""

    def __init__(self, node: Node, cylinders: Sequence[str], qos: QoSProfile) -> None:
        """Publish for some cylinders and for the contact force."""
        self._out = {name: publish_on(node, FluidPressure, convention.residual_topic(name), qos) for name in cylinders}
        force = convention.CONTACT_FORCE
        self._out[force] = publish_on(node, WrenchStamped, convention.residual_topic(force), qos)
        self.orient('', 'x')

    def orient(self, frame_id: str, axis: str) -> None:
        """Let the force point along an axis of a frame from now on."""
        self._forms = {name: _pressure_form(frame_id) for name in self._out}
        self._forms[convention.CONTACT_FORCE] = _force_form(frame_id, axis)

    def publish(self, name: str, stamp: int, residual: float) -> None:
        """Publish the residual [Pa or N] of a cylinder or of the contact force, at a stamp [ns]."""
        form = self._forms[name]
        form.stamp(stamp)
        self._out[name].publish(form.filled(residual))


def _pressure_form(frame_id: str) -> _Form:
    return _Form(FluidPressure(header=Header(frame_id=frame_id), fluid_pressure=_BLANK))


def _force_form(frame_id: str, axis: str) -> _Form:
    force = WrenchStamped(header=Header(frame_id=frame_id))
    setattr(force.wrench.force, axis, _BLANK)
    return _Form(force)
