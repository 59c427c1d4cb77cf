# SPDX-License-Identifier: Apache-2.0
"""What others need to know of the paper's model: where a fit starts, what shows a parameter, how quick it is."""

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
"""What to record so that a parameter shows."""

_STARTING_K = (3.0, 30.0, 150.0)  # charging gains [1/s]
_SHORTEST_CHAMBER = 0.03  # [m]
_ATMOSPHERE = 1e5  # [Pa]
_SOFTEST = _ATMOSPHERE / 10.0  # of a chamber ten metres long [Pa/m]: no stroke moves its pressure
_SHORTEST = 0.3  # sample periods: a quicker time constant can't be told from none
_QUICKER = 5.0
_SLOWEST_RELIEF, _USUAL_RELIEF = 0.1, 0.25  # K_v over K_sv; the paper's tables have 0.15 to 0.3


def starting_gains(pressure: float, stroke: float) -> list[Array]:
    """Return starts about K_x = n p / L with the chamber's length L taken as the stroke's order [m], and several K."""
    k_x = pressure / max(stroke, _SHORTEST_CHAMBER)
    return [np.array([k_x, gain, 0.5 * gain, 0.1 / gain]) for gain in _STARTING_K]


def told_gains(period: float) -> tuple[Array, Array]:
    """Return bounds of the gains within which samples of some period [s] tell them; their own bounds for 0."""
    lower, upper = np.array([[spec.lower, spec.upper] for spec in SPECS]).T
    if period > 0.0:
        shortest = _SHORTEST * period
        _, k_sv, k_v, tau = range(len(SPECS))
        lower[tau] = max(lower[tau], shortest)
        upper[[k_sv, k_v]] = np.minimum(upper[[k_sv, k_v]], 1.0 / shortest)
    return lower, upper


def other_gains(gains: Array, astray: bool) -> list[Array]:
    """Return gains to start from beside those of a fit; what it lacks may have led them `astray`."""
    k_x, k_sv, k_v, tau = gains
    others = [np.array([k_x, _QUICKER * k_sv, _QUICKER * k_v, tau / _QUICKER])] if astray else []
    if not _SLOWEST_RELIEF * k_sv <= k_v <= k_sv:
        others.append(np.array([k_x, k_sv, _USUAL_RELIEF * k_sv, tau]))
    if k_x < _SOFTEST:
        others.append(np.array([_ATMOSPHERE / _SHORTEST_CHAMBER, k_sv, k_v, tau]))
    return others


def displacement_sensitivity(gains: Array) -> float:
    """Return by how much a displacement that jumps moves the pressure [Pa/m]."""
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
    """Return the time constant of a pressure that rises to its set-point [s]."""
    return float(1.0 / gains[1])


def flows(gains: Array, errors: Array) -> tuple[float, float]:
    """Return the largest pressure rates of charge and exhaust that valve errors make [Pa/s], either maybe negative."""
    return float(gains[1] * np.max(errors)), float(-gains[2] * np.min(errors))
