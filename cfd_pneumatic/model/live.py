"""The device followed sample by sample, by the samples' own stamps."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from cfd_pneumatic.model.device import Device, DeviceState

NANOSECOND = 1e-9


class Arrival(enum.Enum):
    """What became of a sample."""

    FIRST = 'first'
    ADVANCED = 'advanced'
    REPEATED = 'repeated'
    WENT_BACK = 'went back'
    AFTER_GAP = 'after a gap'


@dataclass(frozen=True)
class Committed:
    """
    The state as of the last sample.

    Attributes
    ----------
    stamp
        Of the sample [ns].
    position
        Piston displacement in it [m].
    setpoints
        Absolute set-points (A, B) that acted up to it [Pa].
    state
        Pressures at it.

    """

    stamp: int
    position: float
    setpoints: tuple[float, float]
    state: DeviceState


class LiveDevice:
    """
    A device whose state advances by the stamps of piston samples, never by a clock.

    The same sequence of stamps, positions and set-points gives the same pressures to the last bit.
    """

    def __init__(self, device: Device, max_gap: float) -> None:
        """Follow `device`; a step longer than `max_gap` [s] starts anew instead."""
        self.device = device
        self.max_gap = max_gap
        self.committed: Committed | None = None

    def reset(self) -> None:
        """Forget the state: the next sample starts at rest at its set-points."""
        self.committed = None

    def sample(self, stamp: int, position: float, setpoints: tuple[float, float]) -> Arrival:
        """
        Commit a piston sample.

        The piston is taken to move in a straight line from the last sample, at set-points that act over the whole
        step. After a gap, or where the stamp went back, the device starts at rest. A repeated stamp changes nothing.

        Parameters
        ----------
        stamp
            Of the sample [ns].
        position
            Piston displacement [m].
        setpoints
            Absolute set-points of cylinders A and B [Pa].

        """
        last = self.committed
        if last is None:
            arrival = Arrival.FIRST
        elif stamp == last.stamp:
            return Arrival.REPEATED
        elif stamp < last.stamp:
            arrival = Arrival.WENT_BACK
        elif (stamp - last.stamp) * NANOSECOND > self.max_gap:
            arrival = Arrival.AFTER_GAP
        else:
            arrival = Arrival.ADVANCED
        if last is None or arrival is not Arrival.ADVANCED:
            state = self.device.at_rest(*setpoints)
        else:
            duration = (stamp - last.stamp) * NANOSECOND
            state = self.device.step(last.state, duration, (position - last.position) / duration, *setpoints)
        self.committed = Committed(stamp, position, setpoints, state)
        return arrival

    def preview(self, elapsed: float, setpoints: tuple[float, float]) -> DeviceState | None:
        """Return what the state would be `elapsed` seconds after the last sample, the piston held; commits nothing."""
        if self.committed is None:
            return None
        return self.device.step(self.committed.state, elapsed, 0.0, *setpoints)
