# SPDX-License-Identifier: Apache-2.0
"""Supply variation: the supply pressure oscillates and moves the regulated pressure."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanewise import wave


@inlined
def setpoint(p_d, moment, in_phase, quadrature, frequency):
    """Return the set-point that acts [Pa]."""
    sine, cosine = wave(frequency * moment.time)
    return p_d + in_phase * sine + quadrature * cosine


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the strongest slow oscillation of the residual, in two phases."""
    amplitude = 0.5 * data['residual']
    return [(amplitude, amplitude, data['slow_frequency']), (-amplitude, amplitude, data['slow_frequency'])]


EFFECT = Effect(
    name='supply_variation',
    description='a slow oscillation of the supply pressure moves the regulated pressure',
    inspect='the compressor, and other consumers on the supply',
    parameters=(
        EffectParameter('in_phase', 'Pa', -1e5, 1e5, 0.0, 'amplitude of the sine'),
        EffectParameter('quadrature', 'Pa', -1e5, 1e5, 0.0, 'amplitude of the cosine'),
        EffectParameter('frequency', 'Hz', 1e-2, 3.0, 1.0, 'frequency of the oscillation', logarithmic=True),
    ),
    equations=(r"p_d' = p_d + in_phase \sin(2 \pi\,frequency\,t) + quadrature \cos(2 \pi\,frequency\,t)",),
    starts=starts,
    shown_by='a long recording at one set-point',
    seen_against='frequency',
    of_time=True,
    rank=40,
)
