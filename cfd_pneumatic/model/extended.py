"""A cylinder with physical effects beside the paper's equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.model.composed import propagate, rest
from cfd_pneumatic.model.effects import EFFECTS
from cfd_pneumatic.model.places import STATES, all_parameters, switches

Array = NDArray[np.float64]

SLOWEST_CUT = 1.0
"""A step is at most this many of the fastest time constants long [-]."""


@dataclass(frozen=True)
class ExtendedCylinder:
    """
    Equations (8) and (12) at constant gains, with effects.

    Attributes
    ----------
    gains
        k_x [Pa/m], k_sv, k_v [1/s], tau [s].
    effects
        Parameters of each effect that is on, by its name.
    ambient_pressure
        Absolute [Pa].

    """

    gains: Sequence[float] | Array
    effects: Mapping[str, Sequence[float]]
    ambient_pressure: float

    @property
    def stiffness(self) -> float:
        """Inverse of the fastest time constant [1/s]."""
        _, k_sv, k_v, tau = self.gains
        fastest = max(k_sv, k_v, 1.0 / tau)
        for name, own in self.effects.items():
            rate = EFFECTS[name].fastest
            if rate is not None:
                fastest = max(fastest, rate(*own))
        return fastest / SLOWEST_CUT

    def simulate(self, times: Array, displacement: Array, setpoint: Array, start: float = 0.0) -> Array:
        """
        Return what the pressure sensor reads at each sample, shape (n,) [Pa].

        Parameters
        ----------
        times, displacement, setpoint
            As in `Cylinder.simulate`.
        start
            What the pressures lie above the first set-point at the first sample [Pa].

        """
        state = np.empty(STATES + 2)
        rest(displacement[0], setpoint[0] + start, state)
        signal = np.empty_like(times)
        propagate(
            times,
            displacement,
            setpoint,
            self.ambient_pressure,
            self.stiffness,
            state,
            all_parameters(self.gains, self.effects),
            switches(self.effects),
            signal,
        )
        return signal
