# SPDX-License-Identifier: Apache-2.0
"""
Define unknown characteristics: characteristics that no library has, invented before the search for them was written.

`CLASSES` lists the right places and variables of each. Places that no recording can distinguish count as equally right:
a valve error that is larger everywhere equals a higher set-point. Seeds below 1,000 are for developing a search, seeds
from 7,000 on for reporting it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from studies.panel.situation import Changes, Effect, Situation

Install = Callable[[float, Situation], Changes]

_SPEED = 0.02  # of a fast stroke [m/s]


def _place(situation: Situation) -> tuple[float, float]:
    """Draw a position well within the stroke, and a length [m]."""
    low, high = float(np.min(situation.schedule.positions)), float(np.max(situation.schedule.positions))
    return low + situation.rng.uniform(0.3, 0.7) * (high - low), (high - low) * situation.between(0.1, 0.3)


def _gauge(situation: Situation) -> float:
    """Draw a gauge pressure that the schedule passes [Pa]."""
    levels = situation.schedule.setpoints[:, 0]
    return float(np.mean(levels) + situation.rng.uniform(-0.5, 0.5) * max(np.ptp(levels), 4e3))


def bulge(share: float, situation: Situation) -> Changes:
    """Let the bore be larger, or smaller, somewhere along the stroke."""
    place, length = _place(situation)
    return {'odd_a.bulge': share * situation.sign(), 'odd_a.bulge_position': place, 'odd_a.bulge_length': length}


def one_way(share: float, situation: Situation) -> Changes:
    """Let a seal roll, so that outward and return strokes sweep different volumes."""
    return {'odd_a.one_way': share * situation.sign()}


def soft_wall(share: float, situation: Situation) -> Changes:
    """Let the chamber be larger above a pressure than below."""
    width = situation.between(2e3, 8e3)
    return {'odd_a.soft': share * situation.sign(), 'odd_a.soft_pressure': _gauge(situation), 'odd_a.soft_width': width}


def swimming_seal(share: float, situation: Situation) -> Changes:
    """Let the seal leak at speed."""
    admittance = situation.gains.k_sv * share * situation.mass_per_pressure
    return {'odd_a.lifting': admittance, 'odd_a.lifting_speed': _SPEED * situation.between(0.2, 2.0)}


def pop_valve(share: float, situation: Situation) -> Changes:
    """Let a relief valve open above a pressure."""
    admittance = situation.gains.k_v * share * situation.mass_per_pressure
    return {'odd_a.pop': admittance, 'odd_a.pop_pressure': _gauge(situation) - 3e3}


def worn_seat(share: float, situation: Situation) -> Changes:
    """Let the valves open more, or less, near an error."""
    error = situation.between(300.0, 3e3)
    return {
        'odd_a.groove': share * situation.sign(),
        'odd_a.groove_error': error,
        'odd_a.groove_width': error * situation.between(0.2, 0.6),
    }


def rushing_air(pressure: float, situation: Situation) -> Changes:
    """Let fast air at the control port lower, or raise, the set pressure."""
    return {'odd_a.port': pressure * situation.sign(), 'odd_a.port_speed': _SPEED * situation.between(0.3, 3.0)}


def starving_supply(fall: float, situation: Situation) -> Changes:
    """Let a thin hose lower the supply pressure with the lagged flow; `fall` is at a fast stroke's flow."""
    flow = situation.gains.k_x * _SPEED * situation.mass_per_pressure
    return {'odd_a.starving': fall / flow, 'odd_a.starving_lag': situation.between(0.03, 0.5)}


def ledge(height: float, situation: Situation) -> Changes:
    """Let the set pressure be higher at one end of the stroke, because the hose pulls at the regulator."""
    place, length = _place(situation)
    return {'odd_a.ledge': height * situation.sign(), 'odd_a.ledge_position': place, 'odd_a.ledge_length': length}


def creep(height: float, situation: Situation) -> Changes:
    """Let the set pressure creep to its final value."""
    duration = situation.schedule.duration
    return {'odd_a.creep': height * situation.sign(), 'odd_a.creep_time': duration * situation.between(0.08, 0.25)}


def kinked_sensor(share: float, situation: Situation) -> Changes:
    """Let the pressure sensor have a different gain above a pressure."""
    return {'odd_a.kink': share * situation.sign(), 'odd_a.kink_pressure': _gauge(situation)}


