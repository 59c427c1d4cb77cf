# SPDX-License-Identifier: Apache-2.0
"""Recordings of arrays: signals that were sampled together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.recording.recording import Recording
from cfd_pneumatic.recording.signals import CylinderSignals, Signal


class Sampled(Protocol):
    """What sensors gave, sample by sample: each attribute has shape (n,), or (n, 2) for the cylinders A and B."""

    @property
    def times(self) -> Array:
        """Stamps [s]."""

    @property
    def displacement(self) -> Array:
        """Displacement [m]."""

    @property
    def pressures(self) -> Array:
        """Absolute pressures [Pa]."""

    @property
    def setpoints(self) -> Array:
        """Absolute set pressures up to each sample, since the one before [Pa]."""

    @property
    def force(self) -> Array:
        """Contact force [N]."""


def recording_of(record: Sampled, name: str = 'recording', epoch: int = 0) -> Recording:
    """Return what a device's sensors gave, as if it had been read from a bag; `epoch` is when its time is zero [ns]."""
    start = float(record.times[0])
    pressures, setpoints = (dict(zip(CYLINDERS, columns.T)) for columns in (record.pressures, record.setpoints))
    return sampled(
        record.times - start,
        record.displacement,
        pressures,
        setpoints,
        record.force,
        name=name,
        epoch=epoch + round(start * 1e9),
    )


def sampled(
    times: Array,
    displacement: Array,
    pressures: Mapping[str, Array],
    setpoints: Mapping[str, Array] = MappingProxyType({}),
    force: Array | None = None,
    *,
    name: str = 'recording',
    epoch: int = 0,
) -> Recording:
    """
    Return a recording of signals on one clock.

    Parameters
    ----------
    times : (n,) array
        Of the samples [s], strictly increasing.
    displacement : (n,) array
        Displacement [m].
    pressures : Mapping of (n,) arrays
        Absolute pressures by cylinder [Pa].
    setpoints : Mapping of (n,) arrays
        Absolute set pressures by cylinder, where they were recorded, that acted up to each sample [Pa].
    force : (n,) array, optional
        Contact force [N].
    name : str
        What to call it.
    epoch : int
        Time of zero [ns].

    """
    cylinders = {
        cylinder: CylinderSignals(
            Signal(times, pressure), applied(times, setpoints[cylinder]) if cylinder in setpoints else None
        )
        for cylinder, pressure in pressures.items()
    }
    felt = None if force is None else Signal(times, force)
    return Recording(name, epoch, Signal(times, displacement), cylinders, felt, ())


def applied(times: Array, values: Array) -> Signal:
    """Return what acted up to each sample, since the one before, as values that hold from their times on."""
    changed = np.flatnonzero(np.diff(values)) + 1
    return Signal(np.append(times[:1], times[changed - 1]), np.append(values[:1], values[changed]))
