# SPDX-License-Identifier: Apache-2.0
"""Knots of an estimated curve: the interpolation between heights, and the parameters."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

KNOTS = 17
"""Number of knots of a curve."""


@inlined
def height(variable, runs_on, low, high, middle, crowd, heights):
    """Return the height of a curve at a value of its variable; `runs_on` extrapolates beyond the knots linearly."""
    variable = where(runs_on, variable, min(max(variable, low), high))
    share = (variable - middle) / where(variable > middle, high - middle, middle - low)
    place = 0.5 * (KNOTS - 1) * (1.0 + share * (1.0 + crowd) / (abs(share) + crowd))
    height = heights[0] + (heights[1] - heights[0]) * min(place, 1.0)
    for knot in range(1, KNOTS - 2):
        height += (heights[knot + 1] - heights[knot]) * min(max(place - knot, 0.0), 1.0)
    return height + (heights[KNOTS - 1] - heights[KNOTS - 2]) * max(place - (KNOTS - 2), 0.0)


def choice(name: str, meaning: str, names: tuple[str, ...]) -> EffectParameter:
    """Return a parameter whose values are the numbers of names."""
    numbered = ', '.join(f'{number} {name}' for number, name in enumerate(names))
    return EffectParameter(name, '-', 0.0, len(names) - 1.0, 0.0, f'{meaning}: {numbered}', choice=True)


PARAMETERS = (
    EffectParameter('low', '-', -1e9, 1e9, -1.0, 'first knot, in the unit of the variable', choice=True),
    EffectParameter('high', '-', -1e9, 1e9, 1.0, 'last knot, in the unit of the variable', choice=True),
    EffectParameter('middle', '-', -1e9, 1e9, 0.0, 'middle knot, in the unit of the variable', choice=True),
    EffectParameter(
        'crowd',
        '-',
        1e-3,
        1e6,
        1e6,
        'share of the range within which knots are concentrated about the middle',
        choice=True,
    ),
    *(
        EffectParameter(
            f'w{number}',
            '-',
            -1e12,
            1e12,
            0.0,
            f'height at knot {number}, in the unit of the place where the curve acts',
        )
        for number in range(KNOTS)
    ),
)
"""Parameters of a curve: positions of the knots, then heights at the knots."""
