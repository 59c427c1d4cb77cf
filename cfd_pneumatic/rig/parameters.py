# SPDX-License-Identifier: Apache-2.0
"""
The parameters of the virtual rig.

They are named tuples of floats, which the compiled physics reads by name. Change a value with ``_replace``::

    parameters = RigParameters()
    lighter = parameters._replace(piston=parameters.piston._replace(mass=0.1))

The defaults are a device of the CFD2100's size. Its small-signal behaviour from 5 to 20 psig follows Table 1 of Guvenc
and Srinivasan. An effect that a healthy device lacks is a field with a strength, 0 by default. Most of these fields are
in `cfd_pneumatic.rig.effects` and `cfd_pneumatic.rig.oddities`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.effects import Effects, Pickup
from cfd_pneumatic.rig.oddities import ForceOddities, Oddities
from cfd_pneumatic.units import PSI


class Air(NamedTuple):
    """The air of the device, at a uniform temperature."""

    supply_pressure: float = AMBIENT_PRESSURE + 75 * PSI
    """Absolute pressure upstream of the supply valves [Pa]."""

    ambient_pressure: float = AMBIENT_PRESSURE
    """Absolute pressure downstream of the relief valves [Pa]."""

    temperature: float = 293.15
    """Absolute temperature [K]."""

    gas_constant: float = 287.05
    """Specific gas constant [J/(kg K)]."""

    viscosity: float = 1.81e-5
    """Dynamic viscosity [Pa s]."""


class Cylinder(NamedTuple):
    """An air cylinder and the self-relieving regulator that supplies it."""

    area: float = 1.14e-3
    """Cross-section of the piston [m^2]: a bore of 1.5 inch."""

    rest_volume: float = 4.77e-5
    """Volume of cylinder and line with the piston at x = 0 [m^3]."""

    polytropic_exponent: float = 1.3
    """n, between 1 (isothermal) and 1.4 (adiabatic)."""

    supply_gain: float = 3.57e-14
    """Sonic conductance of the supply valve for each pascal of positive error [m^3/(s Pa) / Pa]."""

    supply_gain_growth: float = 2.7e-5
    """
    Relative growth of `supply_gain` per pascal of set pressure [1/Pa].

    Empirical. With choked supply flow alone K_sv would not depend on the set-point, but in Table 1 K_sv more than
    triples from 5 to 20 psig.
    """

    supply_conductance: float = 3.1e-8
    """Sonic conductance of the supply valve fully open [m^3/(s Pa)]: the regulator's 40 scfm."""

    supply_critical_ratio: float = 0.5
    """Critical pressure ratio b of the supply valve."""

    relief_gain: float = 6.38e-14
    """Sonic conductance of the relief valve for each pascal of negative error [m^3/(s Pa) / Pa]."""

    relief_conductance: float = 1.5e-8
    """Sonic conductance of the relief valve fully open [m^3/(s Pa)]: the regulator's 5.5 scfm."""

    relief_critical_ratio: float = 0.5
    """Critical pressure ratio b of the relief valve."""

    supply_subsonic_index: float = 0.5
    """Subsonic index m of the supply valve."""

    relief_subsonic_index: float = 0.5
    """Subsonic index m of the relief valve."""

    silencer_conductance: float = 0.0
    """Sonic conductance of a silencer behind the relief valve [m^3/(s Pa)]; 0: none."""

    control_volume: float = 5e-7
    """Volume of the regulator's control chamber, under the diaphragm [m^3]."""

    aspirator_diameter: float = 2.5e-4
    """Inner diameter of the aspirator tube between outlet and control chamber [m]."""

    aspirator_length: float = 2.25e-2
    """Length of the aspirator tube [m]."""

    entrance_loss: float = 0.0
    """Pressure difference at which the tube's entrance halves the laminar flow [Pa]; 0: no loss."""

    reference_pressure: float = AMBIENT_PRESSURE + 10 * PSI
    """Absolute pressure of the constant coefficients for `pressure_dependence` = 0 [Pa]."""

    pressure_dependence: float = 1.0
    """Dependence of flows, densities and stiffness on the pressure: 1 physical, 0 none."""

    position_dependence: float = 1.0
    """Dependence of the coefficients' volume on the displacement: 1 physical, 0 none."""


class Piston(NamedTuple):
    """The piston between the two cylinders, and the linkage to the workpiece."""

    mass: float = 0.15
    """Mass between the air and the load cell [kg]."""

    geometric_factor: float = 1.0
    """Contact force / difference of the cylinders' forces."""

    travel: float = 6.35e-3
    """Largest displacement to either side of mid-stroke [m]."""

    lost_motion: float = 0.0
    """Gap between the piston and the tool whose displacement is measured [m]."""

    inclination: float = 0.0
    """Angle of +x above the horizontal [rad]."""


