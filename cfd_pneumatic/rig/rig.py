# SPDX-License-Identifier: Apache-2.0
"""The rig with its state: it is moved and returns pressures and a force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import physics
from cfd_pneumatic.rig.command import CommandPath
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.oddities import Oddities
from cfd_pneumatic.rig.parameters import RigParameters, checked
from cfd_pneumatic.rig.piston import Linkage

LONGEST_STEP = 5e-5
"""Longest integration step [s]."""


@dataclass(frozen=True, eq=False)
class Truth:
    """True values at a number of times, without sensors."""

    times: Array
    """Time since the rig was at rest [s], (n,)."""

    displacement: Array
    """Position of the tool, which is that of the piston without lost motion [m], (n,)."""

    velocity: Array
    """Velocity of the tool [m/s], (n,)."""

    acceleration: Array
    """Acceleration of the piston [m/s^2], (n,)."""

    pressures: Array
    """Absolute pressure in the cylinders A and B [Pa], (n, 2)."""

    sensed_pressures: Array
    """Absolute pressure in the regulators' control chambers [Pa], (n, 2)."""

    setpoints: Array
    """Absolute set pressure that is commanded to the regulators until each time [Pa], (n, 2)."""

    force: Array
    """Force on the workpiece along +x [N], (n,)."""

    def every_nth(self, stride: int) -> Truth:
        """Return the last of every `stride` times."""
        return Truth(**{name: values[stride - 1 :: stride] for name, values in vars(self).items()})


class Rig:
    """
    Two opposing, pressure-regulated cylinders with a driven piston.

    The rig starts at rest with both cylinders at their set-points.

    Parameters
    ----------
    setpoints
        Set pressure of the cylinders A and B, gauge [Pa].
    parameters
        Parameters of the rig.
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
        Position and velocity of the piston [m, m/s].

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
        self._commands = [CommandPath(pressure) for pressure in resting.tolist()]
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
        Move the piston from knot to knot and return the true values at each knot.

        Parameters
        ----------
        positions, velocities : (knots,)
            Position [m] and velocity [m/s] of the piston at each knot; cubic in between.
        setpoints : (2,) or (knots, 2)
            Set pressure of the cylinders until each knot, gauge [Pa].
        period
            Time between knots [s].

        Raises
        ------
        InputError
            If a position exceeds the travel, or a set-point is not between vacuum and supply pressure.

        """
        reached = self._reachable(np.atleast_1d(np.asarray(positions, dtype=float)))
        knots = len(reached)
        levels = np.ascontiguousarray(np.broadcast_to(self._absolute(np.asarray(setpoints, dtype=float)), (knots, 2)))
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
            _disturbed(self._acting(levels, period), times - 0.5 * period, self.parameters),
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
            setpoints=levels,
            force=forces,
        )

    def _acting(self, commands: Array, period: float) -> Array:
        """Return the set pressures that act on both cylinders from the commanded ones [Pa], (n, 2)."""
        effects = (self.parameters.effects_a, self.parameters.effects_b)
        acting = [self._commands[index].carry(commands[:, index], period, effects[index]) for index in range(2)]
        return np.ascontiguousarray(np.column_stack(acting))

    def _reachable(self, positions: Array) -> Array:
        travel = self.parameters.piston.travel
        if not np.all(np.abs(positions) <= travel):
            raise InputError(
                f'a displacement of {np.max(np.abs(positions)) * 1e3:g} mm is out of reach: the piston travels '
                f'{travel * 1e3:g} mm to either side; give smaller displacements'
            )
        return positions

    def _absolute(self, setpoints: Array) -> Array:
        air = self.parameters.air
        absolute = setpoints + air.ambient_pressure
        if not np.all((absolute > 0.0) & (absolute < air.supply_pressure)):
            raise InputError(
                f'a set-point must be between vacuum and the supply, {-air.ambient_pressure:.6g} to '
                f'{air.supply_pressure - air.ambient_pressure:.6g} Pa gauge, is {setpoints.tolist()}'
            )
        return absolute


def setpoint_disturbance(times: Array, effects: Effects, odd: Oddities) -> Array:
    """Return the error of a set pressure [Pa] at given times [s], (n,)."""
    phases = 2.0 * np.pi * effects.pulsation_frequency * times + effects.pulsation_phase
    jump = np.where(times >= effects.jump_time, effects.jump, 0.0)
    creep = odd.creep * -np.expm1(-np.maximum(times, 0.0) / odd.creep_time)
    return effects.drift * times + effects.pulsation * np.sin(phases) + jump + creep


def _disturbed(setpoints: Array, times: Array, parameters: RigParameters) -> Array:
    """Return the set pressures of both cylinders with their disturbances [Pa] at given times [s], (n, 2)."""
    both = ((parameters.effects_a, parameters.odd_a), (parameters.effects_b, parameters.odd_b))
    if not any(effects.drift or effects.pulsation or effects.jump or odd.creep for effects, odd in both):
        return setpoints
    return setpoints + np.column_stack([setpoint_disturbance(times, effects, odd) for effects, odd in both])
