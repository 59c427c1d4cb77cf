# SPDX-License-Identifier: Apache-2.0
"""
Recordings of devices with something wrong with them, drawn at random, and what is wrong kept apart.

::

    from studies.panel import LIBRARY, baseline_rmse, draw, oracle_rmse

    drawn = draw('leakage', 'surface_following', seed=7)
    drawn.recording                              # arrays as the sensors give them, and nothing else
    drawn.truth.effects, drawn.truth.strengths   # for whoever judges an answer
    baseline_rmse(drawn) / oracle_rmse(drawn)    # whether anybody could have seen it

The same seed draws the same device, schedule and noise whatever the effect, so that ``draw(None, ...)`` is its healthy
twin.
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
from studies.panel.strengths import EFFECTS, FOREIGN, LIBRARY, ON_FORCE
from studies.panel.textbook import Gains

__all__ = [
    'CLASSES',
    'EFFECTS',
    'FOREIGN',
    'LIBRARY',
    'MAKES',
    'NOISES',
    'ON_FORCE',
    'OWN_WAYS',
    'STRANGE',
    'STRANGE_FORCE',
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