class Seal(NamedTuple):
    """Total friction of both cylinders' seals; low, as of glass cylinders."""

    coulomb: float = 0.1
    """Coulomb friction without pressure [N]."""

    coulomb_per_pressure: float = 1e-6
    """Coulomb friction for each pascal of the sum of both gauge pressures [N/Pa]."""

    viscous: float = 2.0
    """Viscous friction [N s/m]."""

    presliding: float = 5e-5
    """Displacement over which the friction reverses after a reversal of the motion [m] (Dahl)."""

    breakaway: float = 0.0
    """Additional Coulomb friction at zero speed [N] (Stribeck)."""

    stribeck_speed: float = 5e-3
    """Speed at which the additional friction has fallen to 1 / e [m/s]."""


class RigParameters(NamedTuple):
    """The whole rig: cylinder A grows with +x, cylinder B shrinks."""

    air: Air = Air()
    cylinder_a: Cylinder = Cylinder()
    cylinder_b: Cylinder = Cylinder()
    piston: Piston = Piston()
    seal: Seal = Seal()
    effects_a: Effects = Effects()
    effects_b: Effects = Effects()
    pickup: Pickup = Pickup()
    odd_a: Oddities = Oddities()
    odd_b: Oddities = Oddities()
    odd_force: ForceOddities = ForceOddities()


def with_changes(parameters: RigParameters, changes: Mapping[str, float]) -> RigParameters:
    """
    Return the parameters with changed values, by names such as `effects_a.leak_conductance`.

    Raises
    ------
    InputError
        If a name is not known, or the values do not make a device.

    """
    for name, value in changes.items():
        part, _, field = name.partition('.')
        values = getattr(parameters, part, None) if part in RigParameters._fields else None
        if values is None or field not in values._fields:
            raise InputError(
                f'rig parameter {name} is not known: use PART.NAME, for example effects_a.leak_conductance'
            )
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f'rig parameter {name} must be a number, is {value!r}')
        parameters = parameters._replace(**{part: values._replace(**{field: float(value)})})
    return checked(parameters)


MAY_BE_NEGATIVE = frozenset(
    {
        'inclination',
        'lift_position',
        'lift_end',
        'lift_direction',
        'drift',
        'pulsation_phase',
        'jump',
        'jump_time',
        'hum_phase',
        'force_offset',
        'bulge',
        'bulge_position',
        'one_way',
        'soft',
        'groove',
        'port',
        'ledge',
        'ledge_position',
        'creep',
        'kink',
        'scar_position',
        'bend',
    }
)

MAY_BE_ZERO = frozenset(
    {
        'supply_gain',
        'supply_gain_growth',
        'relief_gain',
        'pressure_dependence',
        'position_dependence',
        'mass',
        'coulomb',
        'coulomb_per_pressure',
        'viscous',
    }
)
"""Values that may be zero, in addition to values that are 0 by default."""


def checked(parameters: RigParameters) -> RigParameters:
    """
    Return the parameters as floats, after a check that they make a device.

    Raises
    ------
    InputError
        If a value is not finite, has the wrong sign, or makes the volume of a chamber negative.

    """
    for part, values in parameters._asdict().items():
        for name, value in values._asdict().items():
            may_be_zero = name in MAY_BE_ZERO or values._field_defaults[name] == 0.0
            allowed = value > 0.0 or name in MAY_BE_NEGATIVE or (value == 0.0 and may_be_zero)
            if not math.isfinite(value) or not allowed:
                raise InputError(f'rig parameter {part}.{name} = {value:g}: give a positive number')
    for part in ('cylinder_a', 'cylinder_b'):
        cylinder = getattr(parameters, part)
        if cylinder.rest_volume <= cylinder.area * parameters.piston.travel:
            raise InputError(
                f'rig parameter {part}.rest_volume = {cylinder.rest_volume:g} m^3 is too small: the chamber has no '
                'volume at the end of the travel; increase rest_volume or reduce piston.travel'
            )
        if cylinder.supply_critical_ratio >= 1.0 or cylinder.relief_critical_ratio >= 1.0:
            raise InputError(
                f'rig parameters {part}.supply_critical_ratio and {part}.relief_critical_ratio must be below 1, are '
                f'{cylinder.supply_critical_ratio:g} and {cylinder.relief_critical_ratio:g}'
            )
    if parameters.air.supply_pressure <= parameters.air.ambient_pressure:
        raise InputError(
            f'rig parameter air.supply_pressure must be above air.ambient_pressure = '
            f'{parameters.air.ambient_pressure:g} Pa, is {parameters.air.supply_pressure:g} Pa'
        )
    return RigParameters._make(type(part)(*map(float, part)) for part in parameters)
