# SPDX-License-Identifier: Apache-2.0
"""Positional leakage: a seal lifts near an end of the stroke, in both directions of travel or in one."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import OFFSETS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanewise import tanh


@inlined
def chamber(rate, moment, conductance, position, width, speed, end, direction):
    """Return the outlet pressure's rate [Pa/s]."""
    opening = 0.5 * (1.0 + tanh(end * (moment.x - position) / width))
    opening *= 1.0 - 0.5 * abs(direction) * (1.0 - tanh(direction * moment.rate / speed))
    return rate - moment.dense * conductance * opening * (moment.p - moment.ambient)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return leaks at each end of the stroke, in each direction of travel and in both."""
    low, high = data['x_low'], data['x_high']
    stroke = high - low
    conductance = 3.0 * data['k_sv'] * data['residual'] / data['gauge']
    return [
        (conductance, (high if end > 0.0 else low) - end * 0.4 * stroke, 0.1 * stroke, data['speed'], end, direction)
        for end in (1.0, -1.0)
        for direction in (0.0, 1.0, -1.0)
    ]


EFFECT = Effect(
    name='positional_leakage',
    description='a leak to ambient that opens with position near one end of the stroke',
    inspect='the cylinder wall and the seal, near the end of the stroke',
    parameters=(
        EffectParameter('conductance', '1/s', 0.0, 1e3, 0.0, 'share of the gauge pressure lost per second, fully open'),
        EffectParameter(
            'position', 'm', -1.0, 1.0, 0.0, 'displacement at which the leak is half open', on_stroke='place'
        ),
        EffectParameter(
            'width', 'm', 1e-5, 1.0, 1.0, 'displacement over which the leak opens', logarithmic=True, on_stroke='length'
        ),
        EffectParameter(
            'speed',
            'm/s',
            1e-5,
            1.0,
            1e-2,
            'speed at which the seal lifts; not used if direction is 0',
            logarithmic=True,
        ),
        EffectParameter(
            'end', '-', -1.0, 1.0, 1.0, '1: opens towards larger displacement, -1: towards smaller', choice=True
        ),
        EffectParameter(
            'direction',
            '-',
            -1.0,
            1.0,
            0.0,
            'leaks while the chamber grows (1), while it shrinks (-1), or always (0)',
            choice=True,
        ),
    ),
    equations=(
        r"\dot p' = \dot p - conductance\;o\,l\,(p - p_0)",
        r'o = \tfrac{1}{2} \left(1 + \tanh\frac{end\,(x - position)}{width}\right)',
        r'l = 1 - \tfrac{1}{2}\,|direction| \left(1 - \tanh\frac{direction\;\dot x}{speed}\right)',
    ),
    starts=starts,
    shown_by='strokes from end to end at two set-points, with a rest at each end',
    seen_against='displacement',
    families=(OFFSETS,),
    moves_rest=True,
)
