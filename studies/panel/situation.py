# SPDX-License-Identifier: Apache-2.0
"""Define an effect of the panel, and the situation in which an effect is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.rig import Schedule
from studies.panel.specimen import Specimen
from studies.panel.textbook import Gains


class Situation(NamedTuple):
    """Device, gains, schedule and random numbers for which an effect is installed."""

    specimen: Specimen
    gains: Gains
    schedule: Schedule
    rng: np.random.Generator

    @property
    def mass_per_pressure(self) -> float:
        """Mass that flows into cylinder A while its pressure rises by a pascal [kg/Pa]."""
        cylinder, air = self.specimen.rig.cylinder_a, self.specimen.rig.air
        return cylinder.rest_volume / (cylinder.polytropic_exponent * air.gas_constant * air.temperature)

    @property
    def reference_gauge(self) -> float:
        """Gauge pressure to which strengths refer [Pa]."""
        return self.specimen.rig.cylinder_a.reference_pressure - self.specimen.rig.air.ambient_pressure

    def between(self, start: float, end: float) -> float:
        """Draw a number between two ends, evenly on a logarithmic scale."""
        return float(start * (end / start) ** self.rng.random())

    def sign(self) -> float:
        """Draw 1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))


Changes = dict[str, float]
"""Fields of a specimen, by names like ``effects_a.play``, and their new values."""


class Effect(NamedTuple):
    """An effect, and the range and unit of its strength."""

    weakest: float
    strongest: float
    unit: str
    meaning: str
    """Meaning of the strength."""

    install: Callable[[float, Situation], Changes]
    """Function that returns the changes for a strength."""
