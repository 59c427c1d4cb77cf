# SPDX-License-Identifier: Apache-2.0
"""Line resonance: the air in the line to the pressure sensor oscillates."""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import DELAYS, Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where


@inlined
def signal(p, moment, reading, slope, frequency, damping):
    """Return the reading of the pressure sensor [Pa]."""
    return where(frequency >= HIGHEST, p, reading)


@inlined
def evolve(moment, p, reading, slope, frequency, damping):
    """Return the rates of the reading [Pa/s] and of its slope [Pa/s^2]."""
    omega = where(frequency >= HIGHEST, 0.0, 2.0 * math.pi * frequency)
    bending = omega * omega * (p - reading) - 2.0 * damping * omega * slope
    return where(frequency >= HIGHEST, 0.0, slope), bending


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return resonances at shares of the sampling rate."""
    rate = 1.0 / data['period']
    return [(share * rate, 0.2) for share in (0.08, 0.2, 0.4)]


def fastest(speed: float, frequency: float, damping: float) -> float:
    """Return the natural frequency [rad/s]."""
    return 0.0 if frequency >= HIGHEST else 2.0 * math.pi * frequency


HIGHEST = 2e3
"""Frequency above which no resonance is visible [Hz]."""

LOWEST = 10.0
"""Lower bound of a search [Hz]; a quarter of the wavelength is eight metres of line."""

EFFECT = Effect(
    name='line_resonance',
    description='the line to the pressure sensor resonates',
    inspect='the length and the diameter of the line to the pressure sensor',
    parameters=(
        EffectParameter('frequency', 'Hz', 1.0, HIGHEST, HIGHEST, 'natural frequency', logarithmic=True, least=LOWEST),
        # above 0.7 a resonance is not distinguishable from a lag
        EffectParameter('damping', '-', 1e-3, 0.7, 0.7, 'damping ratio', logarithmic=True),
    ),
    equations=(r'\ddot s = \omega^2 (p - s) - 2\,damping\,\omega\,\dot s, \qquad \omega = 2 \pi\,frequency',),
    starts=starts,
    shown_by='abrupt strokes and steps of the set-point',
    shown_at=1000.0,
    seen_against='frequency',
    families=(DELAYS,),
    fastest=fastest,
    states=2,
    follows='signal',
    rests_at_pressure=True,
    rank=70,
)
