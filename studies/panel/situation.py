# SPDX-License-Identifier: Apache-2.0
"""What is done to a device: an effect by its strength, and the situation that it is put into."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.rig import Schedule
from studies.panel.specimen import Specimen
from studies.panel.textbook import Gains


class Situation(NamedTuple):
    """What an effect is put into."""

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
        """Gauge pressure at which strengths are told [Pa]."""
        return self.specimen.rig.cylinder_a.reference_pressure - self.specimen.rig.air.ambient_pressure

    def between(self, one_end: float, other_end: float) -> float:
        """Draw evenly on a logarithmic scale."""
        return float(one_end * (other_end / one_end) ** self.rng.random())

    def sign(self) -> float:
        """Draw 1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))


Changes = dict[str, float]
"""Fields of a specimen, by names like ``effects_a.play``, and their new values."""


class Effect(NamedTuple):
    """One effect by its strength."""

    weakest: float
    strongest: float
    unit: str
    meaning: str
    """What the strength is."""

    install: Callable[[float, Situation], Changes]
    """Gives the changes that make a strength."""
