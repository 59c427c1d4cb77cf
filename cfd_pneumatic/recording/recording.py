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
    others : Mapping
        Further signals, by the names that a mapping gives them [SI].
    rests : bool
        Whether no displacement was recorded: the piston is taken to be at rest.
    shared_times : float
        Share of the samples that were left out since they had the time of another sample, and another value.

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
        Return a recording of signals that were sampled together, as NumPy's arrays or columns of pandas.

        Values that are masked or no finite numbers, times that come twice or out of order, and gaps are treated and
        noted as those of a file are.

        Parameters
        ----------
        times : (n,) array
            Times of the samples [s], dates or durations of NumPy, pandas or `datetime`, or dates as texts in ISO 8601.
            Dates without a zone are in UTC.
        displacement : (n,) array or None
            Displacement [m]; +x grows cylinder A. None where the piston rests.
        pressures : Mapping of (n,) arrays
            Absolute pressures by cylinder, `cylinder_a` and `cylinder_b` or one of them [Pa].
        setpoints : Mapping of (n,) arrays or numbers
            Absolute set pressures by cylinder, each of which acts from its time on [Pa].
        force : (n,) array, optional
            Measured contact force [N].
        name : str
            What to call it.

        Raises
        ------
        InputError
            If shapes differ, something is no number, or a name is no cylinder's.

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
        """Return what it is."""
        return f'<Recording {self}>'

    def __str__(self) -> str:
        """Return how many samples there are of each signal."""
        counted = [
            f'{role if cylinder is None else f"{cylinder} {role}"} {len(signal):,}'
            for role, cylinder, signal in self.signals()
        ]
        return f'{self.name}: {", ".join(counted)}'

    def signals(self) -> Iterator[tuple[str, str | None, Signal]]:
        """Yield the signals that there are, with their roles, see `convention.ROLES`, and cylinders."""
        if not self.rests:
            yield 'displacement', None, self.displacement
        for cylinder, own in self.cylinders.items():
            yield 'pressure', cylinder, own.pressure
            if own.setpoint is not None:
                yield 'setpoint', cylinder, own.setpoint
        if self.force is not None:
            yield 'force', None, self.force
        for name, signal in self.others.items():
            yield name, None, signal

    def between(self, begin: float, end: float) -> Recording:
        """
        Return what lies between two times, in memory.

        Parameters
        ----------
        begin, end : float
            Times since the epoch, which stays [s]; a sample at `begin` counts, one at `end` doesn't.

        Returns
        -------
        Recording
            Of the set-points also the one that acted at `begin`, at its own time; of other signals maybe no sample.

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
        Return what lies between two times after the first sample [s], either of which may be left out.

        Raises
        ------
        InputError
            If that is outside of the recording, or nothing.

        """
        check_numbers(optional=True, begin=begin, end=end)
        lasts = max(float(signal.times[-1]) for _, _, signal in self.signals())
        first, last = (0.0 if begin is None else begin), (lasts if end is None else end)
        if not 0.0 <= first < last or first >= lasts or (end is not None and end > lasts):
            raise InputError(
                f'{self.name}: {first:g} to {last:g} s is not within its {lasts:.6g} s: give times that are'
            )
        return self.between(first, np.nextafter(last, np.inf) if end is None else last)
