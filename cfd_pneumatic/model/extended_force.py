# SPDX-License-Identifier: Apache-2.0
"""The contact force, with physical effects in addition to area times pressure difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model.composed import FORCE_STATES, propagate_force, set_force_to_rest
from cfd_pneumatic.model.places import all_force_parameters, force_switches


@dataclass(frozen=True)
class ExtendedForce:
    """
    Piston area times pressure difference, with effects.

    Attributes
    ----------
    area_times_factor
        Piston area times the linkage's geometric factor [m^2].
    effects
        Parameters of each effect on the force that is on, by its name.
    ambient_pressure
        Absolute pressure [Pa].

    """

    area_times_factor: float
    effects: Mapping[str, Sequence[float]]
    ambient_pressure: float

    def begin(self, displacement: float, stretch: float = 0.0) -> Array:
        """
        Return the state at the first sample, with the seals at a displacement [m] and with a stretch [-].

        The stretch is 1 after a long travel towards +x, -1 after a long travel towards -x.
        """
        state = np.empty(FORCE_STATES + 1)
        set_force_to_rest(displacement, state)
        state[:FORCE_STATES] = stretch
        return state

    def simulate_piece(
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
        Return the contact force along +x at each sample of a piece, shape (n,) [N], and update the state.

        Parameters
        ----------
        state
            State from `begin` or after the piece before; a piece may begin with the last sample of the piece before.
        begin
            Time of the first sample of the first piece [s].
        times
            Increasing, shape (n,) [s].
        displacement, rate, acceleration
            Motion of the piston; +x grows cylinder A, shape (n,) [m, m/s, m/s^2].
        pressure_a, pressure_b
            Absolute pressures, shape (n,) [Pa]; B is None for a single cylinder.

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
