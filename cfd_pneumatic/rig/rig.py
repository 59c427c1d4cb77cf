# SPDX-License-Identifier: Apache-2.0
"""The rig as a thing with a state: it is moved, and answers with pressures and a force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import physics
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.oddities import Oddities
from cfd_pneumatic.rig.parameters import RigParameters, checked
from cfd_pneumatic.rig.piston import Linkage

LONGEST_STEP = 5e-5
"""Longest integration step [s]."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What really happened at a number of times, which no sensor sees."""

    times: Array
    """Time since the rig was at rest [s], (n,)."""

    displacement: Array
    """Position of the tool, and of the piston but for lost motion [m], (n,)."""

    velocity: Array
    """Velocity of the same [m/s], (n,)."""

    acceleration: Array
    """Acceleration of the piston [m/s^2], (n,)."""

    pressures: Array
    """Absolute pressure in the cylinders A and B [Pa], (n, 2)."""

    sensed_pressures: Array
    """Absolute pressure in the regulators' control chambers [Pa], (n, 2)."""

    setpoints: Array
    """Absolute pressure that the regulators were set to up to each time [Pa], (n, 2)."""

    force: Array
    """Force on the workpiece along +x [N], (n,)."""

    def every(self, stride: int) -> Truth:
        """Return each stride-th time, counted so that the last of every `stride` times is kept."""
        return Truth(**{name: values[stride - 1 :: stride] for name, values in vars(self).items()})


class Rig:
    """
    Two opposing, pressure-regulated cylinders whose piston is moved.

    The rig starts at rest with both cylinders at their set-points.

    Parameters
    ----------
    setpoints
        Set pressure of the cylinders A and B, gauge [Pa].
    parameters
        What the rig is made of.
    position
        Position of the piston [m].
    time
        Time at the start [s].
    longest_step
        Longest integration step [s].

    Attributes
    ----------
    time
        Time since the rig was at rest [s].
    position, velocity
        Of the piston [m, m/s].

    """

    def __init__(
        self,
        setpoints: tuple[float, float],
        parameters: RigParameters = RigParameters(),
        *,
        position: float = 0.0,
        time: float = 0.0,
        longest_step: float = LONGEST_STEP,
    ) -> None:
        self.parameters = checked(parameters)
        self._longest_step = longest_step
        resting = self._absolute(np.array(setpoints, dtype=float))
        self._states = np.zeros((2, physics.STATES))
        self._states[:, : physics.PLAY] = [
            physics.CylinderState(pressure, pressure, pressure, parameters.air.temperature, 0.0, 0.0, 0.0, 0.0)
            for pressure in resting
        ]
        self._stretch = 0.0
        self.time = time
        self.position = float(self._reachable(np.array([position]))[0])
        self.velocity = 0.0
        self._linkage = Linkage(self.position, self.parameters.piston.lost_motion)

    @property
    def pressures(self) -> Array:
        """Absolute pressure in the cylinders A and B [Pa], (2,)."""
        return self._states[:, physics.OUTLET].copy()

    def advance(self, positions: ArrayLike, velocities: ArrayLike, setpoints: ArrayLike, period: float) -> Truth:
        """
        Move the piston from knot to knot and return what happened at each.

        Parameters
        ----------
        positions, velocities : (knots,)
            Where the piston arrives at each knot [m] and how fast [m/s]; cubic in between.
        setpoints : (2,) or (knots, 2)
            Set pressure of the cylinders on the way to each knot, gauge [Pa].
        period
            Time between knots [s].

        Raises
        ------
        InputError
            If a position is beyond the travel, or a set-point below vacuum or above the supply.

        """
        reached = self._reachable(np.atleast_1d(np.asarray(positions, dtype=float)))
        knots = len(reached)
        acting = np.ascontiguousarray(np.broadcast_to(self._absolute(np.asarray(setpoints, dtype=float)), (knots, 2)))
        arriving = np.atleast_1d(np.asarray(velocities, dtype=float))
        x, v = self._linkage.drive(reached, arriving)
        times = self.time + period * np.arange(1.0, knots + 1.0)
        trajectory = np.empty((knots, 2, 2))
        forces, accelerations = np.empty(knots), np.empty(knots)
        steps = math.ceil(period / self._longest_step * (1.0 - 1e-9))
        self._stretch = physics.advance(
            self._states,
            self._stretch,
            x,
            v,
            _disturbed(acting, times - 0.5 * period, self.parameters),
            period,
            steps,
            self.parameters,
            trajectory,
            forces,
            accelerations,
        )
        self.time, self.position, self.velocity = float(times[-1]), float(reached[-1]), float(arriving[-1])
        return Truth(
            times=times,
            displacement=reached,
            velocity=arriving,
            acceleration=accelerations,
            pressures=trajectory[:, :, physics.OUTLET],
            sensed_pressures=trajectory[:, :, physics.SENSED],
            setpoints=acting,
            force=forces,
        )

    def _reachable(self, positions: Array) -> Array:
        travel = self.parameters.piston.travel
        if not np.all(np.abs(positions) <= travel):
            raise InputError(
                f'the piston travels {travel * 1e3:g} mm to either side: '
                f'{np.max(np.abs(positions)) * 1e3:g} mm is out of reach'
            )
        return positions

    def _absolute(self, setpoints: Array) -> Array:
        air = self.parameters.air
        absolute = setpoints + air.ambient_pressure
        if not np.all((absolute > 0.0) & (absolute < air.supply_pressure)):
            raise InputError(
                f'a set-point lies between vacuum and the supply, {-air.ambient_pressure:.6g} to '
                f'{air.supply_pressure - air.ambient_pressure:.6g} Pa gauge, not at {setpoints.tolist()}'
            )
        return absolute


def shift(times: Array, effects: Effects, odd: Oddities) -> Array:
    """Return by how much a set pressure is off at some times [s], in Pa."""
    phases = 2.0 * np.pi * effects.pulsation_frequency * times + effects.pulsation_phase
    jumped = np.where(times >= effects.jump_time, effects.jump, 0.0)
    crept = odd.creep * -np.expm1(-np.maximum(times, 0.0) / odd.creep_time)
    return effects.drift * times + effects.pulsation * np.sin(phases) + jumped + crept


def _disturbed(setpoints: Array, times: Array, parameters: RigParameters) -> Array:
    """Return the set pressures of both cylinders that act at some times [s], in Pa, (n, 2)."""
    both = ((parameters.effects_a, parameters.odd_a), (parameters.effects_b, parameters.odd_b))
    if not any(effects.drift or effects.pulsation or effects.jump or odd.creep for effects, odd in both):
        return setpoints
    return setpoints + np.column_stack([shift(times, effects, odd) for effects, odd in both])
