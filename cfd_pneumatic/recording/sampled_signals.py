# SPDX-License-Identifier: Apache-2.0
"""Make recordings of arrays whose signals were sampled together."""

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
    """Sensor data on common times: each attribute has shape (n,), or (n, 2) for the cylinders A and B."""

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
        """Absolute set pressures between the previous sample and each sample [Pa]."""

    @property
    def force(self) -> Array:
        """Contact force [N]."""


def recording_of(record: Sampled, name: str = 'recording', epoch: int = 0) -> Recording:
    """Convert a device's sensor data to a recording, as if read from a bag; `epoch` is the time of zero [ns]."""
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
    Return a recording of signals with common sample times.

    Parameters
    ----------
    times : (n,) array
        Times of the samples [s], strictly increasing.
    displacement : (n,) array
        Displacement [m].
    pressures : Mapping of (n,) arrays
        Absolute pressures by cylinder [Pa].
    setpoints : Mapping of (n,) arrays
        Absolute set pressures that acted up to each sample [Pa], by cylinder with a recorded set-point.
    force : (n,) array, optional
        Contact force [N].
    name : str
        Name of the recording.
    epoch : int
        Time of zero [ns].

    """
    cylinders = {
        cylinder: CylinderSignals(
            Signal(times, pressure), _held_signal(times, setpoints[cylinder]) if cylinder in setpoints else None
        )
        for cylinder, pressure in pressures.items()
    }
    force_signal = None if force is None else Signal(times, force)
    return Recording(name, epoch, Signal(times, displacement), cylinders, force_signal, ())


def _held_signal(times: Array, values: Array) -> Signal:
    """Convert values that acted up to each sample to values that hold from their times on."""
    changed = np.flatnonzero(np.diff(values)) + 1
    return Signal(np.append(times[:1], times[changed - 1]), np.append(values[:1], values[changed]))
