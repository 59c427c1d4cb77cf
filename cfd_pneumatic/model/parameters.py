# SPDX-License-Identifier: Apache-2.0
"""The pneumatic model's parameters as data: names, units, ranges, the paper's values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.units import PSI, PSI_PER_INCH

_NEAR = 0.25  # share of the step to the next set-point: within this range beyond the last set-point its gains are valid


@dataclass(frozen=True)
class ParameterSpec:
    """
    Name, unit, range and meaning of a model parameter.

    Attributes
    ----------
    name
        Name in parameter files, reports and code.
    unit
        SI unit.
    lower, upper
        Range within which the model and its fit are trusted [unit].
    description
        One line, with the number of the equation in the paper.
    paper_unit, paper_factor
        The paper's unit, and its value in SI.

    """

    name: str
    unit: str
    lower: float
    upper: float
    description: str
    paper_unit: str
    paper_factor: float


SPECS = (
    ParameterSpec('k_x', 'Pa/m', 1e3, 1e10, 'velocity input gain K_x, equation (12)', 'lbf/in^3', PSI_PER_INCH),
    ParameterSpec('k_sv', '1/s', 1e-3, 5e3, 'charging gain K_sv, acts while p_d > p_f, equation (12)', '1/s', 1.0),
    ParameterSpec('k_v', '1/s', 1e-3, 5e3, 'discharging gain K_v, acts while p_f > p_d, equation (12)', '1/s', 1.0),
    ParameterSpec('tau', 's', 1e-5, 1e2, 'control chamber sensing time constant, equation (8)', 's', 1.0),
)
"""The four parameters of equations (8) and (12), in the order of the kernels' arguments."""

NAMES = tuple(spec.name for spec in SPECS)


@dataclass(frozen=True)
class OperatingPoints:
    """
    Model parameters scheduled over the regulator's set pressure.

    Each parameter is interpolated linearly between set-points and constant outside. One entry is a constant.

    Attributes
    ----------
    setpoints
        Set pressures, gauge, strictly increasing, shape (m,) [Pa].
    k_x, k_sv, k_v, tau
        Parameters at those set pressures, each of shape (m,) [Pa/m, 1/s, 1/s, s].

    Raises
    ------
    ValueError
        If lengths differ, a set-point does not increase, or a value is not finite or outside its range.

    """

    setpoints: Array
    k_x: Array
    k_sv: Array
    k_v: Array
    tau: Array

    def __post_init__(self) -> None:
        """Turn every field into an array and check it."""
        for name in ('setpoints', *NAMES):
            object.__setattr__(self, name, np.atleast_1d(np.asarray(getattr(self, name), dtype=np.float64)))
        if self.setpoints.size == 0:
            raise ValueError('setpoints is empty: give at least one set pressure [Pa]')
        if not np.all(np.isfinite(self.setpoints)) or np.any(np.diff(self.setpoints) <= 0.0):
            raise ValueError('setpoints must be finite and strictly increasing [Pa]')
        for spec in SPECS:
            self._check(spec, getattr(self, spec.name))

    def _check(self, spec: ParameterSpec, values: Array) -> None:
        if values.shape != self.setpoints.shape:
            raise ValueError(
                f'{spec.name} has {values.size} entries but setpoints has {self.setpoints.size}: give one for each'
            )
        for index, value in enumerate(values):
            if not spec.lower <= value <= spec.upper:
                raise ValueError(
                    f'{spec.name}[{index}] = {value:g} is outside {spec.lower:g} to {spec.upper:g} {spec.unit}'
                )

    @classmethod
    def constant(cls, k_x: float, k_sv: float, k_v: float, tau: float, setpoint: float = 0.0) -> OperatingPoints:
        """Return parameters that hold at every set pressure [Pa/m, 1/s, 1/s, s]."""
        return cls(*(np.array([value]) for value in (setpoint, k_x, k_sv, k_v, tau)))

    @classmethod
    def from_rows(cls, rows: Mapping[str, ArrayLike]) -> OperatingPoints:
        """Return the schedule with the fields in `rows`, by their names."""
        return cls(**{name: np.asarray(rows[name], dtype=np.float64) for name in ('setpoints', *NAMES)})

    @lazy_property
    def table(self) -> Array:
        """The schedule as the kernel's argument: rows of (set-point, k_x, k_sv, k_v, tau), shape (m, 5)."""
        return np.column_stack([self.setpoints, self.k_x, self.k_sv, self.k_v, self.tau])

    def interpolate(self, setpoints: ArrayLike) -> OperatingPoints:
        """Interpolate the schedule at gauge set pressures [Pa]."""
        points = np.atleast_1d(np.asarray(setpoints, dtype=np.float64))
        return OperatingPoints(points, *(np.interp(points, self.setpoints, getattr(self, name)) for name in NAMES))

    def covers(self, setpoint: float) -> bool:
        """Return whether a gauge set pressure [Pa] is within or near the schedule; a constant covers all pressures."""
        low, high = self._valid_range
        return low <= setpoint <= high

    @lazy_property
    def _valid_range(self) -> tuple[float, float]:
        """The lowest and the highest gauge set pressure for which the schedule is valid [Pa]."""
        if self.setpoints.size == 1:
            return -math.inf, math.inf
        steps = _NEAR * np.diff(self.setpoints)
        return float(self.setpoints[0] - steps[0]), float(self.setpoints[-1] + steps[-1])


def _rows(*rows: tuple[float, float, float, float, float]) -> OperatingPoints:
    psig, k_x, k_sv, k_v, tau = (np.array(column) for column in zip(*rows))
    return OperatingPoints(psig * PSI, k_x * PSI_PER_INCH, k_sv, k_v, tau)


TABLE_1_ROWS = (
    (5.0, 16.0149, 112.3780, 20.7603, 0.0113),
    (5.0, 15.8753, 96.2677, 18.0990, 0.0098),
    (10.0, 20.5522, 160.8374, 33.5129, 0.0126),
    (10.0, 19.6864, 168.2485, 27.3031, 0.0120),
    (15.0, 21.9259, 179.918, 27.2651, 0.0093),
    (20.0, 26.8250, 359.8479, 57.3027, 0.005),
)
"""Table 1 as printed: nominal pressure [psig], K_x [lbf/in^3], K_sv [1/s], K_v [1/s], tau [s]."""


def _mean_of_repeats(rows: tuple[tuple[float, ...], ...]) -> OperatingPoints:
    pressures = sorted({row[0] for row in rows})
    return _rows(*(tuple(np.mean([row for row in rows if row[0] == pressure], axis=0)) for pressure in pressures))


TABLE_1 = _mean_of_repeats(TABLE_1_ROWS)
"""The paper's Table 1 (steps of about 60 mil), repeated rows averaged."""

TABLE_2 = OperatingPoints(
    np.array([5.0, 10.0]) * PSI,
    np.array([7.0, 15.7015]) * PSI_PER_INCH,
    np.array([25.0, 62.9682]),
    TABLE_1.k_v[:2],
    np.array([0.0075, 0.0048]),
)
"""The paper's Table 2 (steps of 16 to 18 mil); its steps only charge, so that K_v is from Table 1."""
