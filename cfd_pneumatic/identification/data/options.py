# SPDX-License-Identifier: Apache-2.0
"""Options of an identification."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from cfd_pneumatic.arguments import check_number, check_numbers, check_switches, check_type
from cfd_pneumatic.convention import AMBIENT_PRESSURE, AMBIENT_PRESSURES, AREAS, FACTORS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.thresholds import FRACTIONS_TOLERANCE, SMALLEST_FRACTION
from cfd_pneumatic.identification.data.tolerance import Tolerance

FRACTIONS = (0.6, 0.2, 0.2)
"""Default shares of train, validation and test."""

AUTO: str = 'auto'
LINEAR: str = 'linear'
PHYSICAL: str = 'physical'
CORES: tuple[str, ...] = (AUTO, LINEAR, PHYSICAL)
"""Cores of a cylinder's model; `auto`: closing the loop selects the core that the recordings need."""


@dataclass(frozen=True)
class Options:
    """
    Options of an identification.

    Attributes
    ----------
    per_setpoint
        Fit an operating-point table, one row for each set-point, in addition to the joint fit.
    fractions
        Shares of train, validation and test.
    ambient_pressure
        Absolute pressure at which the gauge pressure is zero [Pa].
    close_loop
        Search for physical effects that the model lacks, of the pressure and of a recorded force.
    area
        Approximate area of either piston [m^2]; None if not known.
    geometric_factor
        Contact force over piston force, from the linkage [-]; None if not known: the area then includes the factor.
    core
        One of `CORES`: the paper's linear equations, the equations before linearisation, or the loop's choice.
    tolerance
        Errors that do not matter: a smaller remaining error does not make the verdict `unexplained`.
    thorough
        Search without a limit of the effort.

    Raises
    ------
    InputError
        If an option is outside the range of real devices.

    """

    per_setpoint: bool = False
    fractions: tuple[float, float, float] = FRACTIONS
    ambient_pressure: float = AMBIENT_PRESSURE
    close_loop: bool = False
    area: float | None = None
    geometric_factor: float | None = None
    core: str = AUTO
    tolerance: Tolerance = ()
    thorough: bool = False

    def __post_init__(self) -> None:
        """Check types and ranges."""
        area, factor = self.area, self.geometric_factor
        check_switches(per_setpoint=self.per_setpoint, close_loop=self.close_loop, thorough=self.thorough)
        check_numbers(ambient_pressure=self.ambient_pressure)
        check_numbers(optional=True, area=area, geometric_factor=factor)
        check_type('fractions', self.fractions, Collection, 'three shares')
        for share in self.fractions:
            check_number('a share of fractions', share)
        lowest, highest = AMBIENT_PRESSURES
        if not lowest <= self.ambient_pressure <= highest:
            raise InputError(f'ambient_pressure {self.ambient_pressure:g} Pa is outside {lowest:g} to {highest:g} Pa')
        if area is not None and not AREAS[0] <= area <= AREAS[1]:
            raise InputError(f'area {area:g} m^2 is outside {AREAS[0]:g} to {AREAS[1]:g} m^2')
        if factor is not None and not (FACTORS[0] <= factor <= FACTORS[1] and factor != 0.0):
            raise InputError(f'geometric_factor {factor:g} is 0 or outside {FACTORS[0]:g} to {FACTORS[1]:g}')
        if self.core not in CORES:
            raise InputError(f'core {self.core!r} does not exist. Use one of {", ".join(CORES)}')
        if len(self.fractions) != 3 or not all(SMALLEST_FRACTION <= share < 1.0 for share in self.fractions):
            raise InputError(
                f'fractions {self.fractions} are not usable. '
                f'Give three shares of {SMALLEST_FRACTION:g} or more, as (0.6, 0.2, 0.2)'
            )
        if abs(sum(self.fractions) - 1.0) > FRACTIONS_TOLERANCE:
            raise InputError(
                f'fractions {self.fractions} do not add up to 1. Give three shares with the sum 1, as (0.6, 0.2, 0.2)'
            )
