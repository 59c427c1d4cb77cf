"""Operating point: the gains follow the absolute pressure as equations (1), (11) and (12) say."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.flow_function import passed
from cfd_pneumatic.model.kernel import kernel
from cfd_pneumatic.model.lanes import where
from cfd_pneumatic.model.lanewise import power

REFERENCE = 2e5
"""Absolute pressure at which the gains are the model's own [Pa]."""

SMALLEST = 0.1
"""Share of the choked flow that always passes: a supply below the pressure would make the gains infinite [-]."""


@kernel
def velocity_gain(k_x, moment, strength, supply, exponent):
    """Return K_x [Pa/m], proportional to absolute pressure."""
    return k_x * power(moment.p / REFERENCE, strength)


@kernel
def flow(value, moment, strength, supply, exponent):
    """Return the pressure rate that the flow makes [Pa/s]."""
    reference = passed(REFERENCE / supply)
    charging = max(passed(moment.p / supply), SMALLEST) / max(reference, SMALLEST)
    exhausts = value < 0.0
    relative = where(exhausts, moment.p / REFERENCE, charging)
    return value * power(relative, where(exhausts, strength * exponent, strength))


@kernel
def time_constant(tau, moment, strength, supply, exponent):
    """Return tau [s], inverse to absolute pressure."""
    return tau * power(REFERENCE / moment.p, strength)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return full dependence on the pressure, from a supply well above it and one close to it."""
    return [(1.0, 3.0 * data['highest_pressure'], 1.0), (1.0, 1.2 * data['highest_pressure'], 1.0)]


def quickens(pressure: float, x: float, strength: float, supply: float, exponent: float) -> float:
    """Return by how much a gain, or the sensing, is the faster at a pressure [Pa]."""
    relative = max(pressure, 1.0) / REFERENCE
    charging = 1.0 / max(passed(REFERENCE / supply), SMALLEST)
    return float(max(charging**strength, relative ** (strength * exponent), relative**strength))


EFFECT = Effect(
    name='operating_point',
    description='gains follow absolute pressure: K_x in proportion, K_sv by the choked flow function, K_v by a power',
    parameters=(
        EffectParameter('strength', '-', 0.0, 1.0, 0.0, '0: not at all, 1: as physics has it', choice=True),
        EffectParameter('supply', 'Pa', 1e5, 5e6, 1e6, 'absolute supply pressure', logarithmic=True),
        EffectParameter('exponent', '-', -1.0, 4.0, 1.0, 'of absolute pressure in K_v'),
    ),
    equations=(
        r"K_x' = K_x\,(p / p_R)^{strength}, \qquad \tau' = \tau\,(p_R / p)^{strength}, \qquad p_R = 200\,\mathrm{kPa}",
        r"q' = q\,\left(\frac{\psi(p / supply)}{\psi(p_R / supply)}\right)^{strength} \quad \text{where } q \ge 0",
        r"q' = q\,(p / p_R)^{strength\;\cdot\;exponent} \quad \text{where } q < 0",
    ),
    starts=starts,
    shown_by='strokes at two set-points well apart',
    seen_against='pressure',
    quickens=quickens,
    rank=30,
)
