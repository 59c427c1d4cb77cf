"""The constant-force device: two opposing cylinders and the contact force that they make."""

from __future__ import annotations

from dataclasses import dataclass

from cfd_pneumatic.model.cylinder import Cylinder, CylinderState

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
class DeviceState:
    """Pressures of both cylinders; B is None in a single-cylinder device."""

    a: CylinderState
    b: CylinderState | None


@dataclass(frozen=True)
class Device:
    """Two opposing cylinders on one piston, or one against ambient (B is None): +x grows A and shrinks B."""

    a: Cylinder
    b: Cylinder | None
    geometry: ForceGeometry

    def at_rest(self, setpoint_a: float, setpoint_b: float) -> DeviceState:
        """Return the equilibrium at absolute set-points [Pa]."""
        b = None if self.b is None else CylinderState.at_rest(setpoint_b)
        return DeviceState(CylinderState.at_rest(setpoint_a), b)

    def step(
        self, state: DeviceState, duration: float, rate: float, setpoint_a: float, setpoint_b: float
    ) -> DeviceState:
        """Return the state `duration` seconds later at a piston rate [m/s] and absolute set-points [Pa]."""
        a = self.a.step(state.a, duration, DIRECTIONS['cylinder_a'] * rate, setpoint_a)
        if self.b is None or state.b is None:
            return DeviceState(a, None)
        return DeviceState(a, self.b.step(state.b, duration, DIRECTIONS['cylinder_b'] * rate, setpoint_b))

    def contact_force(self, state: DeviceState) -> float:
        """Return the force on the workpiece [N]."""
        return self.geometry.contact_force(state.a.p, state.b.p if state.b else None)
