"""Samples in serialised messages: a stamp and one number, read without making a message of the bytes."""

from __future__ import annotations

from cfd_pneumatic.nodes.messages import is_time
from cfd_pneumatic.recording.fields import FieldPath, Step
from cfd_pneumatic.recording.layout import Layout, LayoutError, Place, Serialization
from cfd_pneumatic.recording.messages import FLUID_PRESSURE, JOINT_STATE, NANOSECONDS, WRENCH_STAMPED, standard_types

_SECONDS, _NANOSECONDS = (FieldPath((Step('header'), Step('stamp'), Step(part))) for part in ('sec', 'nanosec'))


class SampleReader:
    """
    Reads the samples of a topic, whose messages are mostly laid out like the one before.

    rclpy takes longer to make a `JointState` of its bytes than the model takes for a step.

    Parameters
    ----------
    msgtype
        Type of the messages, with a header.
    path
        Of the number that is wanted.

    """

    def __init__(self, msgtype: str, path: FieldPath) -> None:
        self._types = standard_types()
        self._msgtype = msgtype
        self._path = path
        self._layout: Layout | None = None
        self._places: tuple[Place, Place, Place] | None = None

    @property
    def names(self) -> list[str]:
        """Names of the entries in the last message, as JointState has them."""
        return [] if self._layout is None else self._layout.names()

    def read(self, message: bytes) -> tuple[int | None, float] | None:
        """
        Return stamp [ns] and number; None where the message has no such number, or is no message of its type.

        The stamp is None where it is no time.
        """
        if self._layout is None or not self._layout.fits(message):
            self._learn(message)
        if self._places is None:
            return None
        seconds, nanoseconds, number = (place.number(message) for place in self._places)
        stamp = int(seconds) * NANOSECONDS + int(nanoseconds) if is_time(seconds, nanoseconds) else None
        return stamp, number

    def _learn(self, message: bytes) -> None:
        """Find out where stamp and number are."""
        self._layout, self._places = None, None
        try:
            self._layout = layout = Layout(message, self._types, self._msgtype, Serialization.CDR)
        except LayoutError:
            return
        seconds, nanoseconds, number = map(layout.place, (_SECONDS, _NANOSECONDS, self._path))
        if seconds and nanoseconds and number:
            self._places = seconds, nanoseconds, number


def joint_reader(joint: str) -> SampleReader:
    """Return what reads the position of a joint [m]."""
    return SampleReader(JOINT_STATE, FieldPath((Step('position', joint),)))


def pressure_reader() -> SampleReader:
    """Return what reads a pressure [Pa]."""
    return SampleReader(FLUID_PRESSURE, FieldPath((Step('fluid_pressure'),)))


def force_reader(axis: str) -> SampleReader:
    """Return what reads a force along an axis [N]."""
    return SampleReader(WRENCH_STAMPED, FieldPath((Step('wrench'), Step('force'), Step(axis))))
