# SPDX-License-Identifier: Apache-2.0
"""
Signals of a recording in SI units, each with separate sample times.

The signals of a long recording are arrays in files. A caller that uses `Signal.parts` or `Recording.between` needs
memory for a part only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.recording.memory_maps import give_back, parts

GAUGE, ABSOLUTE = 'gauge', 'absolute'
"""References of a pressure."""


@dataclass(frozen=True, repr=False)
class Signal:
    """
    Samples of a quantity.

    Attributes
    ----------
    times : (n,) array
        Strictly increasing times [s] since the recording's epoch.
    values : (n,) array
        Finite values in SI units.
    unit : str or None
        Name of the recorded unit according to a mapping; None for SI.
    reference : str or None
        Recorded reference of a pressure according to a mapping, `gauge` or `absolute`; None without a mapping.

    """

    times: Array
    values: Array
    unit: str | None = None
    reference: str | None = None

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.times)

    def __repr__(self) -> str:
        """Return the number of samples as text."""
        return f'<Signal of {len(self):,} samples>'

    def parts(self) -> Iterator[Signal]:
        """Yield consecutive parts of the signal."""
        for part in parts(self.times, self.values):
            yield Signal(self.times[part], self.values[part])

    def between(self, begin: float, end: float) -> Signal:
        """Return the samples from `begin` (included) to `end` (excluded) [s], in memory."""
        return self._copy(int(np.searchsorted(self.times, begin)), int(np.searchsorted(self.times, end)))

    def holding_between(self, begin: float, end: float) -> Signal:
        """Return the samples between two times [s] and the sample that acts at `begin`; values hold until the next."""
        first = int(np.searchsorted(self.times, begin, side='right')) - 1
        return self._copy(max(first, 0), int(np.searchsorted(self.times, end)))

    def _copy(self, first: int, last: int) -> Signal:
        copy = Signal(self.times[first:last].copy(), self.values[first:last].copy())
        give_back(self.times, self.values)
        return copy


@dataclass(frozen=True)
class CylinderSignals:
    """
    Recorded signals of a cylinder.

    Attributes
    ----------
    pressure : Signal
        Absolute pressure [Pa].
    setpoint : Signal or None
        Absolute set pressure [Pa]: ``values[i]`` acts from ``times[i]`` until ``times[i + 1]``; adjacent values differ.
        None if not recorded.

    """

    pressure: Signal
    setpoint: Signal | None

    def between(self, begin: float, end: float) -> CylinderSignals:
        """Return the samples between two times [s], including the set pressure that acts at the first time."""
        setpoint = None if self.setpoint is None else self.setpoint.holding_between(begin, end)
        return CylinderSignals(self.pressure.between(begin, end), setpoint)
