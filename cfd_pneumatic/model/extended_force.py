# SPDX-License-Identifier: Apache-2.0
"""The contact force, with physical effects beside the piston's area times the pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model.composed import FORCE_STATES, propagate_force, rest_force
from cfd_pneumatic.model.places import all_force_parameters, force_switches


@dataclass(frozen=True)
class ExtendedForce:
    """
    Area times difference of the pressures, with effects.

    Attributes
    ----------
    area_times_factor
        Piston area times the linkage's geometric factor [m^2].
    effects
        Parameters of each effect on the force that is on, by its name.
    ambient_pressure
        Absolute [Pa].

    """

    area_times_factor: float
    effects: Mapping[str, Sequence[float]]
    ambient_pressure: float

    def begin(self, displacement: float, stretch: float = 0.0) -> Array:
        """
        Return the state to follow from: the seals at a displacement [m], and how far they are stretched there.

        The stretch is 1 as behind a long travel towards +x, -1 towards -x.
        """
        state = np.empty(FORCE_STATES + 1)
        rest_force(displacement, state)
        state[:FORCE_STATES] = stretch
        return state

    def follow(
        self,
        state: Array,
        begin: float,
        times: Array,
        displacement: Array,
        rate: Array,
        acceleration: Array,
        pressure_a: Array,
        pressure_b: Array | None,
    ) -> Array:
        """
        Return the contact force along +x at each sample of a piece, shape (n,) [N], and carry the state on.

        Parameters
        ----------
        state
            From `begin`; a piece may begin with the last sample of the one before.
        begin
            Time of the first sample of all [s].
        times
            Increasing, shape (n,) [s].
        displacement, rate, acceleration
            Of the piston; +x grows cylinder A, shape (n,) [m, m/s, m/s^2].
        pressure_a, pressure_b
            Absolute, shape (n,) [Pa]; B is None in a single cylinder.

        """
        force = np.empty_like(times)
        propagate_force(
            times,
            displacement,
            rate,
            acceleration,
            pressure_a,
            np.full_like(times, self.ambient_pressure) if pressure_b is None else pressure_b,
            begin,
            self.ambient_pressure,
            self.area_times_factor,
            state,
            all_force_parameters(self.effects),
            force_switches(self.effects),
            force,
        )
        return force