def tilting_sensor(amplitude: float, situation: Situation) -> Changes:
    """Let the reading of the pressure oscillate along the stroke."""
    span = float(np.ptp(situation.schedule.positions))
    return {'odd_a.tilt': amplitude, 'odd_a.tilt_length': span * situation.between(0.3, 0.9)}


def scarred_bore(friction: float, situation: Situation) -> Changes:
    """Let the piston rub somewhere along the stroke."""
    place, length = _place(situation)
    return {
        'odd_force.scar': friction,
        'odd_force.scar_position': place,
        'odd_force.scar_length': length,
        'seal.presliding': situation.between(2e-5, 1e-4),
    }


def bent_cell(share: float, situation: Situation) -> Changes:
    """Let the load cell lose sensitivity with load; `share` is the loss at 50 N."""
    return {'odd_force.bend': share / 50.0 * situation.sign()}


def cable_bundle(force: float, situation: Situation) -> Changes:
    """Let cables pull beyond their slack; `force` is the pull 1 mm beyond the slack."""
    return {'odd_force.bundle': force / 1e-3, 'odd_force.bundle_slack': situation.between(2e-4, 8e-4)}


STRANGE = {
    'bulge': Effect(0.01, 0.3, '1', 'share by which the bore is larger or smaller', bulge),
    'one_way': Effect(0.01, 0.3, '1', 'share by which the outward stroke sweeps more or less', one_way),
    'soft_wall': Effect(0.02, 0.5, '1', 'share by which the chamber is larger or smaller', soft_wall),
    'swimming_seal': Effect(0.003, 0.3, '1', 'fall of pressure at high speed, in gauge pressures', swimming_seal),
    'pop_valve': Effect(0.01, 1.0, '1', "conductance, in the relief valve's gains", pop_valve),
    'worn_seat': Effect(0.2, 0.9, '1', 'share by which the valves are wider or less wide open', worn_seat),
    'rushing_air': Effect(50.0, 5e3, 'Pa', 'suction at high speed', rushing_air),
    'starving_supply': Effect(5e3, 2e5, 'Pa', "fall of the supply pressure at a fast stroke's flow", starving_supply),
    'ledge': Effect(50.0, 3e3, 'Pa', 'height', ledge),
    'creep': Effect(50.0, 3e3, 'Pa', 'height', creep),
    'kinked_sensor': Effect(0.01, 0.3, '1', 'share', kinked_sensor),
    'tilting_sensor': Effect(20.0, 1e3, 'Pa', 'amplitude', tilting_sensor),
    'scarred_bore': Effect(0.1, 8.0, 'N', 'friction in the middle of the scar', scarred_bore),
    'bent_cell': Effect(0.01, 0.3, '1', 'share at 50 N', bent_cell),
    'cable_bundle': Effect(0.2, 20.0, 'N', 'pull at 1 mm beyond the slack', cable_bundle),
}
"""Unknown characteristics by name."""

CLASSES = {
    'bulge': {('gain', 'x')},
    'one_way': {('gain', 'direction'), ('gain', 'speed')},
    'soft_wall': {('stiffness', 'p'), ('gain', 'p'), ('flow', 'p'), ('chamber', 'p')},
    'swimming_seal': {('chamber', 'speed'), ('gain', 'speed'), ('set_point', 'speed')},
    'pop_valve': {('chamber', 'p'), ('flow', 'p'), ('set_point', 'p')},
    'worn_seat': {('flow', 'error'), ('chamber', 'error'), ('set_point', 'error')},
    'rushing_air': {('set_point', 'speed'), ('chamber', 'speed'), ('gain', 'speed')},
    'starving_supply': {('flow', 'flow'), ('flow', 'time')},
    'ledge': {('set_point', 'x'), ('chamber', 'x')},
    'creep': {('set_point', 'time')},
    'kinked_sensor': {('sensing', 'p')},
    'tilting_sensor': {('sensing', 'x')},
    'scarred_bore': {('friction', 'x')},
    'bent_cell': {('cell', 'force')},
    'cable_bundle': {('force', 'x')},
}
"""Right places and variables of each characteristic; an answer with one of the pairs is right."""

STRANGE_FORCE = ('scarred_bore', 'bent_cell', 'cable_bundle')
"""Unknown characteristics of the contact force."""
