# SPDX-License-Identifier: Apache-2.0
"""Leakage: air escapes from the chamber to ambient, through a gap (laminar) or through a hole (an orifice)."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import OFFSETS, Data, Effect, EffectParameter
from cfd_pneumatic.model.flow_function import relative_flow
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where


@inlined
def chamber(rate, moment, conductance, orifice):
    """Return the outlet pressure's rate [Pa/s]."""
    through_hole = moment.p * relative_flow(moment.ambient / moment.p)
    through_gap = moment.p - moment.ambient
    return rate - moment.dense * conductance * where(orifice > 0.0, through_hole, through_gap)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return a laminar leak and an orifice that each shift the pressure at rest by the residual's size."""
    lost = data['k_sv'] * data['residual']
    return [(lost / data['gauge'], 0.0), (lost / data['highest_pressure'], 1.0)]


EFFECT = Effect(
    name='leakage',
    description='air escapes from the chamber to ambient',
    inspect='the piston seal and the fittings of the chamber',
    parameters=(
        EffectParameter(
            'conductance',
            '1/s',
            0.0,
            1e2,
            0.0,
            'share of the gauge pressure (orifice: of the absolute pressure) lost per second',
        ),
        EffectParameter('orifice', '-', 0.0, 1.0, 0.0, '0: laminar gap, 1: orifice by ISO 6358', choice=True),
    ),
    equations=(
        r"\dot p' = \dot p - conductance\,(p - p_0) \quad \text{where } orifice = 0",
        r"\dot p' = \dot p - conductance\;p\,\psi(p_0 / p) \quad \text{where } orifice = 1",
    ),
    starts=starts,
    shown_by='rest at two set-points well apart',
    seen_against='pressure',
    families=(OFFSETS,),
    moves_rest=True,
)
