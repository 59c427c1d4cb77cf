# SPDX-License-Identifier: Apache-2.0
"""A recording: the signals of one bag or table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from cfd_pneumatic.arguments import check_numbers
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.from_arrays import signals_from_arrays
from cfd_pneumatic.recording.signals import CylinderSignals, Signal


@dataclass(frozen=True, repr=False)
class Recording:
    """
    Signals of a bag or table.

    Attributes
    ----------
    name : str
        Name of the file or folder.
    epoch : int
        Time of the earliest sample of any signal [ns], since 1970 in a bag, since the table's zero in a table.
    displacement : Signal
        Displacement [m]; +x grows cylinder A's volume and shrinks B's.
    cylinders : Mapping
        Signals by cylinder (`cylinder_a`, `cylinder_b`); only cylinders with a recorded pressure.
    force : Signal or None
        Measured contact force [N].
    health : tuple of str
        Messages to the user on defects of the data and their treatment.
    others : Mapping
        Further signals by their names in the mapping [SI].
    rests : bool
        Whether no displacement was recorded; the piston is then assumed to rest.
    shared_times : float
        Share of the samples that were left out because another sample with a different value has the same time.

    """

    name: str
    epoch: int
    displacement: Signal
    cylinders: Mapping[str, CylinderSignals]
    force: Signal | None
    health: tuple[str, ...]
    others: Mapping[str, Signal] = field(default_factory=dict)
    rests: bool = False
    shared_times: float = 0.0

    @classmethod
    def from_arrays(
        cls,
        times: ArrayLike,
        displacement: ArrayLike | None,
        pressures: Mapping[str, ArrayLike],
        setpoints: Mapping[str, ArrayLike] = MappingProxyType({}),
        force: ArrayLike | None = None,
        *,
        name: str = 'arrays',
    ) -> Recording:
        """
        Return a recording of signals that were sampled together, from NumPy arrays or pandas columns.

        Masked and non-finite values, repeated or unordered times, and gaps are treated and noted as in a file.

        Parameters
        ----------
        times : (n,) array
            Times of the samples [s], dates or durations of NumPy, pandas or `datetime`, or dates as texts in ISO 8601.
            Dates without a zone are in UTC.
        displacement : (n,) array or None
            Displacement [m]; +x grows cylinder A. None if the piston rests.
        pressures : Mapping of (n,) arrays
            Absolute pressures by cylinder, `cylinder_a` and `cylinder_b` or one of them [Pa].
        setpoints : Mapping of (n,) arrays or numbers
            Absolute set pressures by cylinder [Pa]; each acts from its time on.
        force : (n,) array, optional
            Measured contact force [N].
        name : str
            Name of the recording.

        Raises
        ------
        InputError
            If shapes differ, a value is not a number, or a name is not that of a cylinder.

        """
        signals = signals_from_arrays(times, displacement, pressures, setpoints, force, name)
        return cls(
            name,
            signals.epoch,
            signals.displacement,
            signals.cylinders,
            signals.force,
            signals.notes,
            rests=displacement is None,
            shared_times=signals.shared_times,
        )

    def __repr__(self) -> str:
        """Return the name and the numbers of samples."""
        return f'<Recording {self}>'

    def __str__(self) -> str:
        """Return the name and the number of samples of each signal."""
        counts = [
            f'{role if cylinder is None else f"{cylinder} {role}"} {len(signal):,}'
            for role, cylinder, signal in self.signals()
        ]
        return f'{self.name}: {", ".join(counts)}'

    def signals(self) -> Iterator[tuple[str, str | None, Signal]]:
        """Yield the role (see `convention.ROLES`), the cylinder and the signal for each recorded signal."""
        if not self.rests:
            yield 'displacement', None, self.displacement
        for cylinder, cylinder_signals in self.cylinders.items():
            yield 'pressure', cylinder, cylinder_signals.pressure
            if cylinder_signals.setpoint is not None:
                yield 'setpoint', cylinder, cylinder_signals.setpoint
        if self.force is not None:
            yield 'force', None, self.force
        for name, signal in self.others.items():
            yield name, None, signal

    def between(self, begin: float, end: float) -> Recording:
        """
        Return the part of the recording between two times, in memory.

        Parameters
        ----------
        begin, end : float
            Times since the epoch [s]. The part includes a sample at `begin` and excludes a sample at `end`.

        Returns
        -------
        Recording
            Part with the same epoch. It includes the set-point that acted at `begin`; other signals may be empty.

        """
        return replace(
            self,
            displacement=self.displacement.between(begin, end),
            cylinders={name: signals.between(begin, end) for name, signals in self.cylinders.items()},
            force=None if self.force is None else self.force.between(begin, end),
            others={name: signal.between(begin, end) for name, signal in self.others.items()},
        )

    def part(self, begin: float | None = None, end: float | None = None) -> Recording:
        """
        Return the part of the recording between two optional times after the first sample [s].

        Raises
        ------
        InputError
            If the part is empty or outside of the recording.

        """
        check_numbers(optional=True, begin=begin, end=end)
        duration = max(float(signal.times[-1]) for _, _, signal in self.signals())
        first, last = (0.0 if begin is None else begin), (duration if end is None else end)
        if not 0.0 <= first < last or first >= duration or (end is not None and end > duration):
            raise InputError(
                f'{self.name}: {first:g} to {last:g} s is not within its {duration:.6g} s: give times that are'
            )
        return self.between(first, np.nextafter(last, np.inf) if end is None else last)
