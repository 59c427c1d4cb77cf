# SPDX-License-Identifier: Apache-2.0
"""Error of the contact force of a moving piston, from gains and area."""

from __future__ import annotations

from typing import NamedTuple

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import PISTON_AREA
from cfd_pneumatic.identification import Geometry


class ForcePerSpeed(NamedTuple):
    """
    Size of the force error of a cylinder at constant piston speed, per speed [N s/m].

    Equation (12) at rest of the pressures: the error of the pressure is K_x / K times the speed, with K_sv while the
    chamber grows and K_v while it shrinks.
    """

    growing: float
    """While the chamber grows: the pressure is below the set-point."""

    shrinking: float
    """While the chamber shrinks: the pressure is above the set-point."""


def force_per_speed(gains: Array, force_scale: float) -> ForcePerSpeed:
    """
    Return the size of the force error per piston speed [N s/m].

    Parameters
    ----------
    gains
        K_x [Pa/m], K_sv [1/s], K_v [1/s] and tau [s], shape (4,).
    force_scale
        Piston area times geometric factor [N/Pa].

    """
    k_x, k_sv, k_v, _ = gains.tolist()
    return ForcePerSpeed(force_scale * k_x / k_sv, force_scale * k_x / k_v)


def force_per_pressure(geometry: Geometry) -> float:
    """Return piston area times geometric factor [N/Pa]; the default area if the area is not known."""
    area = PISTON_AREA if geometry.area is None else geometry.area
    return area * abs(1.0 if geometry.factor is None else geometry.factor)
