"""One pressure-regulated cylinder: stepped sample by sample, or over a whole recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.model.parameters import OperatingPoints
from cfd_pneumatic.model.propagation import advance, interpolate_gains, propagate, propagate_sensitivities

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CylinderState:
    """Outlet pressure p and sensed pressure p_f, absolute [Pa]."""

    p: float
    p_f: float

    @classmethod
    def at_rest(cls, setpoint: float) -> CylinderState:
        """Return the equilibrium p = p_f = p_d at an absolute set-point [Pa]."""
        return cls(setpoint, setpoint)


@dataclass(frozen=True)
class Cylinder:
    """
    A cylinder and its regulator: equations (8) and (12) with scheduled gains.

    Attributes
    ----------
    parameters
        Gains over the gauge set-point.
    ambient_pressure
        What a gauge set-point is counted from [Pa].

    """

    parameters: OperatingPoints
    ambient_pressure: float

    def step(self, state: CylinderState, duration: float, rate: float, setpoint: float) -> CylinderState:
        """
        Return the state `duration` seconds later.

        Parameters
        ----------
        state
            Pressures now [Pa].
        duration
            Length of the step [s].
        rate
            Speed at which the piston grows the chamber [m/s].
        setpoint
            Absolute set-point that acts over the step [Pa].

        """
        gains = interpolate_gains(self.parameters.table, setpoint - self.ambient_pressure)
        return CylinderState(*advance(state.p, state.p_f, duration, rate, setpoint, *gains))

    def simulate(self, times: Array, displacement: Array, setpoint: Array, state: CylinderState | None = None) -> Array:
        """
        Return the outlet pressure [Pa] at each sample, shape (n,).

        Parameters
        ----------
        times
            Increasing, shape (n,) [s].
        displacement
            Displacement that grows the chamber, linear between samples, shape (n,) [m].
        setpoint
            Absolute set-point, shape (n,) [Pa]; entry i acts on the step that ends at sample i.
        state
            Pressures at the first sample; by default at rest at the first set-point.

        """
        start = state or CylinderState.at_rest(setpoint[0])
        pressure = np.empty_like(times)
        propagate(
            times,
            displacement,
            setpoint,
            self.parameters.table,
            self.ambient_pressure,
            np.array([start.p, start.p_f]),
            pressure,
        )
        return pressure


def simulate_with_sensitivities(
    gains: Array, times: Array, displacement: Array, setpoint: Array, start: float = 0.0
) -> tuple[Array, Array]:
    """
    Return the outlet pressure [Pa], shape (n,), and its derivatives, shape (n, 6), at constant gains.

    Parameters
    ----------
    gains
        k_x [Pa/m], k_sv, k_v [1/s], tau [s], shape (4,).
    times, displacement, setpoint
        As in `Cylinder.simulate`.
    start
        What both pressures lie above the first set-point at the first sample [Pa].

    The columns are by the four gains, by a shift of the set-point and by `start`.
    """
    pressure = np.empty_like(times)
    jacobian = np.empty((times.size, 6))
    state = np.full(2, setpoint[0] + start)
    propagate_sensitivities(times, displacement, setpoint, gains, state, pressure, jacobian)
    return pressure, jacobian
