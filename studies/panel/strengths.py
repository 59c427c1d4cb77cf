# SPDX-License-Identifier: Apache-2.0
"""
Define the panel's effects: the changes of a device, and the ranges of strengths.

The distribution of strengths is uniform on a logarithmic scale. The weakest strength is hardly visible in the longest
schedule. All effects change cylinder A.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import ADIABATIC_EXPONENT, ELLIPSE, LEAK_CRITICAL_RATIO, SPECIFIC_HEAT, orifice_flow
from studies.panel.situation import Changes, Effect, Situation
from studies.panel.strange import STRANGE


def _setter(field: str) -> Callable[[float, Situation], Changes]:
    """Return a function that sets a field of the rig to the strength."""
    return lambda strength, _: {field: strength}


def _setter_either_sign(field: str) -> Callable[[float, Situation], Changes]:
    """Return a function that sets a field of the rig to plus or minus the strength."""
    return lambda strength, situation: {field: strength * situation.sign()}


def leakage(share: float, situation: Situation) -> Changes:
    """Lower the resting pressure by a share of the gauge pressure, through a gap or through a hole."""
    gauge, air = situation.reference_gauge, situation.specimen.rig.air
    flow = situation.gains.k_sv * share * gauge * situation.mass_per_pressure
    if situation.rng.random() < 0.5:
        return {'effects_a.leak_admittance': flow / gauge}
    probe = 1e-12
    leaked = orifice_flow(
        probe, gauge + air.ambient_pressure, air.ambient_pressure, LEAK_CRITICAL_RATIO, ELLIPSE, air.temperature
    )
    return {'effects_a.leak_conductance': probe * flow / leaked}


def positional_leakage(share: float, situation: Situation) -> Changes:
    """Let the seal lift somewhere within the schedule's stroke, in both directions or in one."""
    low, high = float(np.min(situation.schedule.positions)), float(np.max(situation.schedule.positions))
    return {
        'effects_a.lift_admittance': situation.gains.k_sv * share * situation.mass_per_pressure,
        'effects_a.lift_position': low + situation.rng.uniform(0.3, 0.7) * (high - low),
        'effects_a.lift_width': situation.between(5e-5, 3e-4),
        'effects_a.lift_end': situation.sign(),
        'effects_a.lift_direction': float(situation.rng.choice([-1.0, 0.0, 1.0])),
    }


def line_resonance(frequency: float, situation: Situation) -> Changes:
    """Let the line to the pressure sensor ring."""
    damping = situation.between(0.05, 0.3)
    return {'effects_a.resonance_frequency': frequency, 'effects_a.resonance_damping': damping}


def line_restriction(time_constant: float, situation: Situation) -> Changes:
    """Narrow the line from regulator to cylinder, so that the cylinder fills with a time constant."""
    return {
        'effects_a.line_resistance': time_constant / situation.mass_per_pressure,
        'effects_a.outlet_volume': 0.08 * situation.specimen.rig.cylinder_a.rest_volume,
    }


def nonlinear_valve(bend: float, situation: Situation) -> Changes:
    """Let the valves open with a power of the error, below or above 1."""
    exponent = math.exp(bend * situation.sign())
    return {'effects_a.valve_exponent': exponent, 'effects_a.valve_pivot': situation.between(1e3, 3e3)}


def flow_saturation(error: float, situation: Situation) -> Changes:
    """Let each valve be fully open at a separate error."""
    cylinder = situation.specimen.rig.cylinder_a
    return {
        'cylinder_a.supply_conductance': cylinder.supply_gain * error,
        'cylinder_a.relief_conductance': cylinder.relief_gain * error * situation.between(0.5, 2.0),
    }


def heat_transfer(time_constant: float, situation: Situation) -> Changes:
    """Let the air exchange heat with the wall, without a change of the initial stiffness."""
    cylinder, air = situation.specimen.rig.cylinder_a, situation.specimen.rig.air
    volume = cylinder.rest_volume * ADIABATIC_EXPONENT / cylinder.polytropic_exponent
    mass = cylinder.reference_pressure * volume / (air.gas_constant * air.temperature)
    return {'cylinder_a.rest_volume': volume, 'effects_a.heat_transfer': mass * SPECIFIC_HEAT / time_constant}


