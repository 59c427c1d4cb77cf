"""What a recording holds: signals in SI units, each on its own times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Signal:
    """
    A quantity as it was sampled.

    Attributes
    ----------
    times : (n,) array
        Strictly increasing times [s] since the recording's epoch.
    values : (n,) array
        Finite values in SI units.

    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.times)


@dataclass(frozen=True)
class CylinderSignals:
    """
    What was recorded of one cylinder.

    Attributes
    ----------
    pressure : Signal
        Absolute pressure [Pa].
    setpoint : Signal or None
        Absolute set pressure [Pa]: ``values[i]`` acts from ``times[i]`` until ``times[i + 1]``, and neighbours differ.
        None where it was not recorded.

    """

    pressure: Signal
    setpoint: Signal | None


@dataclass(frozen=True)
class Recording:
    """
    One bag or table.

    Attributes
    ----------
    name : str
        Name of the file or folder.
    epoch : int
        Time of zero [ns]: the earliest sample of any signal. Since 1970 in a bag, since its own zero in a table.
    displacement : Signal
        Displacement [m]; +x grows cylinder A's volume and shrinks B's.
    cylinders : Mapping
        Signals by cylinder, for those (`cylinder_a`, `cylinder_b`) whose pressure was recorded.
    force : Signal or None
        Measured contact force [N].
    health : tuple of str
        What was amiss and how it was treated, for people to read.

    """

    name: str
    epoch: int
    displacement: Signal
    cylinders: Mapping[str, CylinderSignals]
    force: Signal | None
    health: tuple[str, ...]
