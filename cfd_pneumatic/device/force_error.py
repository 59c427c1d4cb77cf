# SPDX-License-Identifier: Apache-2.0
"""Error of the contact force of a moving piston, from gains and area."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS, PISTON_AREA
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


def combined_force_per_speed(gains: Mapping[str, Array], force_scale: float) -> ForcePerSpeed:
    """
    Return the size of the contact force's error per piston speed, of all cylinders [N s/m].

    `growing` is the error while chamber A grows: the force is too small. Chamber B then shrinks.

    Parameters
    ----------
    gains
        Gains by cylinder, as in `force_per_speed`.
    force_scale
        Piston area times geometric factor [N/Pa].

    """
    none = ForcePerSpeed(0.0, 0.0)
    a, b = (force_per_speed(gains[name], force_scale) if name in gains else none for name in CYLINDERS)
    return ForcePerSpeed(a.growing + b.shrinking, a.shrinking + b.growing)


def force_per_pressure(geometry: Geometry) -> float:
    """Return piston area times geometric factor [N/Pa]; the default area if the area is not known."""
    area = PISTON_AREA if geometry.area is None else geometry.area
    return area * abs(1.0 if geometry.factor is None else geometry.factor)
