# SPDX-License-Identifier: Apache-2.0
"""Sources of signals: the place of a signal's numbers in a recording, and their conversion to SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

OTHER = 'other'
"""Role of a signal that only a mapping defines."""

RECEIVE = 'receive'
"""Value of `SignalSource.stamp` for the time of reception instead of stamps in the messages."""


@dataclass(frozen=True)
class SignalSource:
    """
    Source of a signal in a recording.

    The value in SI units is ``gain * raw + bias``, plus the ambient pressure for a `gauge` pressure.

    Attributes
    ----------
    role : str
        Role of the signal: a name of `convention.ROLES`, or `OTHER`.
    cylinder : str or None
        Cylinder of the signal; None for the displacement and the force; the signal's name for the role `OTHER`.
    source : str or int
        Topic of a bag, or column of a table: its name, or its number from 1 on.
    field : str or None
        Path of the number inside a message; None for the main number of a standard type.
    stamp : str or None
        Path of the time inside a message, or `RECEIVE`; None for the stamp of the header, if the type has a header.
    stamp_unit : float
        Unit of a stamp that is a plain number [s].
    gain, bias : float
        Signed conversion to SI units.
    unit : str or None
        Name of the recorded unit; None for SI.
    gauge : bool
        Whether the number is a pressure above ambient.
    time_offset : float
        Added to the times [s].
    table : str
        Unit and reference in the table from which a bag was made, such as `psi gauge`; empty for other bags.

    """

    role: str
    cylinder: str | None
    source: str | int
    field: str | None = None
    stamp: str | None = None
    stamp_unit: float = 1.0
    gain: float = 1.0
    bias: float = 0.0
    unit: str | None = None
    gauge: bool = False
    time_offset: float = 0.0
    table: str = ''

    @property
    def name(self) -> str:
        """Name in messages: `displacement`, `cylinder_a pressure`."""
        return ' '.join(word for word in (self.cylinder, self.role) if word not in (None, OTHER))

    def si(self, raw: Array, ambient_pressure: float) -> Array:
        """Convert raw numbers to SI units, and pressures to absolute pressures; an overflow gives infinity."""
        with np.errstate(over='ignore', invalid='ignore'):
            return self.gain * raw + (self.bias + (ambient_pressure if self.gauge else 0.0))


@dataclass(frozen=True)
class Samples:
    """
    Raw samples of a channel: unsorted, in the recorded unit.

    Attributes
    ----------
    channel : SignalSource
        The channel.
    times : (n,) array of int
        Times [ns].
    raw : (n,) array
        Numbers as recorded.

    """

    channel: SignalSource
    times: NDArray[np.int64]
    raw: Array
