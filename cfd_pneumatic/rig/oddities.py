# SPDX-License-Identifier: Apache-2.0
"""
What no textbook has, and a device may do all the same: laws for those who look for a law that they don't know.

None acts by default. Those of the cylinders are in `physics`, but for the set pressure's (`device`) and the
pressure sensor's (`transmission`), which also has the load cell's.
"""

from __future__ import annotations

from typing import NamedTuple


class Oddities(NamedTuple):
    """Those of one cylinder, its regulator and its pressure sensor; positions [m] count as its volume grows."""

    bulge: float = 0.0
    """Share by which the bore is larger in the middle of a bulge [-]."""

    bulge_position: float = 0.0
    """Where that is [m]."""

    bulge_length: float = 5e-4
    """Half the length over which the bulge falls to exp(-1) [m]."""

    one_way: float = 0.0
    """Share by which more volume is swept outwards than is seen, and less inwards [-]: a seal that rolls."""

    soft: float = 0.0
    """Share by which the chamber is larger above a pressure than below [-]: a wall that bulges."""

    soft_pressure: float = 7e4
    """Gauge pressure half way [Pa]."""

    soft_width: float = 4e3
    """Pressure within which it goes by the most of it [Pa]."""

    lifting: float = 0.0
    """Leak of a seal that swims at speed [kg/(s Pa)]."""

    lifting_speed: float = 1e-2
    """Speed at which half of it leaks [m/s]."""

    pop: float = 0.0
    """Leak of a relief valve beyond its opening pressure [kg/(s Pa)]."""

    pop_pressure: float = 7e4
    """Gauge pressure at which it opens [Pa]."""

    groove: float = 0.0
    """Share by which the valves are wider open about an error, either way [-]: a worn seat."""

    groove_error: float = 1e3
    """The error [Pa]."""

    groove_width: float = 4e2
    """Distance from it at which the share has fallen to exp(-1) [Pa]."""

    port: float = 0.0
    """Suction at the control port where air rushes past [Pa]; negative: pressure."""

    port_speed: float = 2e-2
    """Speed of the piston at which 63 % of it is reached [m/s]."""

    starving: float = 0.0
    """What is lost of the supply pressure on the way, by the flow that is drawn [Pa s/kg]."""

    starving_lag: float = 0.1
    """Time constant within which the hose empties and fills [s]."""

    ledge: float = 0.0
    """By how much the set pressure is higher at one end of the stroke than at the other [Pa]."""

    ledge_position: float = 0.0
    """Where half of it is reached [m]."""

    ledge_length: float = 3e-4
    """Length over which it goes by the most of it [m]."""

    creep: float = 0.0
    """By how much the set pressure creeps in the end [Pa]."""

    creep_time: float = 3.0
    """Time constant of that [s]."""

    kink: float = 0.0
    """Share by which the pressure sensor reads more, of what is above a pressure [-]."""

    kink_pressure: float = 7e4
    """The gauge pressure [Pa]."""

    tilt: float = 0.0
    """Amplitude of a reading that goes up and down along the stroke [Pa]."""

    tilt_length: float = 2e-3
    """Length of stroke from crest to crest [m]."""


class ForceOddities(NamedTuple):
    """Those of the piston's way and the load cell."""

    scar: float = 0.0
    """Friction in the middle of a scar in the bore [N]."""

    scar_position: float = 0.0
    """Where that is [m]."""

    scar_length: float = 4e-4
    """Half the length over which it falls to exp(-1) [m]."""

    bend: float = 0.0
    """Share by which the load cell reads less, for each newton that it bears [1/N]."""

    bundle: float = 0.0
    """Stiffness of cables that are pulled beyond their slack [N/m]."""

    bundle_slack: float = 5e-4
    """Position at which they are tight, to either side [m]."""
