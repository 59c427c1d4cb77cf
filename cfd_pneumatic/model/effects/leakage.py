"""Leakage: air escapes from the chamber to ambient through a constant laminar conductance."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernel import kernel


@kernel
def chamber(rate, moment, conductance):
    """Return the outlet pressure's rate [Pa/s]."""
    return rate - conductance * (moment.p - moment.ambient)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a leak that moves the pressure at rest by the residual's size."""
    return [(data['k_sv'] * data['residual'] / data['gauge'],)]


EFFECT = Effect(
    name='leakage',
    description='air escapes from the chamber to ambient',
    parameters=(EffectParameter('conductance', '1/s', 0.0, 1e2, 0.0, 'share of the gauge pressure lost in a second'),),
    starts=starts,
)
