# SPDX-License-Identifier: Apache-2.0
"""
Simulate the paper's model exactly: equations (8) and (12) of Guvenc and Srinivasan, in small steps.

Recordings of the paper's model lack no effect. An effect that is found in such a recording is a false alarm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig import compiled
from cfd_pneumatic.units import PSI_PER_INCH


class Gains(NamedTuple):
    """Gains of a cylinder and its regulator, as in the paper's Table 1."""

    k_x: float
    """Pressure lost per displacement [Pa/m]."""

    k_sv: float
    """Charging [1/s]."""

    k_v: float
    """Discharging [1/s]."""

    tau: float
    """Time constant of the sensed pressure [s]."""


WEAKEST = Gains(14.0 * PSI_PER_INCH, 80.0, 17.0, 6e-3)
"""Lower ends of the random gains: near Table 1, 5 to 15 psig."""

STRONGEST = Gains(22.0 * PSI_PER_INCH, 200.0, 35.0, 13e-3)
"""Upper ends of the random gains."""

LONGEST_STEP = 2e-5
"""Longest integration step [s]."""


def draw_gains(rng: np.random.Generator) -> Gains:
    """Return random gains, uniform on a logarithmic scale about Table 1."""
    return Gains(*np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))).tolist())


@compiled
def rates(outlet: float, sensed: float, setpoint: float, velocity: float, gains: Gains) -> tuple[float, float]:
    """Return dp/dt of equation (12), with its switch corrected, and dp_f/dt of equation (8) [Pa/s]."""
    gain = gains.k_sv if setpoint > sensed else gains.k_v
    return gain * (setpoint - sensed) - gains.k_x * velocity, (outlet - sensed) / gains.tau


@compiled
def integrate(displacement: Array, setpoints: Array, period: float, steps: int, gains: Gains, pressures: Array) -> None:
    """
    Fill in the pressure [Pa] at each knot, from rest, by the classical Runge-Kutta method.

    Displacement (n,) [m] at knots one period [s] apart, linear in between; absolute set-points (n,) [Pa] before each
    knot.
    """
    outlet = sensed = setpoints[0]
    pressures[0] = outlet
    step = period / steps
    half = 0.5 * step
    for knot in range(1, displacement.shape[0]):
        velocity = (displacement[knot] - displacement[knot - 1]) / period
        level = setpoints[knot]
        for _ in range(steps):
            p1, f1 = rates(outlet, sensed, level, velocity, gains)
            p2, f2 = rates(outlet + half * p1, sensed + half * f1, level, velocity, gains)
            p3, f3 = rates(outlet + half * p2, sensed + half * f2, level, velocity, gains)
            p4, f4 = rates(outlet + step * p3, sensed + step * f3, level, velocity, gains)
            outlet += step / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
            sensed += step / 6.0 * (f1 + 2.0 * f2 + 2.0 * f3 + f4)
        pressures[knot] = outlet


def pressure_along(displacement: Array, setpoints: Array, period: float, gains: Gains) -> Array:
    """Return the pressure [Pa] at knots one period [s] apart; see `integrate`."""
    pressures = np.empty(len(displacement))
    steps = int(np.ceil(period / LONGEST_STEP * (1.0 - 1e-9)))
    integrate(np.ascontiguousarray(displacement), np.ascontiguousarray(setpoints), period, steps, gains, pressures)
    return pressures
