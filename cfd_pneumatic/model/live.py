# SPDX-License-Identifier: Apache-2.0
"""A device that is simulated sample by sample, by the stamps of the samples."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from cfd_pneumatic.model.cylinder import Cylinder
from cfd_pneumatic.model.device_model import DeviceModel, DeviceState, ForceGeometry
from cfd_pneumatic.model.effects import FORCE_PARTS, PRESSURE_PARTS
from cfd_pneumatic.model.extended import Movement
from cfd_pneumatic.model.parameters import TABLE_1

NANOSECOND = 1e-9


class Arrival(enum.Enum):
    """How a sample was handled."""

    FIRST = 'first'
    ADVANCED = 'advanced'
    REPEATED = 'repeated'
    WENT_BACK = 'went back'
    AFTER_GAP = 'after a gap'
    DIVERGED = 'diverged'
    IMPOSSIBLE = 'impossible'


class Committed(NamedTuple):
    """
    The state as of the last sample.

    Attributes
    ----------
    start
        Stamp of the sample at which the device started at rest [ns].
    stamp
        Stamp of the last sample [ns].
    position
        Piston displacement of the last sample [m].
    setpoints
        Absolute set-points (A, B) that acted up to the last sample [Pa].
    state
        State of the device at the last sample.

    """

    start: int
    stamp: int
    position: float
    setpoints: tuple[float, float]
    state: DeviceState

    def movement(self, elapsed: float, position: float) -> Movement:
        """Return the piston's movement to a position [m] in `elapsed` seconds."""
        return Movement((self.stamp - self.start) * NANOSECOND + elapsed, elapsed, self.position, position)


class LiveDevice:
    """
    A device whose state advances by the stamps of piston samples, never by a clock.

    The same sequence of stamps, positions and set-points gives the same pressures to the last bit.
    """

    def __init__(self, device: DeviceModel, max_gap: float, supply: float = math.inf) -> None:
        """Simulate `device`; a step above `max_gap` [s] restarts at rest; `supply` limits pressures, absolute [Pa]."""
        self.device = device
        self.max_gap = max_gap
        self.supply = supply
        self.committed: Committed | None = None

    def reset(self) -> None:
        """Forget the state: the next sample starts at rest at its set-points."""
        self.committed = None

    def sample(self, stamp: int, position: float, setpoints: tuple[float, float]) -> Arrival:
        """
        Commit a piston sample.

        The piston moves in a straight line from the last sample, and the set-points act over the whole step. The
        device starts at rest after a gap, if the stamp went back, or if effects drove the pressures out of the range
        of numbers. A repeated stamp changes nothing. A sample is not committed if a pressure would be below vacuum or
        above the supply.

        Parameters
        ----------
        stamp
            Stamp of the sample [ns].
        position
            Piston displacement [m].
        setpoints
            Absolute set-points of cylinders A and B [Pa].

        """
        last = self.committed
        arrival = self._arrival(stamp)
        if arrival is Arrival.REPEATED:
            return arrival
        if last is not None and arrival is Arrival.ADVANCED:
            movement = last.movement((stamp - last.stamp) * NANOSECOND, position)
            state = self.device.step(last.state, movement, *setpoints)
            if state.is_finite:
                if not all(0.0 <= pressure <= self.supply for pressure in state.readings):
                    return Arrival.IMPOSSIBLE
                self.committed = Committed(last.start, stamp, position, setpoints, state)
                return arrival
            arrival = Arrival.DIVERGED
        self.committed = Committed(stamp, stamp, position, setpoints, self.device.at_rest(*setpoints, position))
        return arrival

    def _arrival(self, stamp: int) -> Arrival:
        """Return how a sample with a stamp [ns] is handled."""
        if self.committed is None:
            return Arrival.FIRST
        elapsed = stamp - self.committed.stamp
        if elapsed == 0:
            return Arrival.REPEATED
        if elapsed < 0:
            return Arrival.WENT_BACK
        return Arrival.AFTER_GAP if elapsed * NANOSECOND > self.max_gap else Arrival.ADVANCED

    def preview(self, elapsed: float, setpoints: tuple[float, float]) -> DeviceState | None:
        """
        Predict the state `elapsed` > 0 seconds after the last sample with the piston at rest; commit nothing.

        None if there was no sample yet, or if a pressure would not be a finite number.
        """
        last = self.committed
        if last is None:
            return None
        state = self.device.step(last.state, last.movement(elapsed, last.position), *setpoints)
        return state if state.is_finite else None


def warm_up() -> None:
    """
    Compile or load the functions that step a device, so that no sample waits for the compiler.

    The effects are included, so that switching an effect on later compiles nothing.
    """
    all_on_pressure, all_on_force = (
        {name: effect.null for name, effect in parts.items()} for parts in (PRESSURE_PARTS, FORCE_PARTS)
    )
    for on_pressure, on_force in (({}, {}), (all_on_pressure, all_on_force)):
        cylinder = Cylinder(TABLE_1, 1e5, on_pressure)
        device = DeviceModel(cylinder, None, ForceGeometry(1e-3, 1.0, 1e5), on_force)
        device.step(device.at_rest(2e5, 2e5), Movement(1e-3, 1e-3, 0.0, 1e-6), 2e5, 2e5)
