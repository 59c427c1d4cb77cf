# SPDX-License-Identifier: Apache-2.0
"""
What a recording holds: signals in SI units, each on its own times.

A long recording's signals are kept in files. They are arrays like any others; who goes over them by `Signal.parts` or
`Recording.between` needs memory for a part only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.recording.memory_maps import give_back, parts

GAUGE, ABSOLUTE = 'gauge', 'absolute'
"""What a pressure may be counted from."""


@dataclass(frozen=True, repr=False)
class Signal:
    """
    A quantity as it was sampled.

    Attributes
    ----------
    times : (n,) array
        Strictly increasing times [s] since the recording's epoch.
    values : (n,) array
        Finite values in SI units.
    unit : str or None
        Name of the unit in which it was recorded, as a mapping says; None for SI.
    reference : str or None
        Whether a pressure was recorded as `gauge` or `absolute`, as a mapping says; None where none does.

    """

    times: Array
    values: Array
    unit: str | None = None
    reference: str | None = None

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.times)

    def __repr__(self) -> str:
        """Return how many samples there are."""
        return f'<Signal of {len(self):,} samples>'

    def parts(self) -> Iterator[Signal]:
        """Yield the signal piece by piece, in order."""
        for part in parts(self.times, self.values):
            yield Signal(self.times[part], self.values[part])

    def between(self, begin: float, end: float) -> Signal:
        """Return the samples from `begin` on and before `end` [s], in memory."""
        return self._copy(int(np.searchsorted(self.times, begin)), int(np.searchsorted(self.times, end)))

    def holding_between(self, begin: float, end: float) -> Signal:
        """Return values that hold until the next: those set between two times [s], and what held at the first."""
        held = int(np.searchsorted(self.times, begin, side='right')) - 1
        return self._copy(max(held, 0), int(np.searchsorted(self.times, end)))

    def _copy(self, first: int, last: int) -> Signal:
        copy = Signal(self.times[first:last].copy(), self.values[first:last].copy())
        give_back(self.times, self.values)
        return copy


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

    def between(self, begin: float, end: float) -> CylinderSignals:
        """Return what lies between two times [s], with the set pressure that acted at the first of them."""
        setpoint = None if self.setpoint is None else self.setpoint.holding_between(begin, end)
        return CylinderSignals(self.pressure.between(begin, end), setpoint)
