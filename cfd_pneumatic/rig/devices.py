# SPDX-License-Identifier: Apache-2.0
"""Devices by name, and their faults."""

from __future__ import annotations

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.parameters import Cylinder, Piston, RigParameters, Seal, with_changes

CHANGEABLE = ('effects_a', 'effects_b', 'pickup', 'odd_a', 'odd_b', 'odd_force')
"""Parts of a device that can have faults."""

EXAMPLE = 'effects_a.leak_conductance=1e-10'


def _frozen(cylinder: Cylinder) -> Cylinder:
    """
    Return a cylinder with coefficients that are constant over pressure and position, as in the paper.

    The control chamber is small, so that filling it does not disturb the cylinder, and its tube is narrower in
    proportion.
    """
    return cylinder._replace(
        supply_gain_growth=0.0,
        control_volume=0.1 * cylinder.control_volume,
        aspirator_diameter=0.1**0.25 * cylinder.aspirator_diameter,
        pressure_dependence=0.0,
        position_dependence=0.0,
    )


DEVICES: dict[str, RigParameters] = {
    'real': RigParameters(),
    'paper': RigParameters(
        cylinder_a=_frozen(Cylinder()),
        cylinder_b=_frozen(Cylinder()),
        piston=Piston(mass=0.0),
        seal=Seal(coulomb=0.0, coulomb_per_pressure=0.0, viscous=0.0),
    ),
}
"""`real`: gains change with pressure and position; `paper`: as the paper's equations, without friction and mass."""


def device_named(name: str, faults: str = '') -> RigParameters:
    """
    Return a device by its name, with faults.

    Parameters
    ----------
    name : str
        A name in `DEVICES`.
    faults : str
        Faults, as in `with_faults`.

    Raises
    ------
    InputError
        If the device or a fault is not known.

    """
    if name not in DEVICES:
        raise InputError(f'device {name!r} is not known: use one of {", ".join(DEVICES)}')
    return with_faults(DEVICES[name], faults)


def with_faults(device: RigParameters, faults: str) -> RigParameters:
    """
    Return a device with faults.

    Parameters
    ----------
    device : RigParameters
        The healthy device.
    faults : str
        Fields of `Effects` or `Pickup` with their values in SI units, such as
        ``effects_a.leak_conductance=1e-10 effects_b.dead_band=300``; empty for a healthy device.

    Raises
    ------
    InputError
        If a fault is not known or has no number.

    """
    changes: dict[str, float] = {}
    for fault in faults.split():
        name, _, value = fault.partition('=')
        try:
            changes[name] = float(value)
        except ValueError as error:
            raise InputError(f"'faults': {fault!r} must be NAME=NUMBER, for example {EXAMPLE}") from error
        if name.partition('.')[0] not in CHANGEABLE:
            parts = ', '.join(CHANGEABLE)
            raise InputError(f"'faults': {name} cannot be a fault; give PART.NAME=NUMBER with a part of {parts}")
    return with_changes(device, changes)
