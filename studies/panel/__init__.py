# SPDX-License-Identifier: Apache-2.0
"""
Draw recordings of faulty devices at random; the fault is kept apart from the recording.

::

    from studies.panel import LIBRARY, baseline_rmse, draw, oracle_rmse

    case = draw('leakage', 'surface_following', seed=7)
    case.recording                             # arrays of the sensors

    case.truth.effects, case.truth.strengths   # for scoring an identification
    baseline_rmse(case) / oracle_rmse(case)    # above 1.15: the effect is visible

The same seed draws the same device, schedule and noise for every effect: ``draw(None, ...)`` is the healthy twin.
"""

from studies.panel.drawing import NOISES, Draw, draw, draw_textbook
from studies.panel.floors import (
    baseline_rmse,
    force_baseline_rmse,
    force_oracle_residual,
    force_oracle_rmse,
    oracle_residual,
    oracle_rmse,
)
from studies.panel.makes import MAKES, OWN_WAYS
from studies.panel.strange import CLASSES, STRANGE, STRANGE_FORCE
from studies.panel.strengths import EFFECTS, FOREIGN, LIBRARY, ON_COMMAND, ON_FORCE, WEAK_ON_COMMAND
from studies.panel.textbook import Gains

__all__ = [
    'CLASSES',
    'EFFECTS',
    'FOREIGN',
    'LIBRARY',
    'MAKES',
    'NOISES',
    'ON_COMMAND',
    'ON_FORCE',
    'OWN_WAYS',
    'STRANGE',
    'STRANGE_FORCE',
    'WEAK_ON_COMMAND',
    'Draw',
    'Gains',
    'baseline_rmse',
    'draw',
    'draw_textbook',
    'force_baseline_rmse',
    'force_oracle_residual',
    'force_oracle_rmse',
    'oracle_residual',
    'oracle_rmse',
]
