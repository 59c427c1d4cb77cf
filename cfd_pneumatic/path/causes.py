# SPDX-License-Identifier: Apache-2.0
"""Causes of the force error along a path: gains, friction and leaks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import CONTACT_FORCE
from cfd_pneumatic.device import Device, ForcePerSpeed, combined_force_per_speed
from cfd_pneumatic.path.simulation import PathSimulator, Setpoints

_LEAKS = ('leakage', 'positional_leakage')


class ForceCauses(NamedTuple):
    """Causes of the force error along a path."""

    per_speed: ForcePerSpeed
    """Force error per piston speed by the gains [N s/m]."""

    gains: float
    """Root mean square of the force error that remains without friction and leaks [N]."""

    friction: float
    """Root mean square of the change of the force by friction and the moving mass [N]."""

    leaks: float
    """Root mean square of the change of the force by leaks, without its mean [N]."""


def force_causes(simulator: PathSimulator, device: Device, setpoints: Setpoints, force: Array) -> ForceCauses:
    """
    Return the causes of the force error along a path.

    A cause is measured by a simulation without its effects. The mean of each difference does not count, because
    constant set-points compensate it.

    Parameters
    ----------
    simulator, device, setpoints
        The path, the device, and gauge set-points [Pa].
    force
        Contact force of the device, shape (n,) [N].

    """
    of_force = {f'{CONTACT_FORCE}.{name}.enabled': False for name in device.model.force_effects}
    of_leaks = {
        f'{cylinder}.{name}.enabled': False
        for cylinder, parts in device.model.cylinders.items()
        for name in _LEAKS
        if name in parts.effects
    }
    on_path = simulator.path.is_on_path

    def variation(changed: Mapping[str, bool]) -> tuple[Array, float]:
        """Return the force without some effects on the path [N], and how much they change the force [N]."""
        if not changed:
            return force[on_path], 0.0
        without = simulator.simulate(device.with_values(changed), setpoints).force[on_path]
        difference = force[on_path] - without
        return without, rms(difference - np.mean(difference))

    without_any, _ = variation({**of_force, **of_leaks})
    scale = abs(device.number('area') * device.number('geometric_factor'))
    gains = {name: cylinder.parameters.table[0, 1:] for name, cylinder in device.model.cylinders.items()}
    return ForceCauses(
        combined_force_per_speed(gains, scale),
        rms(without_any - np.mean(without_any)),
        variation(of_force)[1],
        variation(of_leaks)[1],
    )
