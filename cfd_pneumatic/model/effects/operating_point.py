# SPDX-License-Identifier: Apache-2.0
"""Operating point: the gains depend on the absolute pressure by equations (1), (11) and (12)."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.flow_function import relative_flow
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where
from cfd_pneumatic.model.lanewise import power

REFERENCE = 2e5
"""Absolute pressure at which the gains are those of the model [Pa]."""

SMALLEST = 0.1
"""Least share of the choked flow [-]; a supply pressure below the reference would make the gains infinite."""


@inlined
def velocity_gain(k_x, moment, strength, supply, exponent):
    """Return K_x [Pa/m], proportional to absolute pressure."""
    return k_x * power(moment.p / REFERENCE, strength)


@inlined
def flow(value, moment, strength, supply, exponent):
    """Return the pressure rate of the flow [Pa/s]."""
    charging = max(relative_flow(moment.p / supply), SMALLEST) / max(relative_flow(REFERENCE / supply), SMALLEST)
    escaping = max(relative_flow(moment.ambient / moment.p), SMALLEST) / relative_flow(moment.ambient / REFERENCE)
    exhausting = escaping * power(moment.p / REFERENCE, exponent)
    return value * power(where(value < 0.0, exhausting, charging), strength)


@inlined
def time_constant(tau, moment, strength, supply, exponent):
    """Return tau [s], inverse to the density in the aspirator tube, equation (4)."""
    return tau * power(2.0 * REFERENCE / (moment.p + moment.p_f), strength)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return full dependence on the pressure, with a high and a low supply pressure."""
    return [(1.0, 3.0 * data['highest_pressure'], 1.0), (1.0, 1.2 * data['highest_pressure'], 1.0)]


def quickens(pressure: float, x: float, k_x: float, strength: float, supply: float, exponent: float) -> float:
    """Return the largest factor of a gain or of 1/tau at a pressure [Pa]."""
    relative = max(pressure, 1.0) / REFERENCE
    charging = 1.0 / max(relative_flow(REFERENCE / supply), SMALLEST)
    return float(max(charging**strength, relative ** (strength * exponent), relative**strength))


EFFECT = Effect(
    name='operating_point',
    description='gains depend on absolute pressure: K_x linearly, K_sv and K_v by flow function, K_v also by a power',
    inspect='no part: gains that depend on the set-point are no fault',
    parameters=(
        EffectParameter('strength', '-', 0.0, 1.0, 0.0, '0: no dependence, 1: full dependence', choice=True),
        EffectParameter('supply', 'Pa', 1e5, 5e6, 1e6, 'absolute supply pressure', logarithmic=True),
        EffectParameter(
            'exponent', '-', -1.0, 4.0, 1.0, 'exponent of absolute pressure in K_v, in addition to the flow function'
        ),
    ),
    equations=(
        r"K_x' = K_x\,(p / p_R)^{strength}, \qquad \tau' = \tau\,\left(\frac{2\,p_R}{p + p_f}\right)^{strength}",
        r"q' = q\,\left(\frac{\psi(p / supply)}{\psi(p_R / supply)}\right)^{strength} \quad \text{where } q \ge 0",
        r"q' = q\,\left(\frac{\psi(p_0 / p)}{\psi(p_0 / p_R)}\,(p / p_R)^{exponent}\right)^{strength} \text{ else}",
        r'p_R = 200\,\mathrm{kPa}',
    ),
    starts=starts,
    shown_by='strokes at two set-points well apart',
    seen_against='pressure',
    quickens=quickens,
    rank=30,
)