def set_point_drift(total: float, situation: Situation) -> Changes:
    """Let the set pressure drift by a total over the recording."""
    return {'effects_a.drift': total / situation.schedule.duration * situation.sign()}


def _pulsating(amplitude: float, slowest: float, fastest: float, situation: Situation) -> Changes:
    return {
        'effects_a.pulsation': amplitude,
        'effects_a.pulsation_frequency': situation.between(slowest, fastest),
        'effects_a.pulsation_phase': situation.rng.uniform(0.0, 2.0 * math.pi),
    }


def supply_variation(amplitude: float, situation: Situation) -> Changes:
    """Let the compressor's cycle, 0.2 to 2.5 Hz and at least a cycle per recording, modulate the set pressure."""
    return _pulsating(amplitude, max(0.2, 1.0 / situation.schedule.duration), 2.5, situation)


def droop(lead: float, situation: Situation) -> Changes:
    """Let the set pressure fall with the lagged flow."""
    return {'effects_a.droop': lead / situation.mass_per_pressure, 'effects_a.droop_lag': situation.between(0.03, 0.2)}


def seal_friction(coulomb: float, situation: Situation) -> Changes:
    """Let the seals rub."""
    return {
        'seal.coulomb': coulomb,
        'seal.coulomb_per_pressure': coulomb * situation.rng.uniform(0.0, 1e-5),
        'seal.viscous': situation.between(1.0, 20.0),
        'seal.presliding': situation.between(2e-5, 3e-4),
    }


def stribeck_friction(breakaway: float, situation: Situation) -> Changes:
    """Let the seals rub more at low speed."""
    return {
        'seal.breakaway': breakaway,
        'seal.stribeck_speed': situation.between(3e-3, 2e-2),
        'seal.presliding': situation.between(5e-6, 3e-5),
    }


def moving_mass(mass: float, situation: Situation) -> Changes:
    """Give the piston a mass, in half of the cases on an incline."""
    inclination = situation.rng.uniform(-0.5, 0.5) * math.pi if situation.rng.random() < 0.5 else 0.0
    return {'piston.mass': mass, 'piston.inclination': inclination}


def poppet_inertia(slowness: float, situation: Situation) -> Changes:
    """Give the valve a mass; at slowness 1 the regulator's loop would oscillate."""
    damping = situation.between(0.2, 0.5)
    gains = situation.gains
    limit = math.sqrt(gains.k_sv / (2.0 * damping * gains.tau)) / (2.0 * math.pi)
    return {'effects_a.poppet_frequency': limit / slowness, 'effects_a.poppet_damping': damping}


def pulsation(amplitude: float, situation: Situation) -> Changes:
    """Let the set pressure pulsate at 6 to 20 Hz."""
    return _pulsating(amplitude, 6.0, 20.0, situation)


def set_point_jump(size: float, situation: Situation) -> Changes:
    """Let the set pressure jump once, unrecorded, in the middle of the recording."""
    duration = situation.schedule.duration
    return {
        'effects_a.jump': size * situation.sign(),
        'effects_a.jump_time': duration * situation.rng.uniform(0.3, 0.7),
    }


def mains_hum(amplitude: float, situation: Situation) -> Changes:
    """Add mains hum to the pressure signal."""
    return {
        'effects_a.hum': amplitude,
        'effects_a.hum_frequency': float(situation.rng.choice([50.0, 60.0])),
        'effects_a.hum_phase': situation.rng.uniform(0.0, 2.0 * math.pi),
    }


