# SPDX-License-Identifier: Apache-2.0
"""
Physical effects that a healthy device lacks, by their strengths; no effect acts by default.

Flows and valves are simulated in `physics`, the path of a command in `command`, disturbances of the set pressure in
`rig`, lines and sensors in `transmission`. References are Richer and Hurmuzlu (2000) for lines and valves, Carneiro and
de Almeida (2006) for heat, ISO 6358-1:2013 for orifices.
"""

from __future__ import annotations

from typing import NamedTuple


class Effects(NamedTuple):
    """The effects in one cylinder, its regulator, its line and its pressure sensor."""

    leak_conductance: float = 0.0
    """Sonic conductance of a hole from the cylinder to ambient [m^3/(s Pa)]."""

    leak_admittance: float = 0.0
    """Laminar leak from the cylinder to ambient [kg/(s Pa)]."""

    lift_admittance: float = 0.0
    """Laminar leak past the fully lifted seal [kg/(s Pa)]."""

    lift_position: float = 0.0
    """Position at which the seal has lifted half way [m]; positive where the cylinder is large."""

    lift_width: float = 1e-4
    """Length of the stroke over which the seal lifts [m]."""

    lift_end: float = 1.0
    """End of the stroke at which the seal lifts: 1 at large volume, -1 at small volume."""

    lift_direction: float = 0.0
    """Direction of travel in which the seal lifts: 1 while the cylinder grows, -1 while it shrinks, 0 both."""

    line_resistance: float = 0.0
    """Laminar resistance of the line from regulator to cylinder [Pa s/kg]."""

    outlet_volume: float = 4e-6
    """Volume between regulator and resistance [m^3]; used only with a `line_resistance`."""

    dead_band: float = 0.0
    """Largest error of either sign at which neither valve opens [Pa]: an overlap, or a stiff diaphragm."""

    play: float = 0.0
    """Half width of the backlash between diaphragm and valves [Pa]."""

    valve_exponent: float = 1.0
    """Exponent of the error in the valves' opening."""

    valve_pivot: float = 1500.0
    """Error at which the opening does not depend on `valve_exponent` [Pa]."""

    poppet_frequency: float = 0.0
    """Natural frequency of the valve's moving mass on its spring [Hz]; 0 for a valve without mass."""

    poppet_damping: float = 0.3
    """Damping ratio of the valve's moving mass."""

    droop: float = 0.0
    """Decrease of the regulated pressure for each unit of mass flow [Pa s/kg]."""

    droop_lag: float = 0.1
    """Time constant of the droop [s]."""

    heat_transfer: float = 0.0
    """Heat flow from wall to air [W/K]; 0 for the polytropic change of state of a healthy device."""

    stirring: float = 0.0
    """Relative increase of the heat flow for each metre per second of the piston [s/m]."""

    command_dead_time: float = 0.0
    """Dead time between the commanded and the acting set pressure [s]."""

    command_lag: float = 0.0
    """Time constant with which the acting set pressure follows the command [s]."""

    drift: float = 0.0
    """Drift of the set pressure [Pa/s]."""

    pulsation: float = 0.0
    """Amplitude of a periodic change of the set pressure [Pa], as a compressor causes."""

    pulsation_frequency: float = 1.0
    """Frequency of the periodic change [Hz]."""

    pulsation_phase: float = 0.0
    """Phase of the periodic change at time 0 [rad]."""

    jump: float = 0.0
    """Unintended jump of the set pressure [Pa]."""

    jump_time: float = 0.0
    """Time of the jump [s]."""

    resonance_frequency: float = 0.0
    """Natural frequency of the line to the pressure sensor [Hz]; 0 for a line without resonance."""

    resonance_damping: float = 0.1
    """Damping ratio of the line's resonance."""

    sensor_lag: float = 0.0
    """Time constant of the pressure sensor [s]."""

    hum: float = 0.0
    """Amplitude of the mains in the pressure signal [Pa]."""

    hum_frequency: float = 50.0
    """Frequency of the mains [Hz]."""

    hum_phase: float = 0.0
    """Phase of the mains at time 0 [rad]."""


class Pickup(NamedTuple):
    """Faults of the displacement sensor and the load cell."""

    displacement_lag: float = 0.0
    """Time constant of the displacement sensor [s]."""

    displacement_delay: float = 0.0
    """Dead time of the displacement sensor [s]."""

    force_offset: float = 0.0
    """Reading of the load cell without load [N]."""
