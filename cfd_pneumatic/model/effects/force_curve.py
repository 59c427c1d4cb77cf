# SPDX-License-Identifier: Apache-2.0
"""
Force curve: an unknown characteristic of the contact force, as a table that is estimated from data.

The table is as that of `curve`. A friction opposes the motion and reverses after a reversal as seal friction does.
"""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Effect, EffectParameter
from cfd_pneumatic.model.effects.knots import PARAMETERS, choice, height
from cfd_pneumatic.model.effects.seal_friction import stretched
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

ENTERS = ('force', 'friction', 'cell')
"""Places in the order of the values of `enters`: added force, friction against the motion, share of the reading."""

AGAINST = ('x', 'speed', 'p', 'force', 'time')
"""Variables in the order of the values of `against`; p is the sum of gauge pressures, force that without the curve."""

FORCE_CURVE = 'force_curve'
"""Name of the effect."""


@inlined
def force(value, moment, stretch, enters, against, presliding, low, high, middle, crowd, *heights):
    """Return the contact force as the sensor reads it [N]."""
    variable = where(against < 0.5, moment.x, moment.rate)
    variable = where(against > 1.5, moment.p - moment.ambient + moment.opposing - moment.ambient, variable)
    variable = where(against > 2.5, value, variable)
    variable = where(against > 3.5, moment.time, variable)
    curve_height = height(variable, abs(against - 2.5) < 1.0, low, high, middle, crowd, heights)
    if enters < 0.5:
        return value + curve_height
    if enters < 1.5:
        return value - curve_height * stretch
    return value * (1.0 + curve_height)


@inlined
def slide(travel, stretch, enters, against, presliding, low, high, middle, crowd, *heights):
    """Return the stretch of the seal, -1 to 1: the direction of the friction."""
    return (stretched(travel, stretch, presliding),)


EFFECT = Effect(
    name=FORCE_CURVE,
    description='an unknown characteristic of the force, estimated from the recordings',
    parameters=(
        choice('enters', 'place at which the curve acts', ENTERS),
        choice('against', 'variable of the curve', AGAINST),
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction reverses', logarithmic=True
        ),
        *PARAMETERS,
    ),
    generic=True,
    states=1,
    follows='motion',
    rank=90,
)