LIBRARY = {
    'leakage': Effect(0.0002, 0.05, '1', 'fall of the resting pressure, in gauge pressures', leakage),
    'positional_leakage': Effect(
        0.0003, 0.05, '1', 'fall with the seal lifted, in gauge pressures', positional_leakage
    ),
    'transport_delay': Effect(0.0005, 0.015, 's', 'dead time', _setter_either_sign('clock.delay')),
    'sensor_lag': Effect(0.0005, 0.015, 's', 'time constant', _setter('effects_a.sensor_lag')),
    'line_resonance': Effect(200.0, 40.0, 'Hz', 'natural frequency', line_resonance),
    'line_restriction': Effect(
        0.0005, 0.008, 's', 'time constant of the cylinder filling through the line', line_restriction
    ),
    'valve_dead_band': Effect(30.0, 1500.0, 'Pa', 'half the band', _setter('effects_a.dead_band')),
    'valve_hysteresis': Effect(30.0, 1500.0, 'Pa', 'half the backlash', _setter('effects_a.play')),
    'nonlinear_valve': Effect(0.03, 0.6, '1', 'logarithm of the exponent, either way', nonlinear_valve),
    'flow_saturation': Effect(12000.0, 600.0, 'Pa', 'error at which the supply valve is fully open', flow_saturation),
    'operating_point': Effect(1.0, 1.0, '1', 'dependence on pressure', _setter('cylinder_a.pressure_dependence')),
    'volume_variation': Effect(1.0, 1.0, '1', 'dependence on position', _setter('cylinder_a.position_dependence')),
    'heat_transfer': Effect(1.0, 0.03, 's', "time constant to the wall's temperature", heat_transfer),
    'lost_motion': Effect(1e-05, 0.0003, 'm', 'gap', _setter('piston.lost_motion')),
    'displacement_lag': Effect(0.0005, 0.01, 's', 'time constant', _setter('pickup.displacement_lag')),
    'displacement_delay': Effect(0.025, 0.1, 's', 'dead time', _setter('pickup.displacement_delay')),
    'set_point_drift': Effect(50.0, 2000.0, 'Pa', 'drift over the recording', set_point_drift),
    'supply_variation': Effect(30.0, 1000.0, 'Pa', 'amplitude in the set pressure', supply_variation),
    'droop': Effect(0.0006, 0.02, 's', 'fall of the set pressure per rate at which the regulator fills', droop),
}
"""Effects of the library, which an identification should name."""

ON_FORCE = {
    'seal_friction': Effect(0.05, 5.0, 'N', 'Coulomb friction without pressure', seal_friction),
    'stribeck_friction': Effect(0.1, 5.0, 'N', 'additional friction at low speed', stribeck_friction),
    'force_offset': Effect(0.05, 5.0, 'N', 'offset', _setter_either_sign('pickup.force_offset')),
    'moving_mass': Effect(0.03, 0.4, 'kg', 'mass', moving_mass),
}
"""Effects on the force that an identification should name."""

ON_COMMAND = {
    'setpoint_delay': Effect(0.015, 0.06, 's', 'dead time', _setter('effects_a.command_dead_time')),
    'setpoint_lag': Effect(0.015, 0.06, 's', 'time constant', _setter('effects_a.command_lag')),
}
"""Effects on the commanded set-point that an identification should name; only steps of the set-point show them."""

WEAK_ON_COMMAND = (0.001, 0.015)
"""Range of strengths at which an effect on the command may not be visible [s]."""

FOREIGN = {
    'poppet_inertia': Effect(0.25, 0.75, '1', 'slowness of the valve; at 1 the loop oscillates', poppet_inertia),
    'pulsation': Effect(30.0, 1000.0, 'Pa', 'amplitude in the set pressure', pulsation),
    'set_point_jump': Effect(50.0, 2000.0, 'Pa', 'height', set_point_jump),
    'mains_hum': Effect(20.0, 500.0, 'Pa', 'amplitude', mains_hum),
    'fast_clock': Effect(3e-05, 0.01, '1', 'gain of the clock', _setter('clock.gain')),
}
"""Effects outside the library, which an identification should report as unexplained."""

EFFECTS = {**LIBRARY, **ON_FORCE, **ON_COMMAND, **FOREIGN, **STRANGE}
"""All effects of the panel by name."""


def install(name: str, situation: Situation, strength: float | None = None) -> tuple[float, Changes]:
    """
    Return an effect's strength and its changes of the device; draw the strength if none is given.

    Raises
    ------
    InputError
        If there is no such effect.

    """
    effect = EFFECTS.get(name)
    if effect is None:
        raise InputError(f'effect {name!r} is not known. Use one of {", ".join(EFFECTS)}.')
    drawn = situation.between(effect.weakest, effect.strongest)
    strength = drawn if strength is None else strength
    return strength, effect.install(strength, situation)
