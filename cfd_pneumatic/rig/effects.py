# SPDX-License-Identifier: Apache-2.0
"""
What a healthy device lacks: physical effects by their strengths, none of which acts by default.

Each field is read in one place: the flows and the valve in `physics`, the regulator's setting in `device`, what
lies between the air and its sensor in `transmission`. References are Richer and Hurmuzlu (2000) for lines and valves,
Carneiro and de Almeida (2006) for heat, ISO 6358-1:2013 for orifices.
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
    """Laminar leak past the seal where it has lifted altogether [kg/(s Pa)]."""

    lift_position: float = 0.0
    """Position at which the seal has lifted half way [m], in the direction in which the cylinder grows."""

    lift_width: float = 1e-4
    """Length of the stroke over which the seal lifts [m]."""

    lift_end: float = 1.0
    """End of the stroke at which it lifts: 1 with the cylinder large, -1 with it small."""

    lift_direction: float = 0.0
    """Travel during which it lifts: 1 while the cylinder grows, -1 while it shrinks, 0 both ways."""

    line_resistance: float = 0.0
    """Laminar resistance of the line from regulator to cylinder [Pa s/kg]."""

    outlet_volume: float = 4e-6
    """Volume between regulator and resistance [m^3]; counts only with a `line_resistance`."""

    dead_band: float = 0.0
    """Error to either side of which neither valve opens [Pa]: an overlap, or a diaphragm that doesn't yield."""

    play: float = 0.0
    """Half the width of the play between diaphragm and valves [Pa]."""

    valve_exponent: float = 1.0
    """Power of the error that the valves' opening follows."""

    valve_pivot: float = 1500.0
    """Error at which the opening is the same for each `valve_exponent` [Pa]."""

    poppet_frequency: float = 0.0
    """Natural frequency of the valve's moving mass on its spring [Hz]; 0 for a valve without mass."""

    poppet_damping: float = 0.3
    """Damping ratio of the same."""

    droop: float = 0.0
    """How much the regulator gives way to its flow [Pa s/kg]."""

    droop_lag: float = 0.1
    """Time constant with which it does [s]."""

    heat_transfer: float = 0.0
    """Heat flow from wall to air [W/K]; 0 for the polytropic change of state of a healthy device."""

    stirring: float = 0.0
    """By how much more heat flows for each metre per second of the piston [s/m]."""

    drift: float = 0.0
    """Drift of the set pressure [Pa/s]."""

    pulsation: float = 0.0
    """Amplitude of a periodic change of the set pressure [Pa], as a compressor brings about."""

    pulsation_frequency: float = 1.0
    """Its frequency [Hz]."""

    pulsation_phase: float = 0.0
    """Its phase at time 0 [rad]."""

    jump: float = 0.0
    """Change of the set pressure that nobody asked for [Pa]."""

    jump_time: float = 0.0
    """When it comes [s]."""

    resonance_frequency: float = 0.0
    """Natural frequency of the line to the pressure sensor [Hz]; 0 for a line without resonance."""

    resonance_damping: float = 0.1
    """Its damping ratio."""

    sensor_lag: float = 0.0
    """Time constant of the pressure sensor [s]."""

    hum: float = 0.0
    """Amplitude of the mains in the pressure signal [Pa]."""

    hum_frequency: float = 50.0
    """Frequency of the mains [Hz]."""

    hum_phase: float = 0.0
    """Phase of the mains at time 0 [rad]."""


class Pickup(NamedTuple):
    """What is wrong with the displacement sensor and the load cell."""

    displacement_lag: float = 0.0
    """Time constant of the displacement sensor [s]."""

    displacement_delay: float = 0.0
    """Dead time of the displacement sensor [s]."""

    force_offset: float = 0.0
    """Reading of the load cell without load [N]."""
