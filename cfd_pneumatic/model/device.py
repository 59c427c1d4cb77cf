"""The constant-force device: two opposing cylinders and the contact force that they make."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.model.composed import FORCE_STATES, SLID, rest_force, step_force
from cfd_pneumatic.model.cylinder import Cylinder, CylinderState
from cfd_pneumatic.model.effects import FORCE_EFFECTS
from cfd_pneumatic.model.extended import Movement, check_effects
from cfd_pneumatic.model.places import FORCE_PLACES, all_force_parameters, force_switches

DIRECTIONS = {'cylinder_a': 1.0, 'cylinder_b': -1.0}
"""Sign with which the displacement +x grows each cylinder's volume."""


@dataclass(frozen=True)
class ForceGeometry:
    """
    How pressures become contact force.

    Attributes
    ----------
    area
        Piston area of either cylinder [m^2].
    geometric_factor
        Contact force over piston force, from the linkage [-].
    ambient_pressure
        Pressure that takes cylinder B's place where there is only one [Pa].

    """

    area: float
    geometric_factor: float
    ambient_pressure: float

    def contact_force(self, pressure_a: float, pressure_b: float | None) -> float:
        """Return the force on the workpiece [N] from absolute pressures [Pa]; B is None in a single cylinder."""
        opposing = self.ambient_pressure if pressure_b is None else pressure_b
        return (pressure_a - opposing) * self.area * self.geometric_factor

    def setpoints(self, force: float, bias: float, single: bool) -> tuple[float, float]:
        """
        Return gauge set-points (A, B) [Pa] that give a contact force at rest.

        Two cylinders share the difference about the `bias` pressure [Pa]; a single one takes it all.
        """
        difference = force / (self.area * self.geometric_factor)
        if single:
            return difference, 0.0
        return bias + 0.5 * difference, bias - 0.5 * difference


@dataclass(frozen=True)
class ForceState:
    """
    What makes the contact force beside the pressures, while an effect on it is on.

    Attributes
    ----------
    effects
        Names of those that are on.
    values
        States in the composed kernel's order: those of the effects, then the displacement that the seals slid to [m].
    moved
        The piston's movement that ended here.
    contact_force
        On the workpiece, along +x [N].

    """

    effects: frozenset[str]
    values: tuple[float, ...]
    moved: Movement
    contact_force: float


class DeviceState(NamedTuple):
    """States of both cylinders and of the force; B is None in a single-cylinder device, the force without effects."""

    a: CylinderState
    b: CylinderState | None
    force: ForceState | None = None

    @property
    def is_finite(self) -> bool:
        """Whether it is made of finite numbers; effects can be so strong that it isn't."""
        forces = () if self.force is None else (*self.force.values, self.force.contact_force)
        return self.a.is_finite and (self.b is None or self.b.is_finite) and all(map(math.isfinite, forces))


@dataclass(frozen=True)
class Device:
    """
    Two opposing cylinders on one piston, or one against ambient (B is None): +x grows A and shrinks B.

    Attributes
    ----------
    a, b
        The cylinders.
    geometry
        Makes the contact force from their pressures.
    force_effects
        Parameters of each effect on the contact force that is on, by its name.
    seal_play
        Half of the play with which the seals follow the displacement [m]: to and fro within it they don't slide. A
        seal forgets how it is stretched within a few reversals, and a sensor's last bit reverses at every sample.

    Raises
    ------
    ValueError
        If there is no such effect on the force, or it has another number of parameters.

    """

    a: Cylinder
    b: Cylinder | None
    geometry: ForceGeometry
    force_effects: Mapping[str, Sequence[float]] = field(default_factory=dict)
    seal_play: float = 0.0

    def __post_init__(self) -> None:
        """Check the effects."""
        check_effects(self.force_effects, FORCE_EFFECTS, 'force')

    def at_rest(self, setpoint_a: float, setpoint_b: float, position: float = 0.0) -> DeviceState:
        """Return the equilibrium at absolute set-points [Pa], the piston resting at a displacement [m]."""
        a = self.a.at_rest(setpoint_a, DIRECTIONS['cylinder_a'] * position)
        b = None if self.b is None else self.b.at_rest(setpoint_b, DIRECTIONS['cylinder_b'] * position)
        still = Movement(0.0, math.inf, position, position)
        return self._with_force(DeviceState(a, b), still, None)

    def step(self, state: DeviceState, movement: Movement, setpoint_a: float, setpoint_b: float) -> DeviceState:
        """
        Return the state after a movement of the piston, +x growing A, at absolute set-points [Pa].

        To effects on the force its speed is the mean over the movement, which is that of half a step before. The
        acceleration is the change of this speed from the movement before, over the time from the middle of that one to
        the middle of this; it comes a step late, and is zero in a first movement. An effect that was not on in `state`
        starts at rest there.
        """
        a = self.a.step(state.a, movement.along(DIRECTIONS['cylinder_a']), setpoint_a)
        b = None
        if self.b is not None and state.b is not None:
            b = self.b.step(state.b, movement.along(DIRECTIONS['cylinder_b']), setpoint_b)
        return self._with_force(DeviceState(a, b), movement, state.force)

    def _with_force(self, state: DeviceState, movement: Movement, before: ForceState | None) -> DeviceState:
        """Return a state with the force that effects make after a movement to it."""
        if not self.force_effects:
            return state
        values = np.empty(FORCE_STATES + 1)
        rest_force(movement.begin, values)
        acceleration = 0.0
        if before is not None:
            values[SLID] = before.values[SLID]
            for name in self.force_effects.keys() & before.effects:
                own = FORCE_PLACES[name].states
                values[own] = before.values[own]
            apart = 0.5 * (before.moved.duration + movement.duration)
            acceleration = (movement.rate - before.moved.rate) / apart
        geometry = self.geometry
        force = step_force(
            movement.time,
            float(min(max(values[SLID], movement.end - self.seal_play), movement.end + self.seal_play)),
            movement.rate,
            acceleration,
            state.a.p,
            state.b.p if state.b else geometry.ambient_pressure,
            geometry.ambient_pressure,
            geometry.area * geometry.geometric_factor,
            values,
            all_force_parameters(self.force_effects),
            force_switches(self.force_effects),
        )
        own_state = ForceState(frozenset(self.force_effects), tuple(values.tolist()), movement, force)
        return state._replace(force=own_state)

    def contact_force(self, state: DeviceState) -> float:
        """Return the force on the workpiece [N]: the chambers' pressures make it, not the sensors' readings."""
        if state.force is not None:
            return state.force.contact_force
        return self.geometry.contact_force(state.a.p, state.b.p if state.b else None)
