# SPDX-License-Identifier: Apache-2.0
"""The constant-force device: two opposing cylinders and their contact force."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.model.composed import FORCE_STATES, SLID, set_force_to_rest, step_force
from cfd_pneumatic.model.cylinder import Cylinder, CylinderState
from cfd_pneumatic.model.effects import FORCE_PARTS
from cfd_pneumatic.model.extended import Movement, check_effects
from cfd_pneumatic.model.places import FORCE_PLACES, all_force_parameters, force_switches

DIRECTIONS = {'cylinder_a': 1.0, 'cylinder_b': -1.0}
"""Sign with which the displacement +x grows each cylinder's volume."""


@dataclass(frozen=True)
class ForceGeometry:
    """
    Areas and factors that convert pressures to contact force.

    Attributes
    ----------
    area
        Piston area of either cylinder [m^2].
    geometric_factor
        Contact force / piston force of the linkage [-].
    ambient_pressure
        Absolute pressure in place of a missing cylinder [Pa].

    """

    area: float
    geometric_factor: float
    ambient_pressure: float

    def contact_force(self, pressure_a: float, pressure_b: float) -> float:
        """Return the force on the workpiece [N] from absolute pressures [Pa]."""
        return (pressure_a - pressure_b) * self.area * self.geometric_factor


@dataclass(frozen=True)
class ForceState:
    """
    State of the effects on the contact force, while one is on.

    Attributes
    ----------
    effects
        Names of the effects that are on.
    values
        States in the composed kernel's order: those of the effects, then the displacement of the seals [m].
    moved
        The piston's last movement.
    contact_force
        Force on the workpiece, along +x [N].

    """

    effects: frozenset[str]
    values: tuple[float, ...]
    moved: Movement
    contact_force: float


class DeviceState(NamedTuple):
    """States of both cylinders and of the force; None for a missing cylinder and for a force without effects."""

    a: CylinderState | None
    b: CylinderState | None
    force: ForceState | None = None

    @property
    def is_finite(self) -> bool:
        """Whether all numbers are finite; strong effects can make the state diverge."""
        forces = () if self.force is None else (*self.force.values, self.force.contact_force)
        cylinders = (cylinder for cylinder in (self.a, self.b) if cylinder is not None)
        return all(cylinder.is_finite for cylinder in cylinders) and all(map(math.isfinite, forces))

    @property
    def readings(self) -> tuple[float, ...]:
        """Readings of the pressure sensors of the present cylinders, absolute [Pa]."""
        return tuple(cylinder.reading for cylinder in (self.a, self.b) if cylinder is not None)


@dataclass(frozen=True)
class DeviceModel:
    """
    Two opposing cylinders on one piston, or one cylinder against ambient pressure; +x grows A and shrinks B.

    Attributes
    ----------
    a, b
        The cylinders; None if missing.
    geometry
        Converts pressures to contact force.
    force_effects
        Parameters of each effect on the contact force that is on, by its name.
    seal_play
        Half of the backlash with which the seals follow the displacement [m]. The backlash keeps the last bit of a
        displacement sensor, which reverses at every sample, from resetting the stretch of the seals.

    Raises
    ------
    ValueError
        If there is no cylinder, an effect is not an effect on the force, or has a wrong number of parameters.

    """

    a: Cylinder | None
    b: Cylinder | None
    geometry: ForceGeometry
    force_effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    seal_play: float = 0.0

    def __post_init__(self) -> None:
        """Check the cylinders and the effects."""
        if not self.cylinders:
            raise ValueError('a device must have at least one cylinder, but a and b are None')
        check_effects(self.force_effects, FORCE_PARTS, 'force')

    @property
    def cylinders(self) -> dict[str, Cylinder]:
        """The present cylinders, by name."""
        return {name: cylinder for name, cylinder in zip(DIRECTIONS, (self.a, self.b)) if cylinder is not None}

    def setpoints(self, force: float, bias: float) -> tuple[float, float]:
        """
        Return gauge set-points (A, B) [Pa] that give a contact force [N] at rest.

        Two cylinders share the pressure difference about `bias` [Pa]; a single cylinder takes the whole difference.
        """
        difference = force / (self.geometry.area * self.geometry.geometric_factor)
        if self.b is None:
            return difference, 0.0
        if self.a is None:
            return 0.0, -difference
        return bias + 0.5 * difference, bias - 0.5 * difference

    def at_rest(self, setpoint_a: float, setpoint_b: float, position: float = 0.0) -> DeviceState:
        """Return the equilibrium at absolute set-points [Pa], the piston resting at a displacement [m]."""
        a = None if self.a is None else self.a.at_rest(setpoint_a, DIRECTIONS['cylinder_a'] * position)
        b = None if self.b is None else self.b.at_rest(setpoint_b, DIRECTIONS['cylinder_b'] * position)
        still = Movement(0.0, math.inf, position, position)
        return self._with_force(DeviceState(a, b), still, None)

    def step(self, state: DeviceState, movement: Movement, setpoint_a: float, setpoint_b: float) -> DeviceState:
        """
        Return the state after a movement of the piston, +x growing A, at absolute set-points [Pa].

        Effects on the force use the mean speed over the movement, which is the speed half a step earlier. Their
        acceleration is the change of the mean speed since the movement before, divided by the time between the middles
        of both movements. The acceleration lags by a step and is zero in a first movement. An effect that was not on
        in `state` starts at rest.
        """
        a = b = None
        if self.a is not None and state.a is not None:
            a = self.a.step(state.a, movement.along(DIRECTIONS['cylinder_a']), setpoint_a)
        if self.b is not None and state.b is not None:
            b = self.b.step(state.b, movement.along(DIRECTIONS['cylinder_b']), setpoint_b)
        return self._with_force(DeviceState(a, b), movement, state.force)

    def _with_force(self, state: DeviceState, movement: Movement, before: ForceState | None) -> DeviceState:
        """Return a state with the contact force after a movement, with effects on the force."""
        if not self.force_effects:
            return state
        values = np.empty(FORCE_STATES + 1)
        set_force_to_rest(movement.begin, values)
        acceleration = 0.0
        if before is not None:
            values[SLID] = before.values[SLID]
            for name in self.force_effects.keys() & before.effects:
                states = FORCE_PLACES[name].states
                values[states] = before.values[states]
            elapsed = 0.5 * (before.moved.duration + movement.duration)
            acceleration = (movement.rate - before.moved.rate) / elapsed
        geometry = self.geometry
        force = step_force(
            movement.time,
            float(min(max(values[SLID], movement.end - self.seal_play), movement.end + self.seal_play)),
            movement.rate,
            acceleration,
            *self._pressures(state),
            geometry.ambient_pressure,
            geometry.area * geometry.geometric_factor,
            values,
            all_force_parameters(self.force_effects),
            force_switches(self.force_effects),
        )
        force_state = ForceState(frozenset(self.force_effects), tuple(values.tolist()), movement, force)
        return state._replace(force=force_state)

    def contact_force(self, state: DeviceState) -> float:
        """Return the force on the workpiece [N], from the pressures in the chambers and not from readings."""
        if state.force is not None:
            return state.force.contact_force
        return self.geometry.contact_force(*self._pressures(state))

    def _pressures(self, state: DeviceState) -> tuple[float, float]:
        """Return the absolute pressures in A and B, ambient pressure for a missing cylinder [Pa]."""
        ambient = self.geometry.ambient_pressure
        return state.a.p if state.a else ambient, state.b.p if state.b else ambient
