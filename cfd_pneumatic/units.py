# SPDX-License-Identifier: Apache-2.0
"""Units of inputs and outputs: factors to SI, and the paper's units for display."""

from __future__ import annotations

from dataclasses import dataclass

INCH = 0.0254
"""Metres in an inch."""

POUND_FORCE = 4.4482216152605
"""Newtons in a pound-force."""

PSI = POUND_FORCE / INCH**2
"""Pascals in a psi."""

PSI_PER_INCH = PSI / INCH
"""Pa/m in a lbf/in^3, the paper's unit of K_x."""


@dataclass(frozen=True)
class Unit:
    """A unit of measurement: its quantity and its value in SI."""

    quantity: str
    si: float


UNITS = {
    'Pa': Unit('pressure', 1.0),
    'hPa': Unit('pressure', 1e2),
    'kPa': Unit('pressure', 1e3),
    'MPa': Unit('pressure', 1e6),
    'mbar': Unit('pressure', 1e2),
    'bar': Unit('pressure', 1e5),
    'psi': Unit('pressure', PSI),
    'm': Unit('length', 1.0),
    'cm': Unit('length', 1e-2),
    'mm': Unit('length', 1e-3),
    'um': Unit('length', 1e-6),
    'inch': Unit('length', INCH),
    'mil': Unit('length', INCH * 1e-3),
    'N': Unit('force', 1.0),
    'kN': Unit('force', 1e3),
    'lbf': Unit('force', POUND_FORCE),
    's': Unit('time', 1.0),
    'ms': Unit('time', 1e-3),
    'us': Unit('time', 1e-6),
    'ns': Unit('time', 1e-9),
    'min': Unit('time', 60.0),
    'h': Unit('time', 3600.0),
    'd': Unit('time', 86_400.0),
}
