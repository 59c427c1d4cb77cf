"""Positional leakage: a seal that lifts near one end of the stroke, perhaps in one direction of travel only."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel


@kernel
def chamber(rate, moment, conductance, position, width, end, direction):
    """Return the outlet pressure's rate [Pa/s]."""
    if direction * moment.rate < 0.0:
        return rate
    opening = min(max(end * (moment.x - position) / width, 0.0), 1.0)
    return rate - conductance * opening * (moment.p - moment.ambient)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a leak at either end of the stroke, in either direction of travel or both."""
    low, high = data['x_low'], data['x_high']
    stroke = high - low
    conductance = data['k_sv'] * data['residual'] / data['gauge'] * 3.0
    return [
        (conductance, (high if end > 0.0 else low) - end * 0.3 * stroke, 0.2 * stroke, end, direction)
        for end in (1.0, -1.0)
        for direction in (0.0, 1.0, -1.0)
    ]


EFFECT = Effect(
    name='positional_leakage',
    description='a leak to ambient that opens with position near one end of the stroke',
    parameters=(
        EffectParameter(
            'conductance', '1/s', 0.0, 1e3, 0.0, 'share of the gauge pressure lost in a second, fully open'
        ),
        EffectParameter('position', 'm', -1.0, 1.0, 0.0, 'displacement at which it begins to open'),
        EffectParameter('width', 'm', 1e-5, 1.0, 1.0, 'displacement over which it opens', logarithmic=True),
        EffectParameter('end', '-', -1.0, 1.0, 1.0, '1: opens towards larger displacement, -1: smaller', choice=True),
        EffectParameter(
            'direction',
            '-',
            -1.0,
            1.0,
            0.0,
            'leaks while the chamber grows (1), shrinks (-1) or always (0)',
            choice=True,
        ),
    ),
    starts=starts,
)
