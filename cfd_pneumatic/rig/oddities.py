# SPDX-License-Identifier: Apache-2.0
"""
Unknown characteristics that no textbook has, for tests of the search for an unknown characteristic.

None acts by default. Those of the cylinders are simulated in `physics`, a creep of the set pressure in `rig`, and those
of the pressure sensor and the load cell in `transmission`.
"""

from __future__ import annotations

from typing import NamedTuple


class Oddities(NamedTuple):
    """Oddities of a cylinder, its regulator and its pressure sensor; positions [m] grow with the volume."""

    bulge: float = 0.0
    """Relative increase of the bore's area in the middle of a bulge [-]."""

    bulge_position: float = 0.0
    """Position of the middle of the bulge [m]."""

    bulge_length: float = 5e-4
    """Half the length over which the bulge falls to exp(-1) [m]."""

    one_way: float = 0.0
    """Relative increase of the swept volume outwards, and decrease inwards [-]: a rolling seal."""

    soft: float = 0.0
    """Relative increase of the chamber above a pressure [-]: a soft wall."""

    soft_pressure: float = 7e4
    """Gauge pressure at half the increase [Pa]."""

    soft_width: float = 4e3
    """Width of the pressure range of the increase [Pa]."""

    lifting: float = 0.0
    """Leak of a seal that lifts at speed [kg/(s Pa)]."""

    lifting_speed: float = 1e-2
    """Speed at half the leak [m/s]."""

    pop: float = 0.0
    """Leak of a relief valve beyond its opening pressure [kg/(s Pa)]."""

    pop_pressure: float = 7e4
    """Gauge pressure at which the relief valve opens [Pa]."""

    groove: float = 0.0
    """Relative increase of the valves' opening about an error of either sign [-]: a worn seat."""

    groove_error: float = 1e3
    """Error at the largest increase [Pa]."""

    groove_width: float = 4e2
    """Distance from `groove_error` at which the increase has fallen to exp(-1) [Pa]."""

    port: float = 0.0
    """Suction of flowing air at the control port [Pa]; negative: pressure."""

    port_speed: float = 2e-2
    """Speed of the piston at 63 % of the suction [m/s]."""

    starving: float = 0.0
    """Loss of supply pressure in the hose for each unit of mass flow [Pa s/kg]."""

    starving_lag: float = 0.1
    """Time constant of the hose [s]."""

    ledge: float = 0.0
    """Difference of the set pressure between the ends of the stroke [Pa]."""

    ledge_position: float = 0.0
    """Position at half the difference [m]."""

    ledge_length: float = 3e-4
    """Length of stroke over which the set pressure changes [m]."""

    creep: float = 0.0
    """Final creep of the set pressure [Pa]."""

    creep_time: float = 3.0
    """Time constant of the creep [s]."""

    kink: float = 0.0
    """Relative excess of the reading above `kink_pressure` [-]."""

    kink_pressure: float = 7e4
    """Gauge pressure of the kink [Pa]."""

    tilt: float = 0.0
    """Amplitude of a reading error that is periodic along the stroke [Pa]."""

    tilt_length: float = 2e-3
    """Length of stroke from crest to crest [m]."""


class ForceOddities(NamedTuple):
    """Oddities of the piston's guide and the load cell."""

    scar: float = 0.0
    """Friction in the middle of a scar in the bore [N]."""

    scar_position: float = 0.0
    """Position of the middle of the scar [m]."""

    scar_length: float = 4e-4
    """Distance from the middle at which the friction has fallen to exp(-1) [m]."""

    bend: float = 0.0
    """Relative decrease of the load cell's reading for each newton [1/N]."""

    bundle: float = 0.0
    """Stiffness of cables beyond their slack [N/m]."""

    bundle_slack: float = 5e-4
    """Displacement to either side at which the cables are tight [m]."""
