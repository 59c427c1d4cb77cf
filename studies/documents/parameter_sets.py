# SPDX-License-Identifier: Apache-2.0
"""Simulate many parameter sets over a recording on all cores, for a figure of docs/measurements/speed.md."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cfd_pneumatic.model import fused, propagate
from cfd_pneumatic.runtime import map_in_threads, threads


def simulate_parameter_sets(
    gains: np.ndarray, times: np.ndarray, displacement: np.ndarray, setpoint: np.ndarray
) -> np.ndarray:
    """
    Return the outlet pressures of each parameter set [Pa], shape (sets, n), from rest at the first sample.

    Parameters
    ----------
    gains
        Gains of each set in the order of `SPECS`, shape (sets, gains) [SI].
    times, displacement, setpoint
        As in `Cylinder.simulate`.

    """
    pressures = np.empty((len(gains), times.size))
    states = np.full((len(gains), 2), setpoint[0])

    def run(part: slice) -> None:
        _propagate_sets(times, displacement, setpoint, gains[part], states[part], pressures[part])

    cuts = np.linspace(0, len(gains), 2 * threads() + 1).astype(int).tolist()
    map_in_threads(run, [slice(begin, end) for begin, end in pairwise(cuts)])
    return pressures


@fused
def _propagate_sets(times, displacement, setpoint, gains, states, pressures):  # type: ignore[no-untyped-def]
    """Fill in the pressures for the gains k_x, k_sv, k_v, tau of each set."""
    table = np.zeros((1, 5))
    for row in range(len(gains)):
        table[0, 1:] = gains[row]
        propagate(times, displacement, setpoint, table, 0.0, states[row], pressures[row])
