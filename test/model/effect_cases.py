# SPDX-License-Identifier: Apache-2.0
"""Strong cases of each effect on the pressure: the starting points that a search takes."""

import pytest
from reference import AMBIENT, PSI

from cfd_pneumatic.model import TABLE_1
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS

GAINS = tuple(TABLE_1.table[0, 1:])
DATA = {
    'k_x': GAINS[0],
    'k_sv': GAINS[1],
    'k_v': GAINS[2],
    'tau': GAINS[3],
    'residual': 200.0,
    'gauge': 5.0 * PSI,
    'highest_pressure': AMBIENT + 6.0 * PSI,
    'x_low': 0.0,
    'x_high': 1.5e-3,
    'period': 0.002,
    'duration': 0.5,
    'largest_charge': 2e5,
    'largest_exhaust': 3e4,
    'slow_frequency': 1.5,
    'speed': 0.02,
    'lag': 0.004,
    'setpoint_lag': 0.03,
}
"""What a search would know of the stroke of these tests."""

_OWN = [(name, own) for name, effect in PRESSURE_EFFECTS.items() for own in effect.starts(DATA)]
_OWN.append(('transport_delay', (-0.003,)))
CASES = [pytest.param(name, own, id=f'{name}-{index}') for index, (name, own) in enumerate(_OWN)]
"""Name and parameters of one effect each."""
