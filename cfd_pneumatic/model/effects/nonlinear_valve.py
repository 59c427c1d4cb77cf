# SPDX-License-Identifier: Apache-2.0
"""Nonlinear valve: flow as a power of the valve's error."""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanewise import power

REFERENCE = 1e3
"""Error at which the flow equals that of a linear valve [Pa]."""

ROUNDING = 50.0
"""Error below which the power becomes linear, so that the slope stays finite at zero [Pa]."""


@inlined
def error(value, moment, exponent):
    """Return the error [Pa] at which a linear valve would pass the same flow."""
    size = math.sqrt(value * value + ROUNDING * ROUNDING) / REFERENCE
    return value * power(size, exponent - 1.0)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return exponents of a valve that opens faster and of a valve that opens slower than a linear valve."""
    return [(0.7,), (1.4,)]


EFFECT = Effect(
    name='nonlinear_valve',
    description="flow is a power of the valve's error",
    inspect='no part: nonlinear valves are no fault',
    parameters=(EffectParameter('exponent', '-', 0.2, 3.0, 1.0, 'exponent of the error'),),
    equations=(r"e' = e \left(\frac{\sqrt{e^2 + (50\,\mathrm{Pa})^2}}{1\,\mathrm{kPa}}\right)^{exponent - 1}",),
    starts=starts,
    shown_by='steps of the set-point, large and small',
    seen_against='valve error',
    rank=70,
)
