# SPDX-License-Identifier: Apache-2.0
"""
Uniform devices with full physics, in addition to the panel's devices that follow the paper's model.

Flows depend on the pressures, the stiffness depends on the volume, and each make has a peculiarity. The makes of
`OWN_WAYS` behave unlike orifices of ISO 6358 and polytropic chambers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import SPECIFIC_HEAT, Air, Cylinder, Piston, RigParameters, Seal
from cfd_pneumatic.units import PSI
from studies.panel.specimen import Approach, Specimen, gains_of
from studies.panel.textbook import Gains

Uniform = Callable[[float, float], float]
"""Function that draws from the uniform distribution between two numbers."""


def orifices(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Change nothing: the device has two orifices and a polytropic chamber."""
    return {}


def walls(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Exchange heat with the walls, with a time constant of 0.05 s to 1 s."""
    mass = cylinder.reference_pressure * cylinder.rest_volume / (Air().gas_constant * Air().temperature)
    return {'effects_a.heat_transfer': mass * SPECIFIC_HEAT / 20.0 ** -between(0.0, 1.0)}


def even_gain(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Give the supply valve the same gain at every set pressure."""
    return {'cylinder_a.supply_gain_growth': 0.0}


def subsonic(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Let the subsonic flow deviate from an ellipse."""
    return {
        'cylinder_a.supply_subsonic_index': between(0.35, 0.7),
        'cylinder_a.relief_subsonic_index': between(0.35, 0.7),
    }


def silencer(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Let the relief valve blow through a silencer as wide as the valve is at errors of 20 to 100 kPa."""
    return {'cylinder_a.silencer_conductance': cylinder.relief_gain * between(2e4, 1e5)}


def drilled(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Fill the control chamber through a hole with an entrance loss."""
    return {'cylinder_a.entrance_loss': between(2e4, 1e5)}


def stirred_walls(cylinder: Cylinder, between: Uniform) -> dict[str, float]:
    """Exchange heat with the walls; the exchange grows with piston speed."""
    return {**walls(cylinder, between), 'effects_a.stirring': between(2.0, 20.0)}


MAKES = {make.__name__: make for make in (orifices, walls, even_gain, subsonic, silencer, drilled, stirred_walls)}
"""Functions that return the changes of each make, by name."""

OWN_WAYS = ('subsonic', 'silencer', 'drilled', 'stirred_walls')
"""Makes with more than two orifices, a laminar tube, and a polytropic chamber with walls."""


def draw_make(name: str, rng: np.random.Generator) -> tuple[Specimen, Gains]:
    """
    Return a healthy specimen of a make without mass and friction, and the gains of its cylinder A about 10 psi.

    Raises
    ------
    InputError
        If there is no such make.

    """
    if name not in MAKES:
        raise InputError(f'make {name!r} is not known. Use one of {", ".join(MAKES)}.')

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    air = Air(supply_pressure=Air().ambient_pressure + between(45.0, 90.0) * PSI)
    exponent = between(1.0, 1.4)
    rig = RigParameters(
        air=air,
        cylinder_a=_cylinder(exponent, between),
        cylinder_b=_cylinder(exponent, between),
        piston=Piston(mass=0.0),
        seal=Seal(coulomb=0.0, coulomb_per_pressure=0.0, viscous=0.0),
    )
    approach = Approach(position=float(rng.choice([-5e-4, 5e-4])), setpoint=between(-1.5e3, 1.5e3))
    specimen = Specimen(rig, approach=approach).with_changes(MAKES[name](rig.cylinder_a, between))
    return specimen, gains_of(specimen.rig.cylinder_a, air)


def _cylinder(exponent: float, between: Uniform) -> Cylinder:
    """Return a cylinder of half to twice the usual size, with half to twice the usual regulator gains."""
    plain = Cylinder()
    size = 2.0 ** between(-1.0, 1.0)
    return plain._replace(
        rest_volume=plain.rest_volume * size,
        polytropic_exponent=exponent,
        supply_gain=plain.supply_gain * size * 2.0 ** between(-1.0, 1.0),
        supply_gain_growth=plain.supply_gain_growth * between(0.0, 1.0),
        supply_critical_ratio=between(0.2, 0.53),
        relief_gain=plain.relief_gain * size * 2.0 ** between(-1.0, 1.0),
        relief_critical_ratio=between(0.2, 0.53),
        aspirator_length=plain.aspirator_length * between(0.7, 1.4),
    )
