# SPDX-License-Identifier: Apache-2.0
"""Sources: where a recording keeps the numbers of a signal, and what makes SI units of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

OTHER = 'other'
"""Role of a signal that only a mapping knows."""

RECEIVE = 'receive'
"""As a `SignalSource.stamp`: the time of reception, whatever stamps the messages have."""


@dataclass(frozen=True)
class SignalSource:
    """
    One signal of a recording.

    A raw number is ``gain * raw + bias`` in SI units, plus the ambient pressure if it is a `gauge` pressure.

    Attributes
    ----------
    role : str
        What the signal is: a name of `convention.ROLES`, or `OTHER`.
    cylinder : str or None
        Whose it is; None for the displacement and the force. The name of a signal in another role.
    source : str or int
        Topic of a bag, or column of a table: its name, or its number from 1 on.
    field : str or None
        Path of the number inside a message; None for the obvious one of a standard type.
    stamp : str or None
        Path of the time inside a message, or `RECEIVE`; None for the header's stamp where there is a header.
    stamp_unit : float
        Unit of a stamp that is a plain number [s].
    gain, bias : float
        Conversion to SI units, with the sign.
    unit : str or None
        Name of the unit in which it is recorded; None for SI.
    gauge : bool
        Whether the number is a pressure above ambient.
    time_offset : float
        Added to the times [s].
    table : str
        Unit and reference in the table that a bag was made of, as `psi gauge`; empty where it was made of none.

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
        """Name for people: `displacement`, `cylinder_a pressure`."""
        return ' '.join(word for word in (self.cylinder, self.role) if word not in (None, OTHER))

    def si(self, raw: Array, ambient_pressure: float) -> Array:
        """Return raw numbers in SI units; pressures come out absolute, and what is too large infinite."""
        with np.errstate(over='ignore', invalid='ignore'):
            return self.gain * raw + (self.bias + (ambient_pressure if self.gauge else 0.0))


@dataclass(frozen=True)
class Samples:
    """
    What a source holds for a channel, as found: unsorted, in the channel's own units.

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
