"""Recordings of arrays: signals that were sampled together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.recording.signals import CylinderSignals, Recording, Signal


class Sampled(Protocol):
    """What sensors gave, sample by sample: each attribute has shape (n,), or (n, 2) for the cylinders A and B."""

    @property
    def times(self) -> NDArray[np.float64]:
        """Stamps [s]."""

    @property
    def displacement(self) -> NDArray[np.float64]:
        """Displacement [m]."""

    @property
    def pressures(self) -> NDArray[np.float64]:
        """Absolute pressures [Pa]."""

    @property
    def setpoints(self) -> NDArray[np.float64]:
        """Absolute set pressures up to each sample, since the one before [Pa]."""

    @property
    def force(self) -> NDArray[np.float64]:
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
    times: NDArray[np.float64],
    displacement: NDArray[np.float64],
    pressures: Mapping[str, NDArray[np.float64]],
    setpoints: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
    force: NDArray[np.float64] | None = None,
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


def applied(times: NDArray[np.float64], values: NDArray[np.float64]) -> Signal:
    """Return what acted up to each sample, since the one before, as values that hold from their times on."""
    changed = np.flatnonzero(np.diff(values)) + 1
    return Signal(np.append(times[:1], times[changed - 1]), np.append(values[:1], values[changed]))
