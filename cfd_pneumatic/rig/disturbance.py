# SPDX-License-Identifier: Apache-2.0
"""What acts on a regulator's set pressure besides the hand that sets it: drift, creep, pulsation, a jump."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.effects import Effects
from cfd_pneumatic.rig.oddities import Oddities
from cfd_pneumatic.rig.parameters import RigParameters


def shift(times: Array, effects: Effects, odd: Oddities) -> Array:
    """Return by how much a set pressure is off at some times [s], in Pa."""
    phases = 2.0 * np.pi * effects.pulsation_frequency * times + effects.pulsation_phase
    jumped = np.where(times >= effects.jump_time, effects.jump, 0.0)
    crept = odd.creep * -np.expm1(-np.maximum(times, 0.0) / odd.creep_time)
    return effects.drift * times + effects.pulsation * np.sin(phases) + jumped + crept


def disturbed(setpoints: Array, times: Array, parameters: RigParameters) -> Array:
    """Return the set pressures of both cylinders that act at some times [s], in Pa, (n, 2)."""
    both = ((parameters.effects_a, parameters.odd_a), (parameters.effects_b, parameters.odd_b))
    if not any(effects.drift or effects.pulsation or effects.jump or odd.creep for effects, odd in both):
        return setpoints
    return setpoints + np.column_stack([shift(times, effects, odd) for effects, odd in both])
