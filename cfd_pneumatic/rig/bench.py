# SPDX-License-Identifier: Apache-2.0
"""The test bench: the rig with its instruments, sampled."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.rig.parameters import RigParameters, checked
from cfd_pneumatic.rig.rig import Rig, Truth
from cfd_pneumatic.rig.schedule import Schedule
from cfd_pneumatic.rig.sensors import Instruments, Readings, Sensors
from cfd_pneumatic.rig.transmission import Transmission


@dataclass(frozen=True, eq=False)
class RigRecord(Readings):
    """What a run on the rig left: what its sensors read, and beside it what really happened."""

    truth: Truth
    """Without noise and at the samples' true times."""


class Bench:
    """
    A rig that is sampled with a fixed period.

    Samples taken one by one, a few or all at once are the same to the last bit.

    Parameters
    ----------
    rig
        The rig, at rest.
    sampling_period
        Time between samples [s]; the first one taken has time 0.
    sensors
        What it is read with.
    seed
        Picks the sensors' noise.

    """

    def __init__(self, rig: Rig, sampling_period: float, sensors: Sensors = Sensors(), seed: int = 0) -> None:
        self.rig = rig
        self.sampling_period = sampling_period
        self._transmission = Transmission(rig.parameters, rig.pressures, rig.position)
        self._instruments = Instruments(sensors, sampling_period, seed)
        self._taken = 0

    def change(self, parameters: RigParameters) -> None:
        """
        Let effects appear, grow or go between two samples.

        Only effects and what the sensors do may differ from the rig as it was built. A line or sensor that becomes
        another begins at rest at the present pressure.
        """
        self.rig.parameters = checked(parameters)
        self._transmission.change(parameters, self.rig.pressures, self.rig.position)

    def take(self, positions: ArrayLike, velocities: ArrayLike, setpoints: ArrayLike) -> RigRecord:
        """
        Move the piston and return the samples taken on the way.

        Parameters
        ----------
        positions, velocities : (samples * knots,)
            The motion on the way to the next samples [m], [m/s], the same number of knots for each.
        setpoints : (samples, 2)
            Set pressures on the way to each sample, gauge [Pa].

        """
        levels = np.asarray(setpoints, dtype=float)
        samples, knots = len(levels), len(np.asarray(positions)) // len(levels)
        moved = self.rig.advance(positions, velocities, np.repeat(levels, knots, axis=0), self.sampling_period / knots)
        times = self.sampling_period * np.arange(float(self._taken), float(self._taken + samples))
        self._taken += samples
        truth = replace(moved.every(knots), times=times)
        arrived = self._transmission.carry(moved, self.sampling_period / knots).every(knots)
        read = self._instruments.read(replace(arrived, times=times))
        return RigRecord(**vars(read), truth=truth)


class Performance:
    """
    A schedule being played on a bench, from its first sample to its last.

    With `repeat` over and over, on the same rig: it has to lead back to where it began (`Schedule.with_return`).
    """

    def __init__(
        self,
        schedule: Schedule,
        parameters: RigParameters = RigParameters(),
        sensors: Sensors = Sensors(),
        seed: int = 0,
        *,
        repeat: bool = False,
    ) -> None:
        first = tuple(schedule.setpoints[0])
        rig = Rig(
            (first[0], first[1]), parameters, position=float(schedule.positions[0]), time=-schedule.sampling_period
        )
        self._schedule = schedule
        self._bench = Bench(rig, schedule.sampling_period, sensors, seed)
        self._played = 0
        self._repeat = repeat

    @property
    def remaining(self) -> int:
        """Number of samples still to come, before it is repeated."""
        return self._schedule.samples - self._played

    @property
    def setpoints(self) -> tuple[float, float]:
        """Set pressures of A and B on the way to the next sample, or of the end [Pa], gauge."""
        first, second = self._schedule.setpoints[min(self._played, self._schedule.samples - 1)]
        return float(first), float(second)

    def change(self, parameters: RigParameters) -> None:
        """Let effects appear, grow or go before the next sample, as `Bench.change` does."""
        self._bench.change(parameters)

    def take(self, samples: int) -> RigRecord:
        """Return the next samples; no more than remain."""
        schedule = self._schedule
        chosen = slice(self._played, self._played + min(samples, self.remaining))
        knots = slice(chosen.start * schedule.knots_per_sample, chosen.stop * schedule.knots_per_sample)
        self._played = 0 if self._repeat and chosen.stop == schedule.samples else chosen.stop
        return self._bench.take(schedule.positions[knots], schedule.velocities[knots], schedule.setpoints[chosen])


def record(
    schedule: Schedule, parameters: RigParameters = RigParameters(), sensors: Sensors = Sensors(), seed: int = 0
) -> RigRecord:
    """Return what a schedule leaves when it is played on a rig."""
    return Performance(schedule, parameters, sensors, seed).take(schedule.samples)
