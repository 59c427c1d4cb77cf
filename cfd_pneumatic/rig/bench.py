# SPDX-License-Identifier: Apache-2.0
"""The test bench: the rig with its instruments, sampled at a fixed period."""

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
    """Record of a run on the rig: the readings of the sensors, and the true values."""

    truth: Truth
    """True values, without noise and at the samples' true times."""


class Bench:
    """
    A rig that is sampled with a fixed period.

    The samples do not depend, to the last bit, on how many are taken at once.

    Parameters
    ----------
    rig
        The rig, at rest.
    sampling_period
        Time between samples [s]; the first sample has time 0.
    sensors
        The sensors of the bench.
    seed
        Seed of the sensors' noise.

    """

    def __init__(self, rig: Rig, sampling_period: float, sensors: Sensors = Sensors(), seed: int = 0) -> None:
        self.rig = rig
        self.sampling_period = sampling_period
        self._transmission = Transmission(rig.parameters, rig.pressures, rig.position)
        self._instruments = Instruments(sensors, sampling_period, seed)
        self._sampled = 0

    def change(self, parameters: RigParameters) -> None:
        """
        Change the effects between two samples.

        Only effects and properties of the sensors may differ from the rig's first parameters. A changed line or sensor
        starts at rest at the present pressure.
        """
        self.rig.parameters = checked(parameters)
        self._transmission.change(parameters, self.rig.pressures, self.rig.position)

    def advance(self, positions: ArrayLike, velocities: ArrayLike, setpoints: ArrayLike) -> RigRecord:
        """
        Move the piston and return the samples of the motion.

        Parameters
        ----------
        positions, velocities : (samples * knots,)
            Motion to the next samples [m], [m/s], with the same number of knots for each sample.
        setpoints : (samples, 2)
            Set pressures until each sample, gauge [Pa].

        """
        levels = np.asarray(setpoints, dtype=float)
        samples, knots = len(levels), len(np.asarray(positions)) // len(levels)
        true_motion = self.rig.advance(
            positions, velocities, np.repeat(levels, knots, axis=0), self.sampling_period / knots
        )
        times = self.sampling_period * np.arange(float(self._sampled), float(self._sampled + samples))
        self._sampled += samples
        truth = replace(true_motion.every_nth(knots), times=times)
        at_sensors = self._transmission.carry(true_motion, self.sampling_period / knots).every_nth(knots)
        readings = self._instruments.read(replace(at_sensors, times=times))
        return RigRecord(**vars(readings), truth=truth)


class Performance:
    """
    Play a schedule on a bench, from its first sample to its last.

    With `repeat` the schedule is played repeatedly on the same rig, and must end where it begins
    (`Schedule.with_return`).
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
        """Number of samples until the end of the schedule."""
        return self._schedule.samples - self._played

    @property
    def setpoints(self) -> tuple[float, float]:
        """Set pressures of A and B until the next sample, or at the end of the schedule, gauge [Pa]."""
        first, second = self._schedule.setpoints[min(self._played, self._schedule.samples - 1)]
        return float(first), float(second)

    def change(self, parameters: RigParameters) -> None:
        """Change the effects before the next sample, as `Bench.change` does."""
        self._bench.change(parameters)

    def advance(self, samples: int) -> RigRecord:
        """Play the next samples, at most the remaining ones, and return their record."""
        schedule = self._schedule
        chosen = slice(self._played, self._played + min(samples, self.remaining))
        knots = slice(chosen.start * schedule.knots_per_sample, chosen.stop * schedule.knots_per_sample)
        self._played = 0 if self._repeat and chosen.stop == schedule.samples else chosen.stop
        return self._bench.advance(schedule.positions[knots], schedule.velocities[knots], schedule.setpoints[chosen])


def record(
    schedule: Schedule, parameters: RigParameters = RigParameters(), sensors: Sensors = Sensors(), seed: int = 0
) -> RigRecord:
    """Play a schedule on a rig and return the record."""
    return Performance(schedule, parameters, sensors, seed).advance(schedule.samples)
