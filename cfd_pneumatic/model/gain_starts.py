# SPDX-License-Identifier: Apache-2.0
"""Gains of the paper's model: starts and bounds of a fit, advice on what to record, and time constants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model.parameters import SPECS

HINTS = {
    'k_x': 'let the piston move farther',
    'k_sv': 'let the chamber grow, so that the regulator charges it',
    'k_v': 'let the chamber shrink, so that the regulator vents it',
    'tau': 'sample faster, or let the piston move in steps',
}
"""What to record so that a parameter is identifiable, by parameter."""

_STARTING_K = (3.0, 30.0, 150.0)  # charging gains [1/s]
_SHORTEST_CHAMBER = 0.03  # [m]
_ATMOSPHERE = 1e5  # [Pa]
_SOFTEST = _ATMOSPHERE / 10.0  # K_x of a chamber ten metres long [Pa/m]: no stroke changes its pressure
_SHORTEST = 0.3  # sample periods: a shorter time constant is not identifiable
_QUICKER = 5.0
_SLOWEST_RELIEF, _USUAL_RELIEF = 0.1, 0.25  # K_v / K_sv; the paper's tables have 0.15 to 0.3


def starting_gains(pressure: float, stroke: float) -> list[Array]:
    """Return starting gains for several K_sv; K_x = n p / L with the stroke [m] as the chamber's length L."""
    k_x = pressure / max(stroke, _SHORTEST_CHAMBER)
    return [np.array([k_x, gain, 0.5 * gain, 0.1 / gain]) for gain in _STARTING_K]


def identifiable_gain_bounds(period: float) -> tuple[Array, Array]:
    """Return bounds of the gains that a sample period [s] makes identifiable; the bounds of `SPECS` for period 0."""
    lower, upper = np.array([[spec.lower, spec.upper] for spec in SPECS]).T
    if period > 0.0:
        shortest = _SHORTEST * period
        _, k_sv, k_v, tau = range(len(SPECS))
        lower[tau] = max(lower[tau], shortest)
        upper[[k_sv, k_v]] = np.minimum(upper[[k_sv, k_v]], 1.0 / shortest)
    return lower, upper


def alternative_starts(gains: Array, astray: bool) -> list[Array]:
    """Return further starting gains near fitted gains; missing effects may have led the fit `astray`."""
    k_x, k_sv, k_v, tau = gains
    starts = [np.array([k_x, _QUICKER * k_sv, _QUICKER * k_v, tau / _QUICKER])] if astray else []
    if not _SLOWEST_RELIEF * k_sv <= k_v <= k_sv:
        starts.append(np.array([k_x, k_sv, _USUAL_RELIEF * k_sv, tau]))
    if k_x < _SOFTEST:
        starts.append(np.array([_ATMOSPHERE / _SHORTEST_CHAMBER, k_sv, k_v, tau]))
    return starts


def displacement_sensitivity(gains: Array) -> float:
    """Return the pressure jump for each metre of a displacement jump [Pa/m]."""
    return float(gains[0])


def quickest(gains: Sequence[float] | Array) -> float:
    """Return the inverse of the shortest time constant [1/s]."""
    _, k_sv, k_v, tau = gains
    return float(max(k_sv, k_v, 1.0 / tau))


def slowest(gains: Array) -> float:
    """Return the longest time constant [s]."""
    _, k_sv, k_v, tau = gains.tolist()
    return float(max(1.0 / k_sv, 1.0 / k_v, tau))


def charging_time(gains: Sequence[float] | Array) -> float:
    """Return the time constant with which a pressure rises to its set-point [s]."""
    return float(1.0 / gains[1])


def flows(gains: Array, errors: Array) -> tuple[float, float]:
    """Return the largest charging and exhausting pressure rates at valve errors [Pa/s]; either may be negative."""
    return float(gains[1] * np.max(errors)), float(-gains[2] * np.min(errors))
