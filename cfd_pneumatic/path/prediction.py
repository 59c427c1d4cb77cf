# SPDX-License-Identifier: Apache-2.0
"""Predicted force along a path, its band, and where it violates a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array, Mask, rms
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.path.band import PlanErrors, force_variances
from cfd_pneumatic.path.identified import IdentifiedDevice
from cfd_pneumatic.path.motion import PathMotion
from cfd_pneumatic.path.simulation import PathResponse, PathSimulator, Setpoints
from cfd_pneumatic.path.thresholds import STANDARD_ERRORS


class Violation(NamedTuple):
    """A part of the path on which the force is outside of the tolerance."""

    begin: float
    """First time [s]."""

    end: float
    """Last time [s]."""

    is_certain: bool
    """Whether the whole band is outside of the tolerance at some time of the part."""


@dataclass(frozen=True)
class Prediction:
    """
    Predicted contact force along a path at given set-points.

    Attributes
    ----------
    path
        The path; arrays are on its grid, shape (n,).
    setpoints
        Gauge set-points by cylinder [Pa].
    response
        Pressures and force.
    variances
        Variances of the force by their causes, each (n,) [N^2].
    target
        Wanted force [N].
    tolerance
        Largest accepted distance from the wanted force [N]; None if no tolerance is given.

    """

    path: PathMotion
    setpoints: Setpoints
    response: PathResponse
    variances: Mapping[str, Array]
    target: float
    tolerance: float | None

    @property
    def force(self) -> Array:
        """Contact force, shape (n,) [N]."""
        return self.response.force

    @lazy_property
    def half_band(self) -> Array:
        """Half of the 95 % band of the force, shape (n,) [N]."""
        total: Array = sum(self.variances.values(), start=np.zeros_like(self.force))
        return np.asarray(STANDARD_ERRORS * np.sqrt(total))

    @property
    def error(self) -> Array:
        """Force minus wanted force on the path, shape (m,) [N]."""
        return self.force[self.path.is_on_path] - self.target

    @property
    def rms_error(self) -> float:
        """Root mean square of the force error on the path [N]."""
        return rms(self.error)

    @property
    def rms_band(self) -> float:
        """Root mean square of half of the band on the path [N]."""
        return rms(self.half_band[self.path.is_on_path])

    @property
    def largest_error(self) -> float:
        """Largest size of the force error on the path [N]."""
        return float(np.max(np.abs(self.error)))

    @property
    def largest_possible_error(self) -> float:
        """Largest size of the force error within the band on the path [N]."""
        return float(np.max(np.abs(self.error) + self.half_band[self.path.is_on_path]))

    @lazy_property
    def violations(self) -> tuple[Violation, ...]:
        """Parts of the path on which the band leaves the tolerance, in their order; empty without a tolerance."""
        if self.tolerance is None:
            return ()
        size, half = np.abs(self.error), self.half_band[self.path.is_on_path]
        times = self.path.grid[self.path.is_on_path]
        certain = size - half > self.tolerance
        return tuple(
            Violation(float(times[part][0]), float(times[part][-1]), bool(np.any(certain[part])))
            for part in _runs(size + half > self.tolerance)
        )


def _runs(mask: Mask) -> list[slice]:
    """Return the runs in which a mask is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [slice(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2])]


def predict(
    simulator: PathSimulator,
    identified: IdentifiedDevice,
    setpoints: Setpoints,
    target: float,
    tolerance: float | None,
    errors: PlanErrors,
) -> Prediction:
    """Return the predicted force of a device along a path at gauge set-points [Pa], with its band."""
    response = simulator.simulate(identified.device, setpoints)
    variances = force_variances(simulator, identified, setpoints, response, errors)
    return Prediction(simulator.path, setpoints, response, variances, target, tolerance)
