# SPDX-License-Identifier: Apache-2.0
"""Air that the regulators feed into the cylinders along a path."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.device import Device
from cfd_pneumatic.model import DIRECTIONS
from cfd_pneumatic.path.motion import PathMotion

ANR_PRESSURE, ANR_TEMPERATURE = 1e5, 293.15
"""Pressure [Pa] and temperature [K] of the reference atmosphere ANR (ISO 8778); the supply has this temperature."""


def air_consumption(device: Device, path: PathMotion, pressures: Mapping[str, Array]) -> float:
    """
    Return the mean air consumption of the cylinders on a path [m^3/s ANR].

    Equation (12) has the flow into a chamber as a pressure rate, the rate of the pressure plus K_x times the speed.
    K_x = n p A / V gives the chamber's volume over the polytropic exponent n. The exponent therefore cancels in the
    volume flow A p / K_x times this rate, at the pressure p. The flow of a leak is added, except of a leak that depends
    on the position. The air that a regulator bleeds at rest is not part of the model.

    Parameters
    ----------
    device, path
        The device, and the path.
    pressures
        Absolute pressures in the chambers by cylinder, on the grid of the path, each (n,) [Pa].

    """
    area, ambient = device.number('area'), device.number('ambient_pressure')
    speed = path.speed_at(path.grid)
    total = 0.0
    for name, pressure in pressures.items():
        cylinder = device.model.cylinders[name]
        k_x = float(cylinder.parameters.interpolate([float(np.mean(pressure)) - ambient]).k_x[0])
        conductance, orifice = cylinder.effects.get('leakage', (0.0, 0.0))
        leak = conductance * (pressure if orifice else pressure - ambient)
        rate = np.gradient(pressure, path.grid) + k_x * DIRECTIONS[name] * speed + leak
        flow = np.maximum(rate, 0.0) * float(np.mean(pressure)) * area / k_x / ANR_PRESSURE
        total += float(np.mean(flow[path.is_on_path]))
    return total
