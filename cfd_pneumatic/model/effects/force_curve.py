# SPDX-License-Identifier: Apache-2.0
"""
Force curve: a law of the contact force that nobody knows, as a table that data have drawn.

As `curve` is on the pressure. Friction is against the motion, and turns round after a reversal as seal friction does.
"""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Effect, EffectParameter
from cfd_pneumatic.model.effects.knots import PARAMETERS, choice, height
from cfd_pneumatic.model.effects.seal_friction import stretched
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import where

ENTERS = ('force', 'friction', 'cell')
"""Where it may enter, by the number of its parameter `enters`: added, against the motion, as a share of the reading."""

AGAINST = ('x', 'speed', 'p', 'force', 'time')
"""What it may depend on, by the number of `against`: p is both cylinders' gauge pressure, the force that without it."""

FORCE_CURVE = 'force_curve'
"""Its name."""


@inlined
def force(value, moment, stretch, enters, against, presliding, low, high, middle, crowd, *heights):
    """Return the contact force as the sensor reads it [N]."""
    at = where(against < 0.5, moment.x, moment.rate)
    at = where(against > 1.5, moment.p - moment.ambient + moment.opposing - moment.ambient, at)
    at = where(against > 2.5, value, at)
    at = where(against > 3.5, moment.time, at)
    own = height(at, abs(against - 2.5) < 1.0, low, high, middle, crowd, heights)
    if enters < 0.5:
        return value + own
    if enters < 1.5:
        return value - own * stretch
    return value * (1.0 + own)


@inlined
def slide(travel, stretch, enters, against, presliding, low, high, middle, crowd, *heights):
    """Return how far friction has turned round, -1 to 1."""
    return (stretched(travel, stretch, presliding),)


EFFECT = Effect(
    name=FORCE_CURVE,
    description='a law of the force that nobody knows, as data have drawn it',
    parameters=(
        choice('enters', 'where it enters', ENTERS),
        choice('against', 'what it depends on', AGAINST),
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction turns round', logarithmic=True
        ),
        *PARAMETERS,
    ),
    generic=True,
    states=1,
    follows='motion',
    rank=90,
)
