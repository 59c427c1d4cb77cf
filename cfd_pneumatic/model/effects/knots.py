# SPDX-License-Identifier: Apache-2.0
"""Knots: how a curve that data have drawn runs through its heights, and the parameters that say so."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

KNOTS = 17
"""How many values a curve has."""


@inlined
def height(at, runs_on, low, high, middle, crowd, heights):
    """Return the height of a curve: the slopes of all pieces, as far as `at` is along each; it may run on beyond."""
    at = where(runs_on, at, min(max(at, low), high))
    share = (at - middle) / where(at > middle, high - middle, middle - low)
    place = 0.5 * (KNOTS - 1) * (1.0 + share * (1.0 + crowd) / (abs(share) + crowd))
    height = heights[0] + (heights[1] - heights[0]) * min(place, 1.0)
    for knot in range(1, KNOTS - 2):
        height += (heights[knot + 1] - heights[knot]) * min(max(place - knot, 0.0), 1.0)
    return height + (heights[KNOTS - 1] - heights[KNOTS - 2]) * max(place - (KNOTS - 2), 0.0)


def choice(name: str, what: str, names: tuple[str, ...]) -> EffectParameter:
    """Return the parameter that chooses among names by their number."""
    numbered = ', '.join(f'{number} {name}' for number, name in enumerate(names))
    return EffectParameter(name, '-', 0.0, len(names) - 1.0, 0.0, f'{what}: {numbered}', choice=True)


PARAMETERS = (
    EffectParameter('low', '-', -1e9, 1e9, -1.0, 'where it begins, in the unit of what it depends on', choice=True),
    EffectParameter('high', '-', -1e9, 1e9, 1.0, 'where it ends, likewise', choice=True),
    EffectParameter('middle', '-', -1e9, 1e9, 0.0, 'about which the knots crowd, likewise', choice=True),
    EffectParameter(
        'crowd', '-', 1e-3, 1e6, 1e6, 'share of the range about its middle within which they do', choice=True
    ),
    *(
        EffectParameter(f'w{number}', '-', -1e12, 1e12, 0.0, f'height at knot {number}, in the unit of where it enters')
        for number in range(KNOTS)
    ),
)
"""Of a curve: where its knots are, then the heights there."""
