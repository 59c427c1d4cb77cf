# SPDX-License-Identifier: Apache-2.0
"""Lost motion: the piston follows the measured displacement with backlash."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import PLAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined


@inlined
def displacement(x, moment, followed, width):
    """Return the piston's displacement [m], which becomes the state of the backlash."""
    return min(max(followed, x - width), x + width)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return backlashes of small shares of the stroke."""
    stroke = data['x_high'] - data['x_low']
    return [(0.005 * stroke,), (0.03 * stroke,)]


EFFECT = Effect(
    name='lost_motion',
    description='backlash between the measured displacement and the piston',
    inspect='the backlash between displacement sensor and piston: joints, mounting',
    parameters=(EffectParameter('width', 'm', 0.0, 0.1, 0.0, 'half of the backlash'),),
    equations=(r"x' \leftarrow \min(\max(x', x - width), x + width)",),
    starts=starts,
    shown_by='many small strokes with reversals',
    seen_against='speed',
    families=(PLAYS,),
    states=1,
    follows='displacement',
    rank=60,
)
